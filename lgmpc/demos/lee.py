"""Geometric control of a quadrotor, compared with theory and with an Euler-angle PID.

Chapter 4.12.3; Lee, Leok and McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape
from lgmpc.lie import so3
from lgmpc.mechanics.quadrotor import (
    AttitudeCommand,
    EulerAnglePid,
    Flight,
    GeometricController,
    GeometricGains,
    Hover,
    Lissajous,
    Quadrotor,
    QuadrotorState,
    attitude_error,
    fly,
)
from lgmpc.typing import Array

__all__ = ["run"]

_QUADROTOR = Quadrotor.of_the_paper()
_REAL = _QUADROTOR.limited(lift=2.5, moment=20.0)
_GAINS = GeometricGains.of_the_paper()
_GOAL = Hover((0.0, 0.0, 3.0))
_STARTS, _TUMBLE, _DURATION = 60, 20.0, 7.0  # rad/s, s
_OURS, _THEIRS = 0x0072B2, 0xD55E00


@dataclass(frozen=True)
class _TurnOnly:
    """The attitude controller alone, towards the identity, without thrust."""

    geometric: GeometricController

    def control(self, time: float, state: QuadrotorState) -> tuple[Array, Array]:
        still = np.zeros_like(state.rate)
        upright = AttitudeCommand(np.broadcast_to(np.eye(3), state.rotation.shape), still, still)
        return np.zeros(state.rate.shape[:-1]), self.geometric.moment(state, upright)


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    turning = _turning()
    pendulum, swing = _pendulum(turning)
    tracking, path = _tracking()
    start = _tumbling()
    ours = fly(_REAL, GeometricController(_REAL, _GOAL), start, _DURATION, 8e-3)
    theirs = fly(_REAL, EulerAnglePid(_REAL, _GOAL), start, _DURATION, 8e-3)
    back = [int(np.sum(~f.lost & (_away(f)[-1] < 0.1))) for f in (ours, theirs)]
    rows = (
        pendulum,
        _growth(turning),
        *_lyapunov(turning),
        tracking,
        Row(f"not lost, of {_STARTS} tumbling starts", _STARTS, float(_STARTS - ours.lost.sum()), 0.0),
    )
    # The scene shows a start that the Euler-angle controller loses, if there is one.
    shown = int(np.argmax(theirs.lost))
    panels = (
        swing,
        path,
        Panel(
            f"Distance from the goal, start {shown + 1}",
            "time, s",
            "m",
            (
                Curve("geometric", *_until_lost(ours, shown)),
                Curve("Euler angles, until lost", *_until_lost(theirs, shown)),
            ),
        ),
    )
    every = slice(None, 500, 4)
    bodies = (
        _vehicle("geometric", ours, shown, every, -0.8, _OURS),
        _vehicle("Euler angles", theirs, shown, every, 0.8, _THEIRS),
    )
    remarks = (
        f"From {_STARTS} random attitudes, tumbling at {_TUMBLE:g} rad/s: {back[0]} are back in {_DURATION:g} s"
        f" with the geometric controller, {back[1]} with Euler angles, which lose {int(theirs.lost.sum())}.",
        "Half a turn is an unstable equilibrium of the geometric controller; near it the recovery starts slowly.",
    )
    return Outcome(rows, panels, ours.times[every], bodies, (), remarks)


def _turning() -> Flight:
    """Simulate rotations to the identity: from 178 deg of roll, 1e-6 rad off half a turn, half a turn, any attitude."""
    rolls = so3.exp(np.array([[np.radians(178.0), 0.0, 0.0], [np.pi - 1e-6, 0.0, 0.0]]))
    random = Rotation.random(20, random_state=4).as_matrix()
    starts = QuadrotorState.at_rest(np.concatenate((rolls, np.diag([1.0, -1.0, -1.0])[None], random)))
    return fly(_QUADROTOR, _TurnOnly(GeometricController(_QUADROTOR, Hover())), starts, 3.0, 2e-3)


def _pendulum(flight: Flight) -> tuple[Row, Panel]:
    """Compare with a damped pendulum about a principal axis: ``J theta'' = -k_R sin theta - k_Omega theta'``."""
    exact = solve_ivp(
        lambda _, y: [y[1], (-_GAINS.rotation * np.sin(y[0]) - _GAINS.rate * y[1]) / _QUADROTOR.inertia[0, 0]],
        (0.0, flight.times[-1]),
        [np.radians(178.0), 0.0],
        "DOP853",
        flight.times,
        rtol=1e-13,
        atol=1e-13,
    ).y[0]
    angle = np.unwrap(_roll(flight, 0))
    row = Row("178 deg of roll, off the pendulum", 0.0, float(np.abs(angle - exact).max()), 1e-8, "rad")
    curves = (
        Curve("controlled body", flight.times, np.degrees(angle)),
        Curve("pendulum", flight.times, np.degrees(exact), True),
    )
    return row, Panel("Recovery from 178 deg", "time, s", "roll, deg", curves)


def _roll(flight: Flight, index: int) -> Array:
    r = flight.states.rotation[:, index]
    angle: Array = np.arctan2(r[:, 2, 1], r[:, 2, 2])
    return angle


def _growth(flight: Flight) -> Row:
    """Compare with the linearisation at the antipode: ``J delta'' = k_R delta - k_Omega delta'``."""
    short, inertia = np.pi - np.abs(_roll(flight, 1)), _QUADROTOR.inertia[0, 0]
    window = slice(250, 750)  # the fast mode has decayed, the sine is still linear
    measured = np.polyfit(flight.times[window], np.log(short[window]), 1)[0]
    predicted = (np.sqrt(_GAINS.rate**2 + 4.0 * inertia * _GAINS.rotation) - _GAINS.rate) / (2.0 * inertia)
    return Row("rate of escape from the antipode", float(predicted), float(measured), 1e-3 * float(predicted), "1/s")


def _lyapunov(flight: Flight) -> tuple[Row, Row]:
    """Check that ``1/2 Omega^T J Omega + k_R Psi`` has the derivative ``-k_Omega |Omega|^2``."""
    psi, _ = attitude_error(flight.states.rotation, np.eye(3))
    omega = flight.states.rate
    energy = 0.5 * np.sum(omega * (omega @ _QUADROTOR.inertia), axis=-1) + _GAINS.rotation * psi
    rise = float(max(np.diff(energy, axis=0).max(), 0.0))
    return (
        Row(f"Psi {flight.times[-1]:g} s after a start at exactly 180 deg", 2.0, float(psi[-1, 2]), 0.0),
        Row("largest rise of the Lyapunov function", 0.0, rise, 1e-12, "J"),
    )


def _tracking() -> tuple[Row, Panel]:
    """Check the feed-forward: the error from a start on the trajectory with its attitude and rate stays zero."""
    curve = Lissajous()
    controller = GeometricController(_QUADROTOR, curve)
    desired = curve.at(0.0).position
    state = QuadrotorState(desired[0], desired[1], np.eye(3), np.zeros(3))
    # The first iteration determines the attitude from the acceleration, the second the rate from the jerk.
    for _ in range(3):
        command = controller.command(0.0, state)
        state = QuadrotorState(desired[0], desired[1], command.rotation, command.rate)
    flight = fly(_QUADROTOR, controller, state, 3.0, 4e-3)
    goal = np.array([curve.at(float(t)).position[0] for t in flight.times])
    error = float(np.abs(flight.states.position - goal).max())
    position = flight.states.position
    curves = (Curve("flown", position[:, 0], position[:, 1]), Curve("desired", goal[:, 0], goal[:, 1], True))
    panel = Panel("On a trajectory, from above", "x, m", "y, m", curves, equal=True)
    return Row("distance from the trajectory in 3 s", 0.0, error, 1e-8, "m"), panel


def _tumbling() -> QuadrotorState:
    rng = np.random.default_rng(0)
    omega = rng.normal(size=(_STARTS, 3))
    omega *= _TUMBLE / np.linalg.norm(omega, axis=1, keepdims=True)
    rotations = Rotation.random(_STARTS, random_state=2).as_matrix()
    return QuadrotorState(np.tile(_GOAL.point, (_STARTS, 1)), np.zeros((_STARTS, 3)), rotations, omega)


def _away(flight: Flight) -> Array:
    distance: Array = np.linalg.norm(flight.states.position - _GOAL.point, axis=-1)
    return distance


def _until_lost(flight: Flight, index: int) -> tuple[Array, Array]:
    """Return times and distances until a vehicle is lost."""
    still = np.all(np.diff(flight.states.position[:, index], axis=0) == 0.0, axis=1)
    end = int(np.argmax(still)) + 1 if flight.lost[index] else len(flight.times)
    return flight.times[:end], _away(flight)[:end, index]


def _vehicle(name: str, flight: Flight, index: int, every: slice, aside: float, color: int) -> Body:
    """Return the scene's vehicle: four rotors on a cross."""
    arm, rotors = 0.3, [(x, y) for x in (-0.22, 0.22) for y in (-0.22, 0.22)]
    turn = so3.exp(np.array([0.0, 0.0, 0.25 * np.pi]))
    shapes = [
        Shape("sphere", (0.08, 0.08, 0.06), color=color),
        Shape("box", (2.0 * arm, 0.05, 0.03), color=0x34414F, rotation=turn),
        Shape("box", (0.05, 2.0 * arm, 0.03), color=0x34414F, rotation=turn),
        *[Shape("cylinder", (0.13, 0.13, 0.015), (x, y, 0.04), color, 0.85) for x, y in rotors],
    ]
    positions = flight.states.position[every, index] + [0.0, aside, 0.0]
    return Body(name, tuple(shapes), positions, flight.states.rotation[every, index])
