"""Multirotors: dynamics, hovering thrusts, an initial guess, an independent simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from lgmpc.actions import FreeForwardDynamics, thrusters
from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.ocp import Trajectory
from lgmpc.problems.scenario import Controls
from lgmpc.robot import Robot
from lgmpc.settings import Finite, Positive, Settings, problem
from lgmpc.typing import GRAVITY, Array

__all__ = ["Multirotor", "MultirotorSettings", "flown", "thrust_figures", "turning_guess"]

Vector = tuple[float, float, float]


class MultirotorSettings(Settings):
    """Properties of rotors that a URDF does not contain; thrusts act along the positive z axes of the frames."""

    frames: tuple[str, ...] = Field(min_length=1, description="Names of the rotors' frames.")
    turning: tuple[Literal["ccw", "cw"], ...] = Field(
        description="Sense of rotation of each rotor from above; its drag moment on the body is opposite."
    )
    max_thrust_n: Positive = Field(description="Largest thrust of each rotor, N.")
    drag_ratio_m: Finite = Field(default=0.0, ge=0.0, description="Moment about its axis per thrust, m.")

    @model_validator(mode="after")
    def _one_sense_each(self) -> MultirotorSettings:
        if len(self.turning) != len(self.frames):
            raise problem(f"{len(self.frames)} of ccw and cw, one a frame", key="turning", got=list(self.turning))
        return self


@dataclass(frozen=True, eq=False)
class Multirotor:
    """A free body with rotors.

    Attributes:
        robot: one free body.
        dynamics: u = thrusts of the rotors, N.
        hover: (nu,) thrusts that balance gravity in level attitude, N.
        max_thrust: largest thrust of each rotor, N.
        body: name of the frame of its body.
        rotors: names of the rotors' frames.
    """

    robot: Robot
    dynamics: FreeForwardDynamics
    hover: Array
    max_thrust: float
    body: str
    rotors: tuple[str, ...]

    @classmethod
    def of(cls, robot: Robot, settings: MultirotorSettings) -> Multirotor:
        """Return the multirotor of a robot and its rotors.

        Raises:
            InputError: a robot with joints or a fixed base, an unknown frame, or rotors that cannot hover level.
        """
        if not robot.floating_base or robot.nu:
            raise InputError("robot", f"{robot.name}, {robot.nv} degrees of freedom", "a single free body")
        data = robot.create_data()
        neutral = pin.neutral(robot.model)
        pin.framesForwardKinematics(robot.model, data, neutral)
        places = [data.oMf[robot.frame(name, f"rotors.frames.{i}")] for i, name in enumerate(settings.frames)]
        drag = settings.drag_ratio_m * np.array([-1.0 if sense == "ccw" else 1.0 for sense in settings.turning])
        actuation = thrusters(
            robot.model, [place.translation for place in places], [place.rotation[:, 2] for place in places], drag
        )
        weight = pin.computeGeneralizedGravity(robot.model, data, neutral)
        hover = np.linalg.lstsq(actuation, weight, rcond=None)[0]
        held = np.allclose(actuation @ hover, weight, rtol=0.0, atol=1e-6 * robot.mass * GRAVITY)
        if not (held and (hover > 0.0).all() and (hover < settings.max_thrust_n).all()):
            expected = f"above {hover.max():.3g} N" if held else "rotors about the centre of mass"
            raise InputError("rotors.max_thrust_n", settings.max_thrust_n, f"{expected}, to hold {robot.name} level")
        dynamics = FreeForwardDynamics(robot.model, actuation)
        return cls(robot, dynamics, hover, settings.max_thrust_n, robot.body_names[0], tuple(settings.frames))

    @property
    def controls(self) -> Controls:
        """The thrusts, by the names of the rotors' frames, N."""
        most = np.full(len(self.rotors), self.max_thrust)
        return Controls(self.rotors, "N", np.zeros_like(most), most)


def turning_guess(
    vehicle: Multirotor, durations: Array, places: Sequence[tuple[float, Vector]], turns: Sequence[tuple[float, Vector]]
) -> Trajectory:
    """Return a guess that interpolates positions and rotation vectors linearly, with hovering thrusts.

    Its velocities are those of this motion, its thrusts are not: the guess has gaps. Attitudes are rotation vectors,
    which may be longer than half a turn: from [0, 0, 0] by [0, -180, 0] to [0, -360, 0] is a loop, nose up.

    Args:
        vehicle: the multirotor.
        durations: (N,) durations of the intervals, s.
        places: increasing times, s, and positions, world axes, m.
        turns: increasing times, s, and rotation vectors, degrees.
    """
    n, model = len(durations), vehicle.robot.model
    times = np.concatenate([[0.0], np.cumsum(durations)])
    xs = np.zeros((n + 1, 13))
    xs[:, :3] = _between(times, places)
    xs[:, 3:7] = [pin.Quaternion(so3.exp(turn)).coeffs() for turn in np.radians(_between(times, turns))]
    for k in range(n):
        xs[k, 7:] = pin.difference(model, xs[k, :7], xs[k + 1, :7]) / durations[k]
    return Trajectory(xs, np.tile(vehicle.hover, (n, 1)))


def _between(times: Array, points: Sequence[tuple[float, Vector]]) -> Array:
    known = [time for time, _ in points]
    return np.column_stack([np.interp(times, known, [point[i] for _, point in points]) for i in range(3)])


def flown(vehicle: Multirotor, x0: Array, us: Array, durations: Array) -> Array:
    """Return (13,) the final state of a simulation of given thrusts, by methods independent of the solvers'.

    Pinocchio's accelerations, the quaternion's differential equation and the Dormand-Prince method of order 8; the
    action uses none of these.

    Args:
        vehicle: the multirotor.
        x0: (13,) first state.
        us: (N, nu) thrusts, each constant over its interval, N.
        durations: (N,) s.
    """
    from scipy.integrate import solve_ivp  # here, because it takes longer to import than all problems

    model, data = vehicle.robot.model, vehicle.robot.create_data()
    actuation = np.asarray(vehicle.dynamics.actuation.full())

    def rate(_: float, x: Array, wrench: Array) -> Array:
        q = np.concatenate([x[:3], x[3:7] / np.linalg.norm(x[3:7])])
        turn = pin.Quaternion(q[3:])
        spin = turn * pin.Quaternion(np.append(x[10:13], 0.0))
        return np.concatenate([turn * x[7:10], spin.coeffs() / 2.0, pin.aba(model, data, q, x[7:], wrench)])

    x = np.array(x0)
    for u, duration in zip(us, durations, strict=True):
        done = solve_ivp(rate, (0.0, duration), x, "DOP853", rtol=1e-9, atol=1e-9, args=(actuation @ u,))
        x = done.y[:, -1]
        x[3:7] /= np.linalg.norm(x[3:7])
    return x


def thrust_figures(vehicle: Multirotor, trajectory: Trajectory, durations: Array) -> dict[str, float]:
    """Return the common figures of all flights.

    ``least_thrust_ratio`` and ``peak_thrust_ratio``: of the largest thrust. ``integration_error_m`` and
    ``integration_error_deg``: distance of the last state from that of an independent simulation (:func:`flown`).
    """
    ratio = trajectory.us / vehicle.max_thrust
    truth, end = flown(vehicle, trajectory.xs[0], trajectory.us, durations), trajectory.xs[-1]
    turned = pin.Quaternion(truth[3:7]).angularDistance(pin.Quaternion(end[3:7]))
    return {
        "least_thrust_ratio": float(ratio.min()),
        "peak_thrust_ratio": float(ratio.max()),
        "integration_error_m": float(np.linalg.norm(truth[:3] - end[:3])),
        "integration_error_deg": float(np.degrees(turned)),
    }
