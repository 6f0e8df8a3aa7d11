"""Geometric control of a quadrotor, compared with theory and with a controller on Euler angles.

Chapter 4.12.3; Lee, Leok and McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape, largest
from lgmpc.lie import se3, so3
from lgmpc.mechanics import HEIGHT, Symbols, quadrotor, torque_free_body
from lgmpc.typing import Array, IntArray

_QUADROTOR = quadrotor.Quadrotor.of_the_paper()
_REAL = _QUADROTOR.limited(lift=2.5, moment=20.0)
_GAINS = quadrotor.GeometricGains.of_the_paper()
_GOAL = np.array([0.0, 0.0, 3.0])
_STARTS, _TUMBLE, _DURATION, _STEP = 60, 20.0, 7.0, 8e-3  # rad/s, s
_FASTEST = 0.5 / _STEP  # rad/s: a vehicle that rotates faster is lost, and more than a step resolves
_OURS, _THEIRS = 0x0072B2, 0xD55E00


@dataclass(frozen=True)
class _UntilLost:
    """A controller whose rotors stop where the vehicle is lost."""

    controller: quadrotor.Controller

    def control(self, s: Symbols) -> tuple[Any, Any]:
        thrust, moment = self.controller.control(s)
        kept = ca.norm_2(s.velocity[3:]) < _FASTEST
        return ca.if_else(kept, thrust, 0.0), ca.if_else(kept, moment, 0.0)


@dataclass(frozen=True)
class _Flights:
    """Poses (k, n, 4, 4) of k vehicles, constant from when they are lost, and the numbers (k,) of steps until then."""

    times: Array
    poses: Array
    ends: IntArray

    @property
    def lost(self) -> int:
        return int(np.sum(self.ends < len(self.times)))

    @property
    def away(self) -> Array:
        return np.asarray(np.linalg.norm(self.poses[:, :, :3, 3] - _GOAL, axis=-1))


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    times, rotations, rates = _turning()
    pendulum, swing = _pendulum(times, rotations)
    tracking, path = _tracking()
    ours = _flights(quadrotor.GeometricController(_REAL, quadrotor.hover(_GOAL)))
    theirs = _flights(quadrotor.EulerAngleController(_REAL, quadrotor.hover(_GOAL)))
    back = [int(np.sum((f.ends == len(f.times)) & (f.away[:, -1] < 0.1))) for f in (ours, theirs)]
    rows = (
        pendulum,
        _growth(times, rotations),
        *_lyapunov(times, rotations, rates),
        tracking,
        Row(f"not lost, of {_STARTS} tumbling starts", _STARTS, _STARTS - ours.lost, 0.0),
    )
    # The scene shows a start that the Euler-angle controller loses, if there is one.
    shown = int(np.argmin(theirs.ends))
    panels = (
        swing,
        path,
        Panel.over_time(
            f"Distance from the goal, start {shown + 1}",
            "m",
            *(
                Curve(name, f.times[: f.ends[shown]], f.away[shown, : f.ends[shown]])
                for name, f in (("geometric", ours), ("Euler angles, until lost", theirs))
            ),
        ),
    )
    every = slice(None, 500, 4)
    bodies = (
        _vehicle("geometric", ours.poses[shown, every], -0.8, _OURS),
        _vehicle("Euler angles", theirs.poses[shown, every], 0.8, _THEIRS),
    )
    remarks = (
        f"From {_STARTS} random attitudes, tumbling at {_TUMBLE:g} rad/s: {back[0]} are back in {_DURATION:g} s"
        f" with the geometric controller, {back[1]} with Euler angles, which lose {theirs.lost}.",
        "Half a turn is an unstable equilibrium of the geometric controller; near it the recovery starts slowly.",
    )
    return Outcome(rows, panels, ours.times[every], bodies, (), remarks)


def _turning() -> tuple[Array, Array, Array]:
    """Simulate rotations to the identity: from 178 deg of roll, 1e-6 rad off half a turn, half a turn, any attitude.

    Returns:
        Times (n,), rotations (k, n, 3, 3) and rates (k, n, 3).
    """
    rolls = so3.exp(np.array([[np.radians(178.0), 0.0, 0.0], [np.pi - 1e-6, 0.0, 0.0]]))
    random = Rotation.random(20, random_state=4).as_matrix()
    starts = np.concatenate((rolls, np.diag([1.0, -1.0, -1.0])[None], random))
    controller, still = quadrotor.GeometricController(_QUADROTOR, quadrotor.hover()), ca.DM.zeros(3)
    body = torque_free_body(
        _QUADROTOR.inertia, body_force=lambda s: controller.moment(s.pose, s.velocity, ca.DM.eye(3), still, still)
    )
    motions = [body.simulate(rotation, np.zeros(3), step=2e-3, steps=1500) for rotation in starts]
    return motions[0].times, np.array([m.poses for m in motions]), np.array([m.velocities for m in motions])


def _pendulum(times: Array, rotations: Array) -> tuple[Row, Panel]:
    """Compare with a damped pendulum about a principal axis: ``J theta'' = -k_R sin theta - k_Omega theta'``."""
    exact = solve_ivp(
        lambda _, y: [y[1], (-_GAINS.rotation * np.sin(y[0]) - _GAINS.rate * y[1]) / _QUADROTOR.inertia[0, 0]],
        (0.0, times[-1]),
        [np.radians(178.0), 0.0],
        "DOP853",
        times,
        rtol=1e-13,
        atol=1e-13,
    ).y[0]
    angle = np.unwrap(_roll(rotations[0]))
    row = Row("178 deg of roll, off the pendulum", 0.0, largest(angle - exact), 1e-8, "rad")
    curves = Curve("controlled body", times, np.degrees(angle)), Curve("pendulum", times, np.degrees(exact), True)
    return row, Panel.over_time("Recovery from 178 deg", "roll, deg", *curves)


def _roll(rotations: Array) -> Array:
    return np.asarray(np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2]))


def _growth(times: Array, rotations: Array) -> Row:
    """Compare with the linearisation at the antipode: ``J delta'' = k_R delta - k_Omega delta'``."""
    short, inertia = np.pi - np.abs(_roll(rotations[1])), _QUADROTOR.inertia[0, 0]
    window = slice(250, 750)  # the fast mode has decayed, the sine is still linear
    measured = np.polyfit(times[window], np.log(short[window]), 1)[0]
    predicted = (np.sqrt(_GAINS.rate**2 + 4.0 * inertia * _GAINS.rotation) - _GAINS.rate) / (2.0 * inertia)
    return Row("rate of escape from the antipode", float(predicted), float(measured), 1e-3 * float(predicted), "1/s")


def _lyapunov(times: Array, rotations: Array, rates: Array) -> tuple[Row, Row]:
    """Check that ``1/2 Omega^T J Omega + k_R Psi`` has the derivative ``-k_Omega |Omega|^2``."""
    psi = 0.5 * (3.0 - np.trace(rotations, axis1=-2, axis2=-1))
    energy = 0.5 * np.sum(rates * (rates @ _QUADROTOR.inertia), axis=-1) + _GAINS.rotation * psi
    rise = float(max(np.diff(energy, axis=1).max(), 0.0))
    return (
        Row(f"Psi {times[-1]:g} s after a start at exactly 180 deg", 2.0, float(psi[2, -1]), 0.0),
        Row("largest rise of the Lyapunov function", 0.0, rise, 1e-12, "J"),
    )


def _tracking() -> tuple[Row, Panel]:
    """Check the feed-forward: the error from a start on the trajectory with its attitude and rate stays zero."""
    controller, time = quadrotor.GeometricController(_QUADROTOR, quadrotor.lissajous()), ca.SX.sym("time")
    position = ca.SX(controller.reference(time)[0])
    curve = ca.Function("curve", [time], [position, ca.jacobian(position, time)])
    place, speed = (value.full().ravel() for value in curve(0.0))
    # The first iteration determines the attitude from the acceleration, the second the rate from the jerk.
    rotation, rate = np.eye(3), np.zeros(3)
    for _ in range(3):
        _, rotation, rate, _ = (value.full() for value in controller.command(0.0, place, speed, rotation, rate))
    twist = np.concatenate((rotation.T @ speed, rate.ravel()))
    system, pose = _QUADROTOR.system(controller), se3.from_parts(rotation, place)
    motion = system.simulate(pose, twist, pose.T @ HEIGHT, step=4e-3, steps=750)
    flown, goal = motion.poses[:, :3, 3], curve.map(len(motion.times))(motion.times[None])[0].full().T
    curves = (Curve("flown", flown[:, 0], flown[:, 1]), Curve("desired", goal[:, 0], goal[:, 1], True))
    panel = Panel("On a trajectory, from above", "x, m", "y, m", curves, equal=True)
    return Row("distance from the trajectory in 3 s", 0.0, largest(flown - goal), 1e-8, "m"), panel


def _flights(controller: quadrotor.Controller) -> _Flights:
    """Simulate the tumbling starts."""
    omega = np.random.default_rng(0).normal(size=(_STARTS, 3))
    omega *= _TUMBLE / np.linalg.norm(omega, axis=1, keepdims=True)
    rotations = Rotation.random(_STARTS, random_state=2).as_matrix()
    system, poses, ends = _REAL.system(_UntilLost(controller)), [], []
    for pose, rate in zip(se3.from_parts(rotations, _GOAL), omega, strict=True):
        twist = np.concatenate((np.zeros(3), rate))
        motion = system.simulate(pose, twist, pose.T @ HEIGHT, step=_STEP, steps=round(_DURATION / _STEP))
        fast = np.linalg.norm(motion.velocities[:, 3:], axis=1) >= _FASTEST
        end = int(np.argmax(fast)) if fast.any() else len(fast)
        poses.append(motion.poses[np.minimum(np.arange(len(fast)), end - 1)])
        ends.append(end)
    return _Flights(motion.times, np.array(poses), np.array(ends))


def _vehicle(name: str, poses: Array, aside: float, color: int) -> Body:
    """Return the scene's vehicle: four rotors on a cross."""
    arm, rotors = 0.3, [(x, y) for x in (-0.22, 0.22) for y in (-0.22, 0.22)]
    turn = so3.exp(np.array([0.0, 0.0, 0.25 * np.pi]))
    shapes = [
        Shape("sphere", (0.08, 0.08, 0.06), color=color),
        Shape("box", (2.0 * arm, 0.05, 0.03), color=0x34414F, rotation=turn),
        Shape("box", (0.05, 2.0 * arm, 0.03), color=0x34414F, rotation=turn),
        *[Shape("cylinder", (0.13, 0.13, 0.015), (x, y, 0.04), color, 0.85) for x, y in rotors],
    ]
    return Body(name, tuple(shapes), poses[:, :3, 3] + [0.0, aside, 0.0], poses[:, :3, :3])
