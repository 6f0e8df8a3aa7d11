"""A tumbling or inverted multirotor turns upright and hovers at its initial position.

The problem has no singularity at any attitude: gaps are differences on SE(3), logarithms of the small rotation from one
node to the next only, and the cost is a function of rotation matrices (:class:`FrameRotationMatrix`), which is smooth
at rotation pi. In roll, pitch and yaw the same motion jumps at pitch 90 degrees, and in the rotation vector from the
goal at rotation pi.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import MultibodyAction, RungeKutta4
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameRotationMatrix, FrameTranslation, FrameVelocity
from lgmpc.lie import attitude, so3
from lgmpc.lie.checks import typed
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.multirotor import Multirotor, MultirotorSettings, thrust_figures, turning_guess
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.settings import Count, Interval, NonNegative, Positive, Settings, Vector3
from lgmpc.typing import Array

__all__ = ["RecoverySettings", "RecoveryWeights", "build_recovery"]


class RecoveryWeights(Settings):
    """Weights of the cost; all but that of the goal are per second of the horizon."""

    position: NonNegative = Field(default=1.0, description="Position from the initial one, 1/m2.")
    rotation: NonNegative = Field(default=1.0, description="Attitude from that of the goal, 1/rad2 for small angles.")
    speed: NonNegative = Field(default=1e-2, description="Velocity, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = Field(default=1e-2, description="Thrust of each rotor from hovering, 1/N2.")
    goal: Positive = Field(default=1e3, description="Position, attitude and velocity at the end.")


class RecoverySettings(ProblemSettings):
    """A multirotor in any attitude turns upright and comes to rest at its initial position; thrusts are bounded."""

    kind: Literal["recovery"] = Field(default="recovery", description="A multirotor recovers from any attitude.")
    rotors: MultirotorSettings = Field(description="The rotors, at frames of the URDF.")
    position_m: Vector3 = Field(
        default=(0.0, 0.0, 5.0), description="[x, y, z] of the body at first and at the end, world axes, m."
    )
    rotation_deg: Vector3 = Field(
        default=(0.0, 180.0, 0.0), description="Attitude at first as a rotation vector (axis times angle), degrees."
    )
    velocity_m_s: Vector3 = Field(default=(0.0, 0.0, 0.0), description="Velocity at first, body axes, m/s.")
    angular_velocity_rad_s: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Angular velocity at first, body axes, rad/s."
    )
    goal_rotation_deg: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Attitude at the end, degrees. More than half a turn gives the guess its direction: from "
        "[0, 150, 0] to [0, 360, 0], which is level, it continues to turn over its back.",
    )
    nodes: Count = Field(default=100, description="Number of intervals.")
    node_s: Interval = Field(default=0.025, description="Length of each interval, s.")
    weights: RecoveryWeights = Field(default=RecoveryWeights(), description="Weights of the cost.")


@typed
def build_recovery(robot: Robot, settings: RecoverySettings) -> Scenario:
    """Return the problem; thrust limits are bounds on the controls, and the guess turns evenly for half of the time.

    Figures: ``final_tilt_deg``, ``final_error_m``, ``final_speed_m_s``, ``final_rate_rad_s``; ``height_lost_m``, the
    largest below the start; ``attitude_step_deg``, the largest rotation from a node to the next, and the same motion
    in two charts: ``rpy_jump_deg``, the largest change of roll, pitch or yaw from a node to the next, whole turns
    not counted (180 where pitch passes 90 degrees), and ``log_jump_deg``, that of the rotation vector from the goal
    (360 where the rotation passes pi); and those of :func:`lgmpc.problems.multirotor.thrust_figures`.

    Raises:
        InputError: a robot without these rotors.
    """
    s, w = settings, settings.weights
    vehicle = Multirotor.of(robot, s.rotors)
    goal = so3.exp(np.radians(s.goal_rotation_deg))
    nu = len(vehicle.hover)
    costs = [
        CostItem("position", FrameTranslation(vehicle.body, s.position_m), w.position),
        CostItem("rotation", FrameRotationMatrix(vehicle.body, pin.Quaternion(goal).coeffs()), w.rotation),
        CostItem("velocity", FrameVelocity(vehicle.body), w.speed),
        CostItem("thrust", Control(nu, vehicle.hover), w.thrust),
    ]
    bounds = ConstraintItem("limits", Control(nu), 0.0, vehicle.max_thrust)
    problem = ShootingProblem(MultibodyAction("recovery", vehicle.dynamics, costs, [bounds], RungeKutta4()), s.nodes)
    problem.set("duration", s.node_s)
    for name in ("position", "rotation", "velocity"):
        problem.set(f"{name}_weight", w.goal, [s.nodes])
    turned = pin.Quaternion(so3.exp(np.radians(s.rotation_deg))).coeffs()
    x0 = np.concatenate([s.position_m, turned, s.velocity_m_s, s.angular_velocity_rad_s])
    problem.set_initial_state(x0)
    durations = np.full(s.nodes, s.node_s)

    def figures(trajectory: Trajectory) -> dict[str, float]:
        xs, end = trajectory.xs, trajectory.xs[-1]
        rotations = so3.from_quaternion.unchecked(xs[:, 3:7])
        rpy = attitude.roll_pitch_yaw(rotations)
        logs = np.degrees([pin.log3(goal.T @ rotation) for rotation in rotations])
        steps = attitude.angle_between(rotations[:-1], rotations[1:])
        return {
            "final_tilt_deg": float(np.degrees(attitude.tilt(rotations[-1]))),
            "final_error_m": float(np.linalg.norm(end[:3] - x0[:3])),
            "final_speed_m_s": float(np.linalg.norm(end[7:10])),
            "final_rate_rad_s": float(np.linalg.norm(end[10:])),
            "height_lost_m": float(max(x0[2] - xs[:, 2].min(), 0.0)),
            "attitude_step_deg": float(np.degrees(steps.max())),
            "rpy_jump_deg": float(np.degrees(np.abs(_wrapped(np.diff(rpy, axis=0))).max())),
            "log_jump_deg": float(np.linalg.norm(np.diff(logs, axis=0), axis=1).max()),
            **thrust_figures(vehicle, trajectory, durations),
        }

    end = s.nodes * s.node_s
    turns = [(0.0, s.rotation_deg), (end / 2.0, s.goal_rotation_deg)]
    guess = turning_guess(vehicle, durations, [(0.0, s.position_m)], turns)
    mark = Waypoint("hover", end, np.array(s.position_m), goal)
    return Scenario("recovery", robot, problem, guess, durations, figures, waypoints=(mark,), controls=vehicle.controls)


def _wrapped(angle: Array) -> Array:
    """Return angles to within a turn, -pi to pi."""
    wrapped: Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped
