"""Lying on the belly, rising from it and lying down."""

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.robot.lying import crouching_posture, lying_posture, place_feet
from lgmpc.settings import Fraction, NonNegative, Positive, Settings, key
from lgmpc.timegrid import minimum_jerk
from lgmpc.typing import Array

_NEAR = 0.2  # rad from the lying posture, within which the legs move to it directly
_SHORTEST = 0.3  # s of a stroke of the legs


class LyingSettings(Settings):
    """Folding of the legs, and durations of rising and lying down."""

    fold_rate_rad_s: Positive = key(1.5, "Mean rate of the joint that moves most while the legs are folded, rad/s.")
    clearance_m: NonNegative = key(0.02, "Height by which the feet are lifted meanwhile, m.")
    stiffness: Positive = key(3.0, "Stiffness of the folded legs, in torque limits per rad.")
    damping_s: Positive = key(0.03, "Damping of the folded legs, in torque limits per rad/s.")
    effort_share: Fraction = key(0.9, "Largest torque of the folding legs, in torque limits.")
    rise_s: Positive = key(1.5, "Duration of rising and of lying down, s.")
    load_s: Positive = key(0.4, "Duration of loading and unloading of the feet, s.")


class LegRetraction:
    """Folds the legs of a robot that lies on its belly, in joint space, and holds them folded.

    The feet are lifted on the way, so that they do not drag over the floor, and put down at their positions in the
    reference posture, from which the robot rises without a step.

    Args:
        robot: the controller's model.
        settings: see :class:`LyingSettings`.

    Attributes:
        lying: (nu,) joints of the lying posture, rad.
        height: height of the centre of mass above the contact points in that posture, m.
        crouch: the same in the lowest posture on the feet, from which the legs fold, m.
        base_share: descent of the base from standing to lying over that of the centre of mass.
    """

    def __init__(self, robot: Robot, settings: LyingSettings) -> None:
        q, data = lying_posture(robot), robot.create_data()
        self.lying = q[robot.joint_q].copy()
        pin.framesForwardKinematics(robot.model, data, q)
        feet = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
        com = float(pin.centerOfMass(robot.model, data, q)[2])
        self.height = com - float(feet[:, 2].mean()) + robot.foot_points.radius
        crouching = crouching_posture(robot, float(q[2]))
        pin.framesForwardKinematics(robot.model, data, crouching)
        lowest = float(np.mean([data.oMf[frame].translation[2] for frame in robot.contact_ids]))
        self.crouch = float(pin.centerOfMass(robot.model, data, crouching)[2]) - lowest + robot.foot_points.radius
        standing = float(pin.centerOfMass(robot.model, data, robot.q_reference)[2])
        self.base_share = (float(q[2] - robot.q_reference[2])) / (com - standing) if com != standing else 1.0
        raised = place_feet(robot, q, q[:3], feet + [0.0, 0.0, settings.clearance_m])
        self._raised = self.lying if raised is None else raised[robot.joint_q].copy()
        self._settings = settings
        self._kp, self._kd = settings.stiffness * robot.effort_limit, settings.damping_s * robot.effort_limit
        self._limit = settings.effort_share * robot.effort_limit
        self._times, self._knots = np.zeros(1), self.lying[None]
        self._torque = np.zeros(robot.nu)

    def begin(self, t: float, joints: Array, torque: Array) -> None:
        """Begin to fold the legs.

        Args:
            t: time, s.
            joints: (nu,) present positions.
            torque: (nu,) present torque, which decays to zero over ``load_s``.
        """
        self._torque[:] = torque
        near = bool(np.abs(joints - self.lying).max() < _NEAR)
        self._knots = np.array([joints, self.lying] if near else [joints, self._raised, self.lying])
        strokes = np.abs(np.diff(self._knots, axis=0)).max(axis=1) / self._settings.fold_rate_rad_s
        self._times = t + np.concatenate([[0.0], np.cumsum(np.maximum(strokes, _SHORTEST))])

    def done(self, t: float) -> bool:
        """Return whether the legs are folded at time ``t``, s."""
        return t >= float(self._times[-1])

    def torques(self, t: float, joints: Array, rates: Array) -> Array:
        """Return the torques (nu,) at time ``t``, s, for joint positions and rates (nu,)."""
        position, velocity = self.target(t)
        faded = max(1.0 - (t - float(self._times[0])) / self._settings.load_s, 0.0)
        torque = faded * self._torque + self._kp * (position - joints) + self._kd * (velocity - rates)
        return np.clip(torque, -self._limit, self._limit)

    def target(self, t: float) -> tuple[Array, Array]:
        """Return the desired joint positions and rates (nu,) at time ``t``, s: least-jerk paths from knot to knot."""
        k = int(np.searchsorted(self._times, t, side="right")) - 1
        if k >= len(self._times) - 1:
            return self._knots[-1], np.zeros_like(self.lying)
        duration = float(self._times[k + 1] - self._times[k])
        way, rate, _ = minimum_jerk((t - float(self._times[k])) / duration)
        step = self._knots[k + 1] - self._knots[k]
        return self._knots[k] + way * step, rate / duration * step


class RiseMotion:
    """Moves the centre of mass up from the belly or down onto it, all feet on the ground: an offset from standing.

    Before rising, the weight is transferred linearly from the floor under the trunk to the feet. After lying down the
    feet may still carry a part of it: a joint limit may prevent the transfer, which the folding legs complete.

    Args:
        settings: see :class:`LyingSettings`.

    Attributes:
        offset: (3,) of the target from that of standing at the last :meth:`update`, m.
        velocity: (3,) m/s.
        acceleration: (3,) m/s2.
        support: share of the weight that the floor carries under the trunk.
        lying: position between standing, 0, and lying, 1.
    """

    def __init__(self, settings: LyingSettings) -> None:
        self._settings = settings
        self._begin, self._duration = 0.0, settings.rise_s
        self._start, self._way = np.zeros(3), np.zeros(3)
        self._rising = True
        self.offset, self.velocity, self.acceleration = np.zeros((3, 3))
        self.support = self.lying = 0.0

    def begin(self, t: float, start: Array, goal: Array, duration: float | None = None) -> None:
        """Begin to move at time ``t``, s, from the offset ``start`` (3,) to ``goal`` (3,), m; within a duration, s."""
        self._begin, self._duration = t, self._settings.rise_s if duration is None else duration
        self._start[:], self._way[:] = start, goal - start
        self._rising = bool(goal[2] > start[2])

    def update(self, t: float) -> bool:
        """Write the target at time ``t``, s; return whether the motion is over."""
        s, elapsed = self._settings, t - self._begin
        self.support = max(1.0 - elapsed / s.load_s, 0.0) if self._rising else 0.0
        moving = elapsed - s.load_s if self._rising else elapsed
        way, rate, curvature = minimum_jerk(min(max(moving / self._duration, 0.0), 1.0))
        self.lying = 1.0 - way if self._rising else way
        np.multiply(way, self._way, out=self.offset)
        self.offset += self._start
        np.multiply(rate / self._duration, self._way, out=self.velocity)
        np.multiply(curvature / self._duration**2, self._way, out=self.acceleration)
        return moving >= self._duration
