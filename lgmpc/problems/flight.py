"""A multirotor flies through waypoints, at some of them in given attitudes, such as upside down, and ends at rest.

Attitudes are given as rotation vectors, which may be longer than half a turn: ``[0, -180, 0]`` followed by
``[0, -360, 0]`` is a loop, nose up, while the second alone would be the initial attitude. The cost depends on the
rotation matrices, without singularity at any angle; the vectors determine the sense of rotation of the initial guess.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import MultibodyAction, RungeKutta4, SemiImplicitEuler
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameRotationMatrix, FrameTranslation, FrameVelocity
from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.lie.checks import typed
from lgmpc.locomotion.sequence import MOST_INTERVALS
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.multirotor import Multirotor, MultirotorSettings, thrust_figures, turning_guess
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.settings import Interval, NonNegative, Positive, Settings, Vector3

__all__ = ["FlightSettings", "FlightWaypoint", "FlightWeights", "build_flight"]

_INTEGRATORS = {"rk4": RungeKutta4, "semi_implicit_euler": SemiImplicitEuler}


class FlightWaypoint(Settings):
    """A position and, if given, an attitude at a time."""

    name: str = Field(min_length=1, description="Name in the replay.")
    time_s: Positive = Field(description="Time, s; a multiple of problem.node_s.")
    position_m: Vector3 = Field(description="[x, y, z] of the body, world axes, m.")
    rotation_deg: Vector3 | None = Field(
        default=None,
        description="Attitude as a rotation vector (axis times angle), degrees; null: any. More than half a turn gives "
        "the solver's guess its direction: [0, -180, 0] and then [0, -360, 0] is a loop, nose up.",
    )


class FlightWeights(Settings):
    """Weights of the cost; those of speed and thrust are per second of the horizon."""

    position: Positive = Field(default=1e3, description="From a waypoint, 1/m2.")
    rotation: Positive = Field(default=1e3, description="From a waypoint's attitude, 1/rad2 for small angles.")
    rest: NonNegative = Field(default=1e2, description="Velocity at the end, 1/(m/s)2 and 1/(rad/s)2.")
    speed: NonNegative = Field(default=1e-2, description="Velocity before the end, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = Field(default=1e-2, description="Thrust of each rotor from hovering, 1/N2.")


class FlightSettings(ProblemSettings):
    """A multirotor flies through waypoints and comes to rest at the last; thrusts are bounded."""

    kind: Literal["flight"] = Field(default="flight", description="A multirotor flies through waypoints.")
    rotors: MultirotorSettings = Field(description="The rotors, at frames of the URDF.")
    start_m: Vector3 = Field(description="[x, y, z] of the body, which hovers level at first, world axes, m.")
    waypoints: Annotated[tuple[FlightWaypoint, ...], Field(min_length=1)] = Field(
        description="In the order of their times."
    )
    node_s: Interval = Field(default=0.03, description="Length of each interval, s.")
    integrator: Literal["rk4", "semi_implicit_euler"] = Field(
        default="rk4",
        description="Integrator of the motion. Over a loop at up to 10 rad/s in steps of 30 ms, rk4 (Runge and Kutta's)"
        " ends within 1 mm of the exact motion, semi_implicit_euler metres away.",
    )
    weights: FlightWeights = Field(default=FlightWeights(), description="Weights of the cost.")


@typed
def build_flight(robot: Robot, settings: FlightSettings) -> Scenario:
    """Return the problem for a vehicle that hovers at the start; its thrust limits are bounds on the controls.

    Figures: ``waypoint_error_m``, the largest; ``waypoint_rotation_error_deg``, the largest where an attitude is given;
    ``inverted_tilt_deg``, the largest tilt of those waypoints, 180 if it is upside down there; ``final_error_m``,
    ``final_tilt_deg`` and ``final_speed_m_s``; and those of :func:`lgmpc.problems.multirotor.thrust_figures`.

    Raises:
        InputError: a robot without these rotors, or waypoints whose times do not increase on the grid, or are
            too late.
    """
    s, w = settings, settings.weights
    vehicle = Multirotor.of(robot, s.rotors)
    nodes = _nodes(s)
    n, nu = nodes[-1], len(vehicle.hover)
    costs = [
        CostItem("position", FrameTranslation(vehicle.body), 0.0),
        CostItem("rotation", FrameRotationMatrix(vehicle.body), 0.0),
        CostItem("velocity", FrameVelocity(vehicle.body), w.speed),
        CostItem("thrust", Control(nu, vehicle.hover), w.thrust),
    ]
    bounds = ConstraintItem("limits", Control(nu), 0.0, vehicle.max_thrust)
    problem = ShootingProblem(
        MultibodyAction("flight", vehicle.dynamics, costs, [bounds], _INTEGRATORS[s.integrator]()), n
    )
    problem.set("duration", s.node_s)
    for k, waypoint in zip(nodes, s.waypoints, strict=True):
        # Running costs are multiplied by the duration; the weight of a waypoint does not depend on its node.
        scale = 1.0 if k == n else 1.0 / s.node_s
        problem.set("position_reference", waypoint.position_m, [k])
        problem.set("position_weight", scale * w.position, [k])
        if waypoint.rotation_deg is not None:
            rotation = so3.exp(np.radians(waypoint.rotation_deg))
            problem.set("rotation_reference", pin.Quaternion(rotation).coeffs(), [k])
            problem.set("rotation_weight", scale * w.rotation, [k])
    problem.set("velocity_weight", w.rest, [n])
    problem.set_initial_state(np.concatenate([s.start_m, [0.0, 0.0, 0.0, 1.0], np.zeros(6)]))
    durations = np.full(n, s.node_s)
    marks = tuple(
        Waypoint(
            point.name,
            point.time_s,
            np.array(point.position_m),
            None if point.rotation_deg is None else so3.exp(np.radians(point.rotation_deg)),
        )
        for point in s.waypoints
    )

    def figures(trajectory: Trajectory) -> dict[str, float]:
        there, end = trajectory.xs[list(nodes)], trajectory.xs[-1]
        distance = [float(np.linalg.norm(x[:3] - mark.position)) for x, mark in zip(there, marks, strict=True)]
        rotations = so3.from_quaternion.unchecked(trajectory.xs[[*nodes, -1], 3:7])
        held = [(r, mark.rotation) for r, mark in zip(rotations, marks, strict=False) if mark.rotation is not None]
        turned = [float(attitude.angle_between(r, wanted)) for r, wanted in held]
        tilted = [float(attitude.tilt(r)) for r, _ in held]
        return {
            "waypoint_error_m": max(distance),
            "waypoint_rotation_error_deg": float(np.degrees(max(turned, default=0.0))),
            "inverted_tilt_deg": float(np.degrees(max(tilted, default=0.0))),
            "final_error_m": distance[-1],
            "final_tilt_deg": float(np.degrees(attitude.tilt(rotations[-1]))),
            "final_speed_m_s": float(np.linalg.norm(end[7:10])),
            **thrust_figures(vehicle, trajectory, durations),
        }

    places = [(0.0, s.start_m), *((p.time_s, p.position_m) for p in s.waypoints)]
    turns = [(0.0, (0.0, 0.0, 0.0)), *((p.time_s, p.rotation_deg) for p in s.waypoints if p.rotation_deg is not None)]
    guess = turning_guess(vehicle, durations, places, turns)
    return Scenario("flight", robot, problem, guess, durations, figures, waypoints=marks, controls=vehicle.controls)


def _nodes(s: FlightSettings) -> tuple[int, ...]:
    """Return the node of each waypoint."""
    found, last = [], 0
    for waypoint in s.waypoints:
        if waypoint.time_s > MOST_INTERVALS * s.node_s:
            expected = f"at most {MOST_INTERVALS * s.node_s:g} s: {MOST_INTERVALS} intervals of {s.node_s:g} s"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time_s:g} s", expected)
        node = round(waypoint.time_s / s.node_s)
        if not abs(node * s.node_s - waypoint.time_s) < 1e-6:
            expected = f"a multiple of the intervals' length, {s.node_s:g} s"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time_s:g} s", expected)
        if node <= last:
            expected = f"later than {last * s.node_s:g} s, the one before"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time_s:g} s", expected)
        found.append(node)
        last = node
    return tuple(found)
