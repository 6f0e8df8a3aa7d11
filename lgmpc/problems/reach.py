"""An arm puts a frame at a place and is at rest there, within its motors' efforts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.actions import FreeForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.activations import QuadraticBarrier
from lgmpc.costs.library import Control, ControlGravity, FrameRotation, FrameTranslation, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.attitude import angle_between
from lgmpc.problems.kinematics import frame_placements
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot

__all__ = ["ReachSettings", "ReachWeights", "build_reach"]


@dataclass(frozen=True)
class ReachWeights:
    """Weights of the cost; those of the running cost are per second of the horizon.

    Attributes:
        position: frame from its target at the end, 1/m2.
        rotation: frame's rotation from its target at the end, 1/rad2.
        rest: joint velocities at the end, 1/(rad/s)2.
        posture: joints from the reference posture, 1/rad2.
        velocity: joint velocities, 1/(rad/s)2.
        effort: efforts from those that hold the robot against gravity, 1/(N.m)2.
        limits: joints beyond their position and velocity limits, 1/rad2 and 1/(rad/s)2.
    """

    position: float = 1e5
    rotation: float = 1e4
    rest: float = 1e3
    posture: float = 1.0
    velocity: float = 1.0
    effort: float = 1e-3
    limits: float = 1e4


@dataclass(frozen=True)
class ReachSettings:
    """The target and the grid.

    Attributes:
        frame: that reaches.
        position: (3,) of its origin at the end, world axes, m.
        rpy_deg: (3,) its rotation at the end: roll, pitch, yaw about the world's axes, in this order, degrees; none if
            any will do.
        nodes: number of intervals.
        node_duration: length of each, s.
        weights: of the cost.
    """

    frame: str
    position: tuple[float, float, float]
    rpy_deg: tuple[float, float, float] | None = None
    nodes: int = 100
    node_duration: float = 0.01
    weights: ReachWeights = ReachWeights()


def build_reach(robot: Robot, settings: ReachSettings) -> Scenario:
    """Return the problem for a robot that begins at rest in its reference posture.

    The efforts keep to the robot's limits as bounds, positions and velocities of the joints by barriers. Figures:
    ``position_error_m``, ``rotation_error_deg`` (if a rotation is requested) and ``final_joint_velocity_rad_s``, the
    largest, at the end; ``joint_limit_violation_rad`` and ``joint_velocity_violation_rad_s``, by how much any joint
    passes its position and velocity limits.

    Raises:
        InputError: no such frame, or a robot whose base is free.
    """
    s, w, nu = settings, settings.weights, robot.nu
    if robot.floating_base:
        raise InputError("robot", f"{robot.name}, whose base is free", "a robot with a fixed base")
    robot.frame(s.frame)  # that it is there
    target = pin.SE3(
        np.eye(3) if s.rpy_deg is None else pin.rpy.rpyToMatrix(*np.radians(s.rpy_deg)), np.array(s.position)
    )
    dynamics = FreeForwardDynamics(robot.model)
    state = dynamics.state
    barrier = QuadraticBarrier(state.lower, state.upper)
    limits = CostItem("limits", StateError(state), w.limits, barrier)
    running = [
        CostItem("posture", StateError(state, robot.x_reference), np.repeat([w.posture, w.velocity], nu)),
        CostItem("effort", ControlGravity(nu), w.effort),
        limits,
    ]
    bounds = ConstraintItem("effort_limit", Control(nu), -robot.effort_limit, robot.effort_limit)
    ending = [
        CostItem("position", FrameTranslation(s.frame, target.translation), w.position),
        CostItem("rest", StateError(state, robot.x_reference), np.repeat([0.0, w.rest], nu)),
        limits,
    ]
    if s.rpy_deg is not None:
        quaternion = pin.Quaternion(target.rotation).coeffs()
        ending.append(CostItem("rotation", FrameRotation(s.frame, quaternion), w.rotation))
    problem = ShootingProblem(
        MultibodyAction("reach", dynamics, running, [bounds]), s.nodes, MultibodyAction("reach_end", dynamics, ending)
    )
    problem.set("duration", s.node_duration)
    problem.set_initial_state(robot.x_reference)

    def figures(trajectory: Trajectory) -> dict[str, float]:
        end = frame_placements(robot, s.frame, trajectory.xs[-1:])[0]
        from_neutral = state.diff(np.tile(state.neutral(), (len(trajectory.xs), 1)), trajectory.xs)
        beyond = np.maximum(np.maximum(state.lower - from_neutral, from_neutral - state.upper), 0.0).max(axis=0)
        off = math.degrees(angle_between(target.rotation, end.rotation))
        turned = {} if s.rpy_deg is None else {"rotation_error_deg": off}
        return {
            "position_error_m": float(np.linalg.norm(end.translation - target.translation)),
            **turned,
            "final_joint_velocity_rad_s": float(np.abs(trajectory.xs[-1, robot.nq :]).max()),
            "joint_limit_violation_rad": float(beyond[: robot.nv].max()),
            "joint_velocity_violation_rad_s": float(beyond[robot.nv :].max()),
        }

    duration = s.nodes * s.node_duration
    rotation = None if s.rpy_deg is None else target.rotation
    return Scenario(
        name="reach",
        robot=robot,
        problem=problem,
        # Standing still without efforts leaves gaps, and so FDDP can shoot over many nodes; with the efforts that hold
        # the robot it would be single shooting, which takes three times as many iterations, or does not arrive.
        guess=problem.hold(),
        durations=np.full(s.nodes, s.node_duration),
        figures=figures,
        waypoints=(Waypoint(s.frame, duration, target.translation, rotation),),
    )
