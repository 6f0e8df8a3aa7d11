"""A multirotor flies through waypoints, at some of them in given attitudes, such as upside down, and ends at rest.

Attitudes are given as rotation vectors, which may be longer than half a turn: ``[0, -180, 0]`` and then
``[0, -360, 0]`` is a loop, nose up, while the second alone would be the attitude of the start. The cost depends
on the attitudes only, as matrices, and has no branch at any angle; the vectors set the guess's sense of rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.actions import Integrator, MultibodyAction, RungeKutta4
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameRotationMatrix, FrameTranslation, FrameVelocity
from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.attitude import angle_between, rotation_of, tilt
from lgmpc.problems.multirotor import Multirotor, MultirotorSettings, thrust_figures, turning_guess
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot

__all__ = ["FlightSettings", "FlightWaypoint", "FlightWeights", "build_flight"]


@dataclass(frozen=True)
class FlightWaypoint:
    """Where to be, when.

    Attributes:
        name: shown to the user.
        time: s; a multiple of the nodes' duration.
        position: (3,) of the body, world axes, m.
        rotation_deg: (3,) its attitude as a rotation vector, degrees (see the module); none if any will do.
    """

    name: str
    time: float
    position: tuple[float, float, float]
    rotation_deg: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class FlightWeights:
    """Weights of the cost; those of ``speed`` and ``thrust`` are per second.

    Attributes:
        position: from a waypoint, 1/m2.
        rotation: from a waypoint's attitude, 1/rad2 for small angles.
        rest: velocity at the end, 1/(m/s)2 and 1/(rad/s)2.
        speed: velocity on the way, 1/(m/s)2 and 1/(rad/s)2.
        thrust: of each rotor from hovering, 1/N2.
    """

    position: float = 1e3
    rotation: float = 1e3
    rest: float = 1e2
    speed: float = 1e-2
    thrust: float = 1e-2


@dataclass(frozen=True)
class FlightSettings:
    """The vehicle, its way and the grid.

    Attributes:
        rotors: of the vehicle.
        start: (3,) where it hovers at first, level, world axes, m.
        waypoints: in the order of their times; at the last it comes to rest.
        node_duration: length of each interval, s.
        integrator: of the motion; Runge and Kutta's unless given. In a loop at up to 10 rad/s and 30 ms a step it ends
            within 1 mm of the exact motion, semi-implicit Euler's method metres away, and one body's stage is so small
            that four evaluations cost microseconds.
        weights: of the cost.
    """

    rotors: MultirotorSettings
    start: tuple[float, float, float]
    waypoints: tuple[FlightWaypoint, ...]
    node_duration: float = 0.03
    integrator: Integrator = RungeKutta4()
    weights: FlightWeights = FlightWeights()


def build_flight(robot: Robot, settings: FlightSettings) -> Scenario:
    """Return the problem for a vehicle that hovers at the start; its thrusts are bounds on the controls.

    Figures: ``waypoint_error_m``, the largest; ``waypoint_rotation_error_deg``, the largest where an attitude is given;
    ``inverted_tilt_deg``, the largest tilt of those waypoints, 180 if it is upside down there; ``final_error_m``,
    ``final_tilt_deg`` and ``final_speed_m_s``; and those of :func:`lgmpc.problems.multirotor.thrust_figures`.

    Raises:
        InputError: a robot that is no vehicle of these rotors, or waypoints that are not ahead of each other on the
            grid.
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
    problem = ShootingProblem(MultibodyAction("flight", vehicle.dynamics, costs, [bounds], s.integrator), n)
    problem.set("duration", s.node_duration)
    for k, waypoint in zip(nodes, s.waypoints, strict=True):
        # Running costs are multiplied by the duration; a waypoint counts as much wherever it is.
        scale = 1.0 if k == n else 1.0 / s.node_duration
        problem.set("position_reference", waypoint.position, [k])
        problem.set("position_weight", scale * w.position, [k])
        if waypoint.rotation_deg is not None:
            rotation = so3.exp(np.radians(waypoint.rotation_deg))
            problem.set("rotation_reference", pin.Quaternion(rotation).coeffs(), [k])
            problem.set("rotation_weight", scale * w.rotation, [k])
    problem.set("velocity_weight", w.rest, [n])
    problem.set_initial_state(np.concatenate([s.start, [0.0, 0.0, 0.0, 1.0], np.zeros(6)]))
    durations = np.full(n, s.node_duration)
    marks = tuple(
        Waypoint(
            point.name,
            point.time,
            np.array(point.position),
            None if point.rotation_deg is None else so3.exp(np.radians(point.rotation_deg)),
        )
        for point in s.waypoints
    )

    def figures(trajectory: Trajectory) -> dict[str, float]:
        there, end = trajectory.xs[list(nodes)], trajectory.xs[-1]
        distance = [float(np.linalg.norm(x[:3] - mark.position)) for x, mark in zip(there, marks, strict=True)]
        held = [(x, mark.rotation) for x, mark in zip(there, marks, strict=True) if mark.rotation is not None]
        turned = [angle_between(rotation_of(x), rotation) for x, rotation in held]
        tilted = [tilt(x) for x, _ in held]
        return {
            "waypoint_error_m": max(distance),
            "waypoint_rotation_error_deg": float(np.degrees(max(turned, default=0.0))),
            "inverted_tilt_deg": float(np.degrees(max(tilted, default=0.0))),
            "final_error_m": distance[-1],
            "final_tilt_deg": float(np.degrees(tilt(end))),
            "final_speed_m_s": float(np.linalg.norm(end[7:10])),
            **thrust_figures(vehicle, trajectory, durations),
        }

    places = [(0.0, s.start), *((p.time, p.position) for p in s.waypoints)]
    turns = [(0.0, (0.0, 0.0, 0.0)), *((p.time, p.rotation_deg) for p in s.waypoints if p.rotation_deg is not None)]
    guess = turning_guess(vehicle, durations, places, turns)
    return Scenario("flight", robot, problem, guess, durations, figures, waypoints=marks, controls=vehicle.controls)


def _nodes(s: FlightSettings) -> tuple[int, ...]:
    """The node of each waypoint."""
    if not s.waypoints:
        raise InputError("waypoints", "none", "at least one")
    if not s.node_duration > 0.0:
        raise InputError("node_duration", s.node_duration, "above 0 s")
    found, last = [], 0
    for waypoint in s.waypoints:
        node = round(waypoint.time / s.node_duration)
        if not abs(node * s.node_duration - waypoint.time) < 1e-6:
            expected = f"a multiple of the intervals' length, {s.node_duration:g} s"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time:g} s", expected)
        if node <= last:
            expected = f"later than {last * s.node_duration:g} s, the one before"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time:g} s", expected)
        found.append(node)
        last = node
    return tuple(found)
