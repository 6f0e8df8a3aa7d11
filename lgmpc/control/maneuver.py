"""Manoeuvres: planned motions, also through the air, sampled at the controller's ticks."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.lie import attitude, quaternion, so3
from lgmpc.robot import Robot
from lgmpc.robot.lying import place_feet
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array, BoolArray
from lgmpc.wbc import WholeBodyTerms

_POSTURE_ERROR = 0.25
"""rad; a manoeuvre begins and ends within this of the reference posture."""

_SPEED = 0.1
"""rad/s, m/s; a manoeuvre begins and ends slower than this."""

_STRETCH = (0.05, 0.1, 0.15, 0.2, 0.25)
"""By how much of their height legs are longer in a fall: the largest that they reach."""

_RISE_S, _SETTLE_S, _LONGEST_FALL_S = 0.4, 0.3, 1.0
"""s; of a landing from the touchdown to the height of standing, there, and of the fall before."""

_STRETCH_S = 0.06
"""s in which legs are stretched at the end of a planned fall."""

_TILT = 20.0
"""degrees; a planned fall ends within this of upright."""


@dataclass(frozen=True, eq=False)
class Maneuver:
    """A planned motion at n ticks, world axes.

    Attributes:
        name: by which commands call it.
        period: between two ticks, s.
        q: (n, nq) configurations.
        v: (n, nv) velocities.
        acceleration: (n, nv) rates of the velocities.
        rotation: (n, 3, 3) of the base, body to world.
        com: (n, 3) centre of mass, m.
        momentum: (n, 6) centroidal momentum [linear; angular].
        momentum_rate: (n, 6) its rate.
        forces: (n, nc, 3) contact forces, N.
        stance: (n, nc) which feet carry.
        points: (n, nc, 3) contact points, m.
        longest_wait_s: longest wait for a touchdown, s.
        anchored: whether it is performed where it was planned, and not wherever the robot stands.
    """

    name: str
    period: float
    q: Array
    v: Array
    acceleration: Array
    rotation: Array
    com: Array
    momentum: Array
    momentum_rate: Array
    forces: Array
    stance: BoolArray
    points: Array
    longest_wait_s: float = 0.15
    anchored: bool = False

    @classmethod
    def of(
        cls, name: str, robot: Robot, times: Array, xs: Array, flags: BoolArray, forces: Array, period: float
    ) -> "Maneuver":
        """Sample a planned trajectory that leads from standing to standing; arguments as of :meth:`sampled`.

        A fall, which has no contacts, leads to an upright attitude, and is followed by a landing.

        Raises:
            InputError: states of another robot, a motion that begins or ends in the air, in motion, or far from the
                reference posture; a fall that ends far from upright.
        """
        if xs.shape[1] != robot.nq + robot.nv or flags.shape[1] != robot.nc:
            got = f"{xs.shape[1]} entries of the state and {flags.shape[1]} contacts"
            raise InputError("trajectory", got, f"{robot.nq + robot.nv} and {robot.nc}, those of {robot.name}")
        falls = not flags.any()
        _check_ends(robot, xs, flags, falls)
        if not falls:
            return cls.sampled(name, robot, times, xs, flags, forces, period)
        last_times, last_xs, last_flags, last_forces = _landing(robot, period)
        whole = (
            np.concatenate([times, times[-1] + _STRETCH_S + last_times]),
            np.concatenate([xs, last_xs]),
            np.concatenate([flags, flags[-1:], last_flags]),
            np.concatenate([forces, forces[-1:], last_forces]),
        )
        return replace(cls.sampled(name, robot, *whole, period), longest_wait_s=_LONGEST_FALL_S)

    @classmethod
    def landing(cls, robot: Robot, period: float) -> "Maneuver":
        """Return a fall onto stretched legs, until the feet touch the ground, and the way back to standing.

        It is performed by a robot that has lost the ground, wherever it falls; its duration is that of the wait.
        """
        landing = cls.sampled("landing", robot, *_landing(robot, period), period)
        return replace(landing, longest_wait_s=_LONGEST_FALL_S)

    @classmethod
    def sampled(
        cls, name: str, robot: Robot, times: Array, xs: Array, flags: BoolArray, forces: Array, period: float
    ) -> "Maneuver":
        """Sample a motion of N intervals; those without length, impacts, are steps of the velocity.

        Args:
            name: by which commands call it.
            robot: whose configuration and velocity are the states.
            times: (N+1,) of the nodes, s.
            xs: (N+1, nq + nv) states.
            flags: (N, nc) contacts of each interval.
            forces: (N, nc, 3) contact forces, world axes, N.
            period: between two ticks, s.
        """
        q, v, terms = xs[:, : robot.nq], xs[:, robot.nq :], WholeBodyTerms(robot)
        momenta = np.zeros((len(xs), 6))
        for k in range(len(xs)):
            terms.update(q[k], v[k])
            momenta[k] = terms.momentum
        lengths = np.diff(times)
        intervals = np.flatnonzero(lengths > 0.0)
        rows = TimeGrid(period, TimeGrid(period).interval(times[-1])).nodes
        of = intervals[np.searchsorted(times[intervals], rows + 1e-9, side="right") - 1]
        shares = np.clip((rows - times[of]) / lengths[of], 0.0, 1.0)
        sampled_q = np.array([pin.interpolate(robot.model, q[k], q[k + 1], s) for k, s in zip(of, shares, strict=True)])
        sampled_v = v[of] + shares[:, None] * (v[of + 1] - v[of])
        bases, coms, points = [], [], []
        for each in zip(sampled_q, sampled_v, strict=True):
            terms.update(*each)
            bases.append(terms.rotation.copy())
            coms.append(terms.com.copy())
            points.append(terms.contact_points.copy())
        return cls(
            name=name,
            period=period,
            q=sampled_q,
            v=sampled_v,
            acceleration=(v[of + 1] - v[of]) / lengths[of, None],
            rotation=np.array(bases),
            com=np.array(coms),
            momentum=momenta[of] + shares[:, None] * (momenta[of + 1] - momenta[of]),
            momentum_rate=(momenta[of + 1] - momenta[of]) / lengths[of, None],
            forces=forces[of],
            stance=flags[of],
            points=np.array(points),
        )

    @property
    def begins_in_the_air(self) -> bool:
        """Whether no foot carries at its first tick."""
        return not self.stance[0].any()

    @property
    def flights(self) -> list[tuple[int, int]]:
        """First tick of each flight, and the first tick after it."""
        air = np.concatenate([[False], ~self.stance.any(axis=1), [False]])
        return list(zip(*(np.flatnonzero(air[1:] != air[:-1]).reshape(-1, 2).T.tolist()), strict=True))

    def placed(self, points: Array, rotation: Array, up: Array) -> "Maneuver":
        """Return the manoeuvre turned about the vertical ``up`` (3,) and shifted to where a robot stands.

        It begins with its feet in the middle of ``points`` (nc, 3), m, along the heading of a base ``rotation`` (3, 3).
        """
        # A plan for a world begins along the heading of the start there.
        begin, ahead = self.rotation[0, :, 0], rotation[:, 0]
        yaw = math.atan2(up @ np.cross(begin, ahead), begin @ ahead - (begin @ up) * (ahead @ up))
        turn = so3.exp(-yaw * up)  # of row vectors
        start, shift = self.points[0].mean(axis=0), points.mean(axis=0)
        q = self.q.copy()
        q[:, :3] = (q[:, :3] - start) @ turn + shift
        half = np.array([*(math.sin(0.5 * yaw) * up), math.cos(0.5 * yaw)])
        q[:, 3:7] = quaternion.compose(half, q[:, 3:7])
        return replace(
            self,
            q=q,
            rotation=turn.T @ self.rotation,
            com=(self.com - start) @ turn + shift,
            momentum=(self.momentum.reshape(-1, 2, 3) @ turn).reshape(-1, 6),
            momentum_rate=(self.momentum_rate.reshape(-1, 2, 3) @ turn).reshape(-1, 6),
            forces=self.forces @ turn,
            points=(self.points - start) @ turn + shift,
        )


def _landing(robot: Robot, period: float) -> tuple[Array, Array, BoolArray, Array]:
    """Return times, states, contacts and forces of a fall onto stretched legs and of the way back to standing."""
    up, fall = np.array([0.0, 0.0, 1.0]), 2.0 * period
    standing, stretched = robot.q_reference, robot.q_reference
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, standing)
    feet = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
    for share in _STRETCH:
        base = standing[:3] + share * (standing[2] - feet[:, 2].mean()) * up
        found = place_feet(robot, standing, base, feet)
        stretched = stretched if found is None else found
    still = np.zeros(robot.nv)
    xs = np.array([np.concatenate([q, still]) for q in (stretched, stretched, standing, standing)])
    flags = np.repeat([[False], [True], [True]], robot.nc, axis=1)
    forces = flags[:, :, None] * (-robot.mass / robot.nc * robot.gravity)
    times = np.array([0.0, fall, fall + _RISE_S, fall + _RISE_S + _SETTLE_S])
    return times, xs, flags, forces


def _check_ends(robot: Robot, xs: Array, flags: BoolArray, falls: bool) -> None:
    """Check that a trajectory leads from standing to standing or, of a fall, in this posture to upright."""
    reference = robot.q_reference[robot.joint_q]
    if falls:
        tilt = float(np.degrees(attitude.tilt(so3.from_quaternion(xs[-1, 3:7]))))
        if tilt > _TILT:
            raise InputError("trajectory", f"a fall that ends {tilt:.0f} degrees from upright", f"at most {_TILT:g}")
    for where, x, stance in (("beginning", xs[0], flags[0]), ("end", xs[-1], flags[-1])):
        off = np.abs(x[: robot.nq][robot.joint_q] - reference)
        speed = np.abs(x[robot.nq :][robot.joint_v] if falls else x[robot.nq :]).max()
        if not (stance.all() or falls):
            raise InputError("trajectory", f"feet in the air at its {where}", "one that begins and ends on all feet")
        if speed > _SPEED:
            raise InputError("trajectory", f"a speed of {speed:.2g} at its {where}", f"rest: less than {_SPEED:g}")
        if off.max() > _POSTURE_ERROR:
            joint = robot.joint_names[int(off.argmax())]
            got = f"{joint} {off.max():.2g} rad from the reference posture at its {where}"
            raise InputError(
                "trajectory", got, f"at most {_POSTURE_ERROR:g} rad, because the robot stands in this posture"
            )
