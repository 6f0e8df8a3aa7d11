"""An arm moves a frame to a target and comes to rest there, within its motors' efforts."""

import math
from collections.abc import Sequence
from typing import Literal

import coal
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import FreeForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, library
from lgmpc.costs.activations import QuadraticBarrier
from lgmpc.errors import InputError
from lgmpc.lie import attitude
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.motion import frame_placements
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Box, CollisionShape, Robot, Sphere, place_shape
from lgmpc.robot.collision import AnyShape
from lgmpc.settings import Count, Interval, NonNegative, Positive, Settings, Vector3, key
from lgmpc.typing import Array, typed


class ReachWeights(Settings):
    """Weights of the cost; those of the running cost are per second of the horizon."""

    position: Positive = key(1e5, "Frame from its target at the end, 1/m2.")
    rotation: NonNegative = key(1e4, "Frame's rotation from its target at the end, 1/rad2.")
    rest: NonNegative = key(1e3, "Joint velocities at the end, 1/(rad/s)2.")
    posture: NonNegative = key(1.0, "Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = key(1.0, "Joint velocities, 1/(rad/s)2.")
    effort: Positive = key(1e-3, "Efforts from those that balance gravity, 1/(N.m)2.")
    limits: NonNegative = key(1e4, "Joints beyond their position and velocity limits, 1/rad2 and 1/(rad/s)2.")


class Clearance(Settings):
    """Two spheres or capsules, or a sphere and a box, that keep a distance."""

    first: AnyShape = Field(description="A shape on a frame of the robot; a sphere if the other one is a box.")
    second: AnyShape = Field(description="A shape on another link, or of the world (link: universe).")
    distance_m: NonNegative = key(0.02, "Least distance of their surfaces, m.")
    weight: Positive | None = key(
        None,
        "Weight of the squared shortfall of the distance in the cost, 1/m2. null: a hard constraint, for "
        "sqp, al_fddp, ipopt or fatrop.",
    )


class TargetSettings(ProblemSettings):
    """A frame of a robot and where it has to be at the end."""

    frame: str = Field(min_length=1, description="Name of the frame, such as a hand's.")
    position_m: Vector3 = Field(description="[x, y, z] of its origin at the end, world axes, m.")
    rpy_deg: Vector3 | None = key(
        None,
        "[roll, pitch, yaw] of the frame at the end, about the world's x, y, z in this order, degrees. "
        "null: any rotation.",
    )
    clearances: tuple[Clearance, ...] = key((), "Pairs of shapes that keep a distance.")

    @property
    def target(self) -> pin.SE3:
        """The placement at the end; without rotation if any is allowed."""
        turned = np.eye(3) if self.rpy_deg is None else pin.rpy.rpyToMatrix(*np.radians(self.rpy_deg))
        return pin.SE3(turned, np.array(self.position_m))

    def costs(self, name: str, position: float, rotation: float) -> list[CostItem]:
        """Return the costs of the frame's position and, if one is given, its rotation (``<name>_rotation``)."""
        found = [CostItem(name, library.FrameTranslation(self.frame, self.target.translation), position)]
        if self.rpy_deg is not None:
            quaternion = pin.Quaternion(self.target.rotation).coeffs()
            found.append(CostItem(f"{name}_rotation", library.FrameRotation(self.frame, quaternion), rotation))
        return found

    def figures(self, robot: Robot, xs: Array) -> dict[str, float]:
        """Return the errors at the end of states (n, nx), and the least distance of the pairs of shapes."""
        end, target = frame_placements(robot, self.frame, xs[-1:])[0], self.target
        found = {"position_error_m": float(np.linalg.norm(end.translation - target.translation))}
        if self.rpy_deg is not None:
            found["rotation_error_deg"] = math.degrees(attitude.angle_between(target.rotation, end.rotation))
        if self.clearances:
            found["clearance_m"] = least_clearance(robot, self.clearances, xs)
        return found

    def waypoint(self, time: float) -> Waypoint:
        """Return the target at a time, s, for the replay."""
        rotation = None if self.rpy_deg is None else self.target.rotation
        return Waypoint(self.frame, time, self.target.translation, rotation)


class ReachSettings(TargetSettings):
    """A robot with a fixed base moves a frame from its place in the reference posture to a target."""

    kind: Literal["reach"] = key("reach", "A frame reaches a target.")
    nodes: Count = key(100, "Number of intervals.")
    node_s: Interval = key(0.01, "Length of each interval, s.")
    weights: ReachWeights = key(ReachWeights(), "Weights of the cost.")


@typed
def build_reach(robot: Robot, settings: ReachSettings) -> Scenario:
    """Return the problem for a robot that begins at rest in its reference posture.

    Limits of efforts are bounds on the controls, those of joint positions and velocities are barriers. Figures:
    ``position_error_m``, ``rotation_error_deg`` (if a rotation is requested) and ``final_joint_velocity_rad_s``, the
    largest, at the end; ``joint_limit_violation_rad`` and ``joint_velocity_violation_rad_s``, the largest violations
    of position and velocity limits; ``clearance_m`` (if there are clearances), the least distance of pairs of shapes.

    Raises:
        InputError: no such frame, a robot whose base is free, or a clearance of shapes that cannot move.
    """
    s, w, nu = settings, settings.weights, robot.nu
    if robot.floating_base:
        raise InputError("robot", f"{robot.name}, whose base is free", "a robot with a fixed base")
    robot.frame(s.frame)  # raises if there is none
    dynamics = FreeForwardDynamics(robot.model)
    state = dynamics.state
    barrier = QuadraticBarrier(state.lower, state.upper)
    limits = CostItem("limits", library.StateError(state), w.limits, barrier)
    running = [
        CostItem("posture", library.StateError(state, robot.x_reference), np.repeat([w.posture, w.velocity], nu)),
        CostItem("effort", library.ContactControlGravity(nu), w.effort),
        limits,
    ]
    bounds = ConstraintItem("effort_limit", library.Control(nu), -robot.effort_limit, robot.effort_limit)
    soft, hard = clearance_items(robot, s.clearances)
    rest = CostItem("rest", library.StateError(state, robot.x_reference), np.repeat([0.0, w.rest], nu))
    position, *rotation = s.costs("position", w.position, w.rotation)
    ending = [position, rest, limits, *rotation]
    problem = ShootingProblem(
        MultibodyAction("reach", dynamics, running + soft, [bounds, *hard]),
        s.nodes,
        MultibodyAction("reach_end", dynamics, ending),
    )
    problem.set("duration", s.node_s)
    problem.set_initial_state(robot.x_reference)

    def figures(trajectory: Trajectory) -> dict[str, float]:
        from_neutral = state.diff(np.tile(state.neutral(), (len(trajectory.xs), 1)), trajectory.xs)
        beyond = np.maximum(np.maximum(state.lower - from_neutral, from_neutral - state.upper), 0.0).max(axis=0)
        return {
            **s.figures(robot, trajectory.xs),
            "final_joint_velocity_rad_s": float(np.abs(trajectory.xs[-1, robot.nq :]).max()),
            "joint_limit_violation_rad": float(beyond[: robot.nv].max()),
            "joint_velocity_violation_rad_s": float(beyond[robot.nv :].max()),
        }

    return Scenario(
        name="reach",
        robot=robot,
        problem=problem,
        # A guess at rest without efforts has gaps: FDDP starts from multiple shooting. With the efforts that balance
        # gravity it would start from single shooting, which converges more slowly or not at all.
        guess=problem.hold(),
        durations=np.full(s.nodes, s.node_s),
        figures=figures,
        waypoints=(s.waypoint(s.nodes * s.node_s),),
    )


def clearance_items(robot: Robot, clearances: Sequence[Clearance]) -> tuple[list[CostItem], list[ConstraintItem]]:
    """Return the costs and constraints of clearances.

    Raises:
        InputError: an unknown frame, two shapes on the same joint, or a box and a shape other than a sphere.
    """
    costs, constraints = [], []
    for i, (clearance, pair) in enumerate(zip(clearances, _pairs(robot, clearances), strict=True)):
        try:
            distance = library.ShapePairDistance(*pair)
        except InputError as error:
            raise InputError(f"clearances.{i}", error.got, error.expected) from error
        name = f"clearance_{i}"
        if clearance.weight is None:
            constraints.append(ConstraintItem(name, distance, clearance.distance_m, np.inf))
        else:
            costs.append(CostItem(name, distance, clearance.weight, QuadraticBarrier(clearance.distance_m, np.inf)))
    return costs, constraints


def least_clearance(robot: Robot, clearances: Sequence[Clearance], xs: Array) -> float:
    """Return the least distance of all pairs at states (n, nx), by coal, m; negative where they overlap."""
    data, request, result = robot.create_data(), coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    least = np.inf
    for first, second in _pairs(robot, clearances):
        for x in xs:
            pin.forwardKinematics(robot.model, data, x[: robot.nq])
            places = []
            for part in (first, second):
                place = data.oMi[part.joint] * part.placement
                places += [_geometry(part), coal.Transform3s(place.rotation, place.translation)]
            result.clear()
            least = min(least, coal.distance(*places, request, result))
    return float(least)


def _pairs(robot: Robot, clearances: Sequence[Clearance]) -> list[tuple[CollisionShape, CollisionShape]]:
    return [
        (_place(robot, f"clearances.{i}.first", each.first), _place(robot, f"clearances.{i}.second", each.second))
        for i, each in enumerate(clearances)
    ]


def _place(robot: Robot, key: str, shape: AnyShape) -> CollisionShape:
    try:
        return place_shape(robot.model, shape)
    except InputError as error:
        raise InputError(f"{key}.link", error.got, error.expected, error.choices) from error


def _geometry(part: CollisionShape) -> coal.CollisionGeometry:
    shape = part.shape
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius_m)
    if isinstance(shape, Box):
        return coal.Box(*(2.0 * half for half in shape.half_size_m))
    return coal.Capsule(shape.radius_m, 2.0 * shape.half_length_m)
