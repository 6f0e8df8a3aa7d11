"""A legged robot, dropped or tossed upside down without angular momentum, turns upright by moving its legs.

This is the falling cat's problem: without external forces the robot rotates only by closed paths of its joints. The
legs swing one way stretched and back folded: a cycle returns the joints to their initial positions, but not the trunk.
Its angular velocity is ``-A(q_j) q_j'`` with the mechanical connection A, which is larger for stretched legs; the
rotation of a small cycle is the integral of A's curvature over the area that the cycle encloses in joint space
(Montgomery, "Gauge theory of the falling cat", 1993).

An integrator's error in the angular momentum could cause a rotation of the same
size. The problem therefore uses the variational integrator, which conserves the momentum, and its figures are those of
an independent simulation (:mod:`lgmpc.problems.motion`).
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import FreeForwardDynamics, MultibodyAction, Variational
from lgmpc.costs import ConstraintItem, CostItem, Parameter, Residual, StageSymbols
from lgmpc.costs.library import Control, FrameRotationMatrix
from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.motion import com_positions, joint_limit_violation, refly, spins, trunk_clearance, trunk_spins
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.robot.actuators import match_joints
from lgmpc.settings import Count, Finite, Interval, NonNegative, Positive, Settings, Vector3, key
from lgmpc.timegrid import TimeGrid, minimum_jerk
from lgmpc.typing import Array, typed

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_SUBSTEPS = 8
"""Integration steps of the trunk's attitude in an interval."""

_STIFFNESS, _DAMPING = 3.0, 0.05
"""Gains of the joints' controllers in the independent simulation, N.m/rad and N.m.s/rad."""

_LONGEST_S = 10.0
"""Duration of the longest flight, s: 40,000 steps of the simulation."""


class LegStrokes(Settings):
    """Cycles of the joints between two postures, with a sweep a quarter of a cycle out of phase.

    At the phase phi the joints are at ``(stretched + folded) / 2 + (stretched - folded) / 2 cos(phi) + sweep
    sin(phi)``; the sweep's sign is that of the motion while they are stretched.
    """

    stretched_rad: dict[str, Finite] = Field(
        description="Posture in which the legs swing forth, {joint name or pattern: rad}; joints not named are at 0."
    )
    folded_rad: dict[str, Finite] = Field(description="Posture in which legs swing back, {joint or pattern: rad}.")
    sweep_rad: dict[str, Finite] = Field(
        description="Amplitude of the swing, {joint name or pattern: rad}; the robot turns against its sign."
    )
    count: Count = key(5, "Number of cycles.")
    ramp_s: Positive = key(0.12, "Time of the transitions from and to the reference posture, s.")

    def joints(self, robot: Robot, times: Array) -> "CubicSpline":
        """Return the joints' path (nu,) over time, at rest in the reference posture at both ends.

        Args:
            robot: with joints of one angle each.
            times: (N+1,) of the nodes, s.

        Raises:
            InputError: an unknown joint name, or ramps longer than the motion.
        """
        from scipy.interpolate import CubicSpline  # here, because it takes longer to import than all problems

        duration = float(times[-1] - times[0])
        if not 0.0 < 2.0 * self.ramp_s <= duration:
            raise InputError("strokes.ramp_s", self.ramp_s, f"above 0, at most {duration / 2:g} s, half of the motion")
        stretched, folded, sweep = (
            _by_joint(robot, key, getattr(self, key)) for key in ("stretched_rad", "folded_rad", "sweep_rad")
        )
        phase = 2.0 * np.pi * self.count * (times - times[0]) / duration
        cosine, sine = np.cos(phase)[:, None], np.sin(phase)[:, None]
        strokes = (stretched + folded) / 2.0 + (stretched - folded) / 2.0 * cosine + sweep * sine
        ramps = np.minimum(times - times[0], times[-1] - times) / self.ramp_s
        share = minimum_jerk(np.clip(ramps, 0.0, 1.0))[0]
        reference = robot.q_reference[robot.joint_q]
        return CubicSpline(times, reference + share[:, None] * (strokes - reference), bc_type="clamped")


class RightingWeights(Settings):
    """Weights of the cost; the first three are per second of the horizon."""

    strokes: NonNegative = key(1.0, "Joints from the strokes, 1/rad2.")
    rates: NonNegative = key(1e-3, "Joint rates from those of the strokes, 1/(rad/s)2.")
    effort: Positive = key(1e-2, "Torques, 1/(N.m)2.")
    rotation: Positive = key(1e2, "Attitude from that of the goal, at the end, 1/rad2.")
    posture: NonNegative = key(1e2, "Joints from the reference posture, at the end, 1/rad2.")
    rest: NonNegative = key(1.0, "Joint rates at the end, 1/(rad/s)2.")


class RightingSettings(ProblemSettings):
    """A falling robot without angular momentum turns upright by moving its legs only.

    Limits of torques, joint positions and rates are hard constraints, which fddp and box_fddp do not support.
    """

    kind: Literal["righting"] = key("righting", "A falling robot lands on its feet.")
    strokes: LegStrokes = Field(description="Motion of the legs in the initial guess.")
    position_m: Vector3 = key((0.0, 0.0, 8.0), "[x, y, z] of the base at first, world axes, m.")
    rotation_deg: Vector3 = key(
        (180.0, 0.0, 0.0), "Attitude of the base at first as a rotation vector (axis times angle), degrees."
    )
    velocity_m_s: Vector3 = key((0.0, 0.0, 0.0), "Velocity at first, world axes, m/s: upwards for a toss.")
    goal_rotation_deg: Vector3 = key((0.0, 0.0, 0.0), "Attitude at the end, degrees.")
    trunk_half_size_m: tuple[Positive, Positive, Positive] = key(
        (0.2, 0.08, 0.03), "Half sizes of the trunk's box, from which the shanks' clearance is measured, m."
    )
    nodes: Count = key(240, "Number of intervals.")
    node_s: Interval = key(0.005, "Length of each interval, s.")
    weights: RightingWeights = key(RightingWeights(), "Weights of the cost.")


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
    :func:`lgmpc.problems.motion.trunk_clearance`) and ``leg_clearance_m``, between two links (see
    :class:`lgmpc.robot.collision.LinkPairs`), the smallest; ``flight_height_m``, from the lowest to the highest
    position of the centre of mass. Of the independent simulation (see :func:`lgmpc.problems.motion.refly`):
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
    times = TimeGrid(s.node_s, s.nodes).nodes
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
            "leg_clearance_m": float(robot.link_pairs.distances(xs[:, : robot.nq])[0].min()),
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


def falling_motion(robot: Robot, x0: Array, joints: "CubicSpline", times: Array) -> Trajectory:
    """Return the fall of a robot without angular momentum along a path of its joints, with its torques.

    The centre of mass follows its parabola; the base's velocity conserves the momentum; torques are those of the mean
    motion of each interval, clipped to the limits. Exact in the continuous limit.

    Args:
        robot: with a free base.
        x0: (nx,) first state: joints at rest at the beginning of the path, no rotation.
        joints: the path of the joints.
        times: (N+1,) of the nodes, s.
    """
    model, data, nq = robot.model, robot.create_data(), robot.nq
    rates = joints.derivative()
    rotation = np.asarray(pin.Quaternion(x0[3:7]).matrix())
    com = pin.centerOfMass(model, data, x0[:nq], x0[nq:]).copy()
    speed = np.array(data.vcom[0])
    xs = np.tile(x0, (len(times), 1))
    for k, (t, h) in enumerate(zip(times, np.diff(times, append=times[-1]), strict=True)):
        q = np.concatenate([np.zeros(3), pin.Quaternion(rotation).coeffs(), joints(t)])
        fallen = com + t * speed + 0.5 * t**2 * robot.gravity
        q[:3] = fallen - pin.centerOfMass(model, data, q)
        momentum = robot.mass * np.concatenate([speed + t * robot.gravity, np.zeros(3)])
        xs[k] = np.concatenate([q, _base_velocity(robot, data, q, rates(t), momentum), rates(t)])
        for middle in t + h / _SUBSTEPS * (np.arange(_SUBSTEPS) + 0.5):
            level = np.concatenate([np.zeros(6), [1.0], joints(middle)])
            turning = _base_velocity(robot, data, level, rates(middle), np.zeros(6))[3:]
            rotation = rotation @ so3.exp(h / _SUBSTEPS * turning)
    limit = robot.effort_limit
    us = [_torques(robot, data, x, after, h) for x, after, h in zip(xs, xs[1:], np.diff(times), strict=False)]
    return Trajectory(xs, np.clip(us, -limit, limit))


def _base_velocity(robot: Robot, data: pin.Data, q: Array, rates: Array, momentum: Array) -> Array:
    """Return (6,) the base's velocity with which the centroidal momentum is ``momentum``."""
    matrix = pin.computeCentroidalMap(robot.model, data, q)
    return np.linalg.solve(matrix[:, :6], momentum - matrix[:, 6:] @ rates)


def _torques(robot: Robot, data: pin.Data, x: Array, after: Array, h: float) -> Array:
    """Return (nu,) the torques of the mean motion of an interval, without external forces."""
    model, nq = robot.model, robot.nq
    q = pin.interpolate(model, x[:nq], after[:nq], 0.5)
    v, a = (x[nq:] + after[nq:]) / 2.0, (after[nq:] - x[nq:]) / h
    a[:6] = 0.0
    pushed = pin.rnea(model, data, q, v, a)[:6]
    a[:6] = np.linalg.solve(pin.crba(model, data, q, pin.Convention.WORLD)[:6, :6], -pushed)
    return pin.rnea(model, data, q, v, a)[6:].copy()


def _by_joint(robot: Robot, key: str, values: Mapping[str, float]) -> Array:
    given, problems = match_joints(values, robot.joint_names, key)
    if problems:
        raise InputError(f"strokes.{key}", ", ".join(values), "names or patterns of joints", robot.joint_names)
    return np.array([given.get(name, 0.0) for name in robot.joint_names])
