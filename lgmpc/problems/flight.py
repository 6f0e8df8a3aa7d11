"""A multirotor flies from any attitude through waypoints, at some of them in given attitudes, and ends at rest.

Attitudes are given as rotation vectors, which may be longer than half a turn: ``[0, -180, 0]`` followed by
``[0, -360, 0]`` is a loop, nose up, while the second alone would be the initial attitude. The problem has no
singularity at any attitude: gaps are differences on SE(3), logarithms of the small rotation from one node to the next
only, and the cost is a function of rotation matrices (:class:`FrameRotationMatrix`), which is smooth at rotation pi.
The vectors determine the sense of rotation of the initial guess. In roll, pitch and yaw a recovery from a tumble jumps
at pitch 90 degrees, and in the rotation vector from its goal at rotation pi.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from lgmpc.actions import FreeForwardDynamics, MultibodyAction, RungeKutta4, thrusters
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameRotationMatrix, FrameTranslation, FrameVelocity
from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.locomotion.sequence import MOST_INTERVALS
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.scenario import Controls, ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.settings import Finite, Interval, NonNegative, Positive, Settings, Vector3, key, problem as problem_with
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import GRAVITY, Array, typed


class MultirotorSettings(Settings):
    """Properties of rotors that a URDF does not contain; thrusts act along the positive z axes of the frames."""

    frames: tuple[str, ...] = Field(min_length=1, description="Names of the rotors' frames.")
    turning: tuple[Literal["ccw", "cw"], ...] = Field(
        description="Sense of rotation of each rotor from above; its drag moment on the body is opposite."
    )
    max_thrust_n: Positive = Field(description="Largest thrust of each rotor, N.")
    drag_ratio_m: Finite = Field(default=0.0, ge=0.0, description="Moment about its axis per thrust, m.")

    @model_validator(mode="after")
    def _one_sense_each(self) -> "MultirotorSettings":
        if len(self.turning) != len(self.frames):
            raise problem_with(f"{len(self.frames)} of ccw and cw, one a frame", key="turning", got=list(self.turning))
        return self


class FlightWaypoint(Settings):
    """A position and, if given, an attitude at a time."""

    name: str = Field(min_length=1, description="Name in the replay.")
    time_s: Positive = Field(description="Time, s; a multiple of problem.node_s.")
    position_m: Vector3 = Field(description="[x, y, z] of the body, world axes, m.")
    rotation_deg: Vector3 | None = key(
        None,
        "Attitude as a rotation vector (axis times angle), degrees; null: any. More than half a turn gives "
        "the solver's guess its direction: [0, -180, 0] and then [0, -360, 0] is a loop, nose up.",
    )


class FlightWeights(Settings):
    """Weights of the cost; those of approach, speed and thrust are per second of the horizon."""

    approach: NonNegative = key(0.0, "From the last waypoint's position and attitude, before it, 1/m2 and 1/rad2.")
    position: Positive = key(1e3, "From a waypoint, 1/m2.")
    rotation: Positive = key(1e3, "From a waypoint's attitude, 1/rad2 for small angles.")
    rest: NonNegative = key(1e2, "Velocity at the end, 1/(m/s)2 and 1/(rad/s)2.")
    speed: NonNegative = key(1e-2, "Velocity before the end, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = key(1e-2, "Thrust of each rotor from hovering, 1/N2.")


class FlightSettings(ProblemSettings):
    """A multirotor flies through waypoints and comes to rest at the last; thrusts are bounded."""

    kind: Literal["flight"] = key("flight", "A multirotor flies through waypoints.")
    rotors: MultirotorSettings = Field(description="The rotors, at frames of the URDF.")
    start_m: Vector3 = Field(description="[x, y, z] of the body at first, world axes, m.")
    start_rotation_deg: Vector3 = key(
        (0.0, 0.0, 0.0), "Attitude at first, a rotation vector (axis times angle), degrees."
    )
    start_velocity_m_s: Vector3 = key((0.0, 0.0, 0.0), "Velocity at first, body axes, m/s.")
    start_rate_rad_s: Vector3 = key((0.0, 0.0, 0.0), "Angular velocity at first, body axes, rad/s.")
    waypoints: Annotated[tuple[FlightWaypoint, ...], Field(min_length=1)] = Field(
        description="In order of their times."
    )
    node_s: Interval = key(0.03, "Length of each interval, s.")
    weights: FlightWeights = key(FlightWeights(), "Weights of the cost.")


@typed
def build_flight(robot: Robot, settings: FlightSettings) -> Scenario:
    """Return the problem; thrust limits are bounds on the controls.

    Runge and Kutta's method integrates the motion: over a loop at up to 10 rad/s in steps of 30 ms it ends within 1 mm
    of the exact motion, the semi-implicit Euler method metres away.

    Figures: ``waypoint_error_m``, the largest; ``waypoint_rotation_error_deg``, the largest where an attitude is given;
    ``inverted_tilt_deg``, the largest tilt of those waypoints, 180 if it is upside down there; ``final_error_m``,
    ``final_tilt_deg``, ``final_speed_m_s`` and ``final_rate_rad_s``; ``height_lost_m``, the largest below the start;
    ``attitude_step_deg``, the largest rotation from a node to the next, and the same motion in two charts:
    ``rpy_jump_deg``, the largest change of roll, pitch or yaw, whole turns not counted (180 where pitch passes 90
    degrees), and ``log_jump_deg``, that of the rotation vector from the last attitude given (360 where the rotation
    passes pi); and those of :func:`thrust_figures`.

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
    problem = ShootingProblem(MultibodyAction("flight", vehicle.dynamics, costs, [bounds], RungeKutta4()), n)
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
        node = TimeGrid(s.node_s).nearest(waypoint.time_s)
        if not abs(node * s.node_s - waypoint.time_s) < 1e-6:
            expected = f"a multiple of the intervals' length, {s.node_s:g} s"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time_s:g} s", expected)
        if node <= last:
            expected = f"later than {last * s.node_s:g} s, the one before"
            raise InputError("waypoints", f"'{waypoint.name}' at {waypoint.time_s:g} s", expected)
        found.append(node)
        last = node
    return tuple(found)


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
    def of(cls, robot: Robot, settings: MultirotorSettings) -> "Multirotor":
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
    vehicle: Multirotor,
    durations: Array,
    places: Sequence[tuple[float, Vector3]],
    turns: Sequence[tuple[float, Vector3]],
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


def _between(times: Array, points: Sequence[tuple[float, Vector3]]) -> Array:
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
