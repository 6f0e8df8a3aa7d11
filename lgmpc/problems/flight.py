"""A multirotor flies from any attitude through waypoints, at some of them in given attitudes, and ends at rest.

Attitudes are given as rotation vectors, which may be longer than half a turn: ``[0, -180, 0]`` followed by
``[0, -360, 0]`` is a loop, nose up, while the second alone would be the initial attitude. The problem has no
singularity at any attitude: gaps are differences on SE(3), logarithms of the small rotation from one node to the next
only, and the cost is a function of rotation matrices (:class:`FrameRotationMatrix`), which is smooth at rotation pi.
The vectors determine the sense of rotation of the initial guess. In roll, pitch and yaw a recovery from a tumble jumps
at pitch 90 degrees, and in the rotation vector from its goal at rotation pi.
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
    """Weights of the cost; those of approach, speed and thrust are per second of the horizon."""

    approach: NonNegative = Field(
        default=0.0, description="From the last waypoint's position and attitude, before it, 1/m2 and 1/rad2."
    )
    position: Positive = Field(default=1e3, description="From a waypoint, 1/m2.")
    rotation: Positive = Field(default=1e3, description="From a waypoint's attitude, 1/rad2 for small angles.")
    rest: NonNegative = Field(default=1e2, description="Velocity at the end, 1/(m/s)2 and 1/(rad/s)2.")
    speed: NonNegative = Field(default=1e-2, description="Velocity before the end, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = Field(default=1e-2, description="Thrust of each rotor from hovering, 1/N2.")


class FlightSettings(ProblemSettings):
    """A multirotor flies through waypoints and comes to rest at the last; thrusts are bounded."""

    kind: Literal["flight"] = Field(default="flight", description="A multirotor flies through waypoints.")
    rotors: MultirotorSettings = Field(description="The rotors, at frames of the URDF.")
    start_m: Vector3 = Field(description="[x, y, z] of the body at first, world axes, m.")
    start_rotation_deg: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Attitude at first as a rotation vector (axis times angle), degrees."
    )
    start_velocity_m_s: Vector3 = Field(default=(0.0, 0.0, 0.0), description="Velocity at first, body axes, m/s.")
    start_rate_rad_s: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Angular velocity at first, body axes, rad/s."
    )
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
    """Return the problem; thrust limits are bounds on the controls.

    Figures: ``waypoint_error_m``, the largest; ``waypoint_rotation_error_deg``, the largest where an attitude is given;
    ``inverted_tilt_deg``, the largest tilt of those waypoints, 180 if it is upside down there; ``final_error_m``,
    ``final_tilt_deg``, ``final_speed_m_s`` and ``final_rate_rad_s``; ``height_lost_m``, the largest below the start;
    ``attitude_step_deg``, the largest rotation from a node to the next, and the same motion in two charts:
    ``rpy_jump_deg``, the largest change of roll, pitch or yaw, whole turns not counted (180 where pitch passes 90
    degrees), and ``log_jump_deg``, that of the rotation vector from the last attitude given (360 where the rotation
    passes pi); and those of :func:`lgmpc.problems.multirotor.thrust_figures`.

    Raises:
        InputError: a robot without these rotors, or waypoints whose times do not increase on the grid, or are
            too late.
    """
    s, w = settings, settings.weights
    vehicle = Multirotor.of(robot, s.rotors)
    nodes = _nodes(s)
    n, nu = nodes[-1], len(vehicle.hover)
    turns = [(0.0, s.start_rotation_deg)]
    turns += [(p.time_s, p.rotation_deg) for p in s.waypoints if p.rotation_deg is not None]
    goal = so3.exp(np.radians(turns[-1][1] if len(turns) > 1 else (0.0, 0.0, 0.0)))
    costs = [
        CostItem("position", FrameTranslation(vehicle.body, s.waypoints[-1].position_m), w.approach),
        CostItem("rotation", FrameRotationMatrix(vehicle.body, pin.Quaternion(goal).coeffs()), w.approach),
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
    begun = pin.Quaternion(so3.exp(np.radians(s.start_rotation_deg))).coeffs()
    problem.set_initial_state(np.concatenate([s.start_m, begun, s.start_velocity_m_s, s.start_rate_rad_s]))
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
        rotations = so3.from_quaternion.unchecked(trajectory.xs[:, 3:7])
        held = [(rotations[k], m.rotation) for k, m in zip(nodes, marks, strict=True) if m.rotation is not None]
        rpy, logs = attitude.roll_pitch_yaw(rotations), np.degrees([pin.log3(goal.T @ r) for r in rotations])
        wrapped = (np.diff(rpy, axis=0) + np.pi) % (2.0 * np.pi) - np.pi
        turned = [float(attitude.angle_between(r, wanted)) for r, wanted in held]
        tilted = [float(attitude.tilt(r)) for r, _ in held]
        return {
            "waypoint_error_m": max(distance),
            "waypoint_rotation_error_deg": float(np.degrees(max(turned, default=0.0))),
            "inverted_tilt_deg": float(np.degrees(max(tilted, default=0.0))),
            "final_error_m": distance[-1],
            "final_tilt_deg": float(np.degrees(attitude.tilt(rotations[-1]))),
            "final_speed_m_s": float(np.linalg.norm(end[7:10])),
            "final_rate_rad_s": float(np.linalg.norm(end[10:])),
            "height_lost_m": float(max(s.start_m[2] - trajectory.xs[:, 2].min(), 0.0)),
            "attitude_step_deg": float(np.degrees(attitude.angle_between(rotations[:-1], rotations[1:]).max())),
            "rpy_jump_deg": float(np.degrees(np.abs(wrapped).max())),
            "log_jump_deg": float(np.linalg.norm(np.diff(logs, axis=0), axis=1).max()),
            **thrust_figures(vehicle, trajectory, durations),
        }

    places = [(0.0, s.start_m), *((p.time_s, p.position_m) for p in s.waypoints)]
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
