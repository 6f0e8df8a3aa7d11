"""A legged robot, dropped or tossed upside down without angular momentum, turns upright by moving its legs.

This is the falling cat's problem: without external forces the robot rotates only by closed paths of its joints
(:mod:`lgmpc.problems.leg_strokes`). An integrator's error in the angular momentum could cause a rotation of the same
size. The problem therefore uses the variational integrator, which conserves the momentum, and its figures are those of
an independent simulation (:mod:`lgmpc.problems.motion`).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import FreeForwardDynamics, MultibodyAction, Variational
from lgmpc.costs import ConstraintItem, CostItem, Parameter, Residual, StageSymbols
from lgmpc.costs.library import Control, FrameRotationMatrix
from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.lie.checks import typed
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.leg_strokes import LegStrokes, falling_motion
from lgmpc.problems.motion import (
    com_positions,
    joint_limit_violation,
    refly,
    spins,
    trunk_clearance,
    trunk_spins,
)
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot, leg_clearances
from lgmpc.settings import Count, Interval, NonNegative, Positive, Settings, Vector3
from lgmpc.typing import Array

__all__ = ["JointMotion", "RightingSettings", "RightingWeights", "build_righting"]

_STIFFNESS, _DAMPING = 3.0, 0.05
"""Gains of the joints' controllers in the independent simulation, N.m/rad and N.m.s/rad."""

_LONGEST_S = 10.0
"""Duration of the longest flight, s: 40,000 steps of the simulation."""


class RightingWeights(Settings):
    """Weights of the cost; the first three are per second of the horizon."""

    strokes: NonNegative = Field(default=1.0, description="Joints from the strokes, 1/rad2.")
    rates: NonNegative = Field(default=1e-3, description="Joint rates from those of the strokes, 1/(rad/s)2.")
    effort: Positive = Field(default=1e-2, description="Torques, 1/(N.m)2.")
    rotation: Positive = Field(default=1e2, description="Attitude from that of the goal, at the end, 1/rad2.")
    posture: NonNegative = Field(default=1e2, description="Joints from the reference posture, at the end, 1/rad2.")
    rest: NonNegative = Field(default=1.0, description="Joint rates at the end, 1/(rad/s)2.")


class RightingSettings(ProblemSettings):
    """A falling robot without angular momentum turns upright by moving its legs only.

    Limits of torques, joint positions and rates are hard constraints, which fddp and box_fddp do not support.
    """

    kind: Literal["righting"] = Field(default="righting", description="A falling robot lands on its feet.")
    strokes: LegStrokes = Field(description="Motion of the legs in the initial guess.")
    position_m: Vector3 = Field(default=(0.0, 0.0, 8.0), description="[x, y, z] of the base at first, world axes, m.")
    rotation_deg: Vector3 = Field(
        default=(180.0, 0.0, 0.0),
        description="Attitude of the base at first as a rotation vector (axis times angle), degrees.",
    )
    velocity_m_s: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Velocity at first, world axes, m/s: upwards for a toss."
    )
    goal_rotation_deg: Vector3 = Field(default=(0.0, 0.0, 0.0), description="Attitude at the end, degrees.")
    trunk_half_size_m: tuple[Positive, Positive, Positive] = Field(
        default=(0.2, 0.08, 0.03),
        description="Half sizes of the trunk's box, from which the shanks' clearance is measured, m.",
    )
    nodes: Count = Field(default=240, description="Number of intervals.")
    node_s: Interval = Field(default=0.005, description="Length of each interval, s.")
    weights: RightingWeights = Field(default=RightingWeights(), description="Weights of the cost.")


class JointMotion(Residual):
    """Positions and rates of the actuated joints minus ``reference`` (2 nu,), rad and rad/s; joints of one angle each.

    Args:
        nu: number of actuated joints.
    """

    def __init__(self, nu: int) -> None:
        self.nr = 2 * nu
        self.parameters = (Parameter("reference", 2 * nu, "reference of the joint positions and rates, rad, rad/s"),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        nu = self.nr // 2
        return ca.vertcat(s.q[s.robot.nq - nu :], s.v[s.robot.nv - nu :]) - s["reference"]


@typed
def build_righting(robot: Robot, settings: RightingSettings) -> Scenario:
    """Return the problem; limits of torques, joint positions and joint rates are hard constraints.

    Figures, of the plan: ``final_tilt_deg`` and ``final_rotation_deg``, of the base from upright and from the goal's
    attitude; ``planned_spin_nms``, largest angular momentum about the centre of mass at the nodes, which is an error of
    the integrator's order; ``joint_range_violation_rad`` and ``joint_speed_ratio``; ``trunk_clearance_m`` (see
    :func:`lgmpc.problems.motion.trunk_clearance`) and ``leg_clearance_m`` (see
    :func:`lgmpc.robot.leg_clearances`), the smallest; ``flight_height_m``, from the lowest to the highest position of
    the centre of mass. Of the independent simulation (see :func:`lgmpc.problems.motion.refly`):
    ``reflown_tilt_deg``, ``reflown_rotation_deg``; ``reflown_spin_nms``, the change of the angular momentum; for
    comparison the plan's largest ``trunk_spin_nms``; ``path_error_rad``, of the joints; and ``landing_rate_rad_s``, of
    the base's rotation at the end.

    Raises:
        InputError: a robot without free base or contact frames, or with joints of more than an angle; strokes of
            unknown joints, or with ramps longer than the motion; a flight too long for the simulation.
    """
    s, w, nu = settings, settings.weights, robot.nu
    if not (robot.floating_base and robot.nc and robot.nq - 7 == nu):
        raise InputError("robot", f"{robot.name}", "a free base, contact_frames, and joints of one angle each")
    if s.nodes * s.node_s > _LONGEST_S * (1.0 + 1e-9):
        raise InputError("nodes", f"{s.nodes} of {s.node_s:g} s", f"a flight of at most {_LONGEST_S:g} s")
    still = np.concatenate([robot.q_reference[robot.joint_q], np.zeros(nu)])
    lower = np.concatenate([robot.joint_lower, -robot.velocity_limit])
    upper = np.concatenate([robot.joint_upper, robot.velocity_limit])
    goal = so3.exp(np.radians(s.goal_rotation_deg))
    costs = [
        CostItem("rotation", FrameRotationMatrix(robot.body_names[0], pin.Quaternion(goal).coeffs()), 0.0),
        CostItem("joints", JointMotion(nu), np.repeat([w.strokes, w.rates], nu)),
        CostItem("effort", Control(nu), w.effort),
    ]
    limits = [
        ConstraintItem("torque", Control(nu), -robot.effort_limit, robot.effort_limit),
        ConstraintItem("range", JointMotion(nu), lower, upper),
    ]
    dynamics = FreeForwardDynamics(robot.model)
    problem = ShootingProblem(MultibodyAction("righting", dynamics, costs, limits, Variational()), s.nodes)
    problem.set("duration", s.node_s)

    start = so3.exp(np.radians(s.rotation_deg))
    base = np.concatenate([s.position_m, pin.Quaternion(start).coeffs()])
    x0 = np.concatenate([base, still[:nu], start.T @ s.velocity_m_s, np.zeros(3), still[nu:]])
    problem.set_initial_state(x0)
    times: Array = s.node_s * np.arange(s.nodes + 1, dtype=np.float64)
    guess = falling_motion(robot, x0, s.strokes.joints(robot, times), times)
    strokes = np.hstack([guess.xs[:, robot.joint_q], guess.xs[:, robot.nq :][:, robot.joint_v]])
    problem.set("joints_reference", strokes)
    problem.set("joints_weight", np.repeat([w.posture, w.rest], nu), [s.nodes])
    problem.set("rotation_weight", w.rotation, [s.nodes])

    def figures(trajectory: Trajectory) -> dict[str, float]:
        xs, end = trajectory.xs, trajectory.xs[-1]
        rates = np.abs(xs[:, robot.nq :][:, robot.joint_v])
        flown = refly(robot, trajectory, times, _STIFFNESS, _DAMPING)
        attitudes = so3.from_quaternion.unchecked(np.stack([end[3:7], flown.x[3:7]]))
        return {
            "final_tilt_deg": math.degrees(attitude.tilt(attitudes[0])),
            "final_rotation_deg": math.degrees(attitude.angle_between(attitudes[0], goal)),
            "planned_spin_nms": float(np.linalg.norm(spins(robot, xs), axis=1).max()),
            "joint_range_violation_rad": joint_limit_violation(robot, xs),
            "joint_speed_ratio": float((rates / robot.velocity_limit).max()),
            "trunk_clearance_m": trunk_clearance(robot, xs, np.array(s.trunk_half_size_m)),
            "leg_clearance_m": float(leg_clearances(robot, xs[:, : robot.nq]).min()),
            "flight_height_m": float(np.ptp(com_positions(robot, xs)[:, 2])),
            "reflown_tilt_deg": math.degrees(attitude.tilt(attitudes[1])),
            "reflown_rotation_deg": math.degrees(attitude.angle_between(attitudes[1], goal)),
            "reflown_spin_nms": flown.spin,
            "trunk_spin_nms": float(np.linalg.norm(trunk_spins(robot, xs), axis=1).max()),
            "path_error_rad": flown.path_error,
            "landing_rate_rad_s": float(np.linalg.norm(flown.x[robot.nq + 3 : robot.nq + 6])),
        }

    mark = Waypoint("upright", float(times[-1]), guess.xs[-1, :3].copy(), goal)
    durations = np.full(s.nodes, s.node_s)
    return Scenario("righting", robot, problem, guess, durations, figures, waypoints=(mark,))
