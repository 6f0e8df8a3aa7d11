"""A humanoid on both feet moves its hand to a target and keeps its balance; no foot slips or tips.

Friction, centres of pressure and limits are hard constraints, which fddp and box_fddp do not support.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from pydantic import model_validator

from lgmpc.actions import Contact, ContactForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, Residual, StageSymbols
from lgmpc.costs.library import CenterOfPressure, Control, FrictionCone, JointAcceleration, JointPosition, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems import motion
from lgmpc.problems.legged_settings import ContactGains, gains_of_contacts
from lgmpc.problems.reach import TargetSettings, clearance_items
from lgmpc.problems.scenario import Scenario
from lgmpc.robot import Robot
from lgmpc.settings import Count, Friction, Interval, NonNegative, Positive, Settings, key, problem
from lgmpc.support import support_margin
from lgmpc.typing import Array, typed

_MARGIN = 0.02
"""Margin of the joints' references from their limits, rad (m)."""


class StandingReachWeights(Settings):
    """Weights of the cost; those of the running cost are per second of the horizon."""

    position: Positive = key(1e4, "Hand from its target at the end, 1/m2.")
    rotation: NonNegative = key(1e3, "Hand's rotation from its target at the end, 1/rad2.")
    rest: NonNegative = key(1e2, "All velocities at the end.")
    base: NonNegative = key(1.0, "Trunk from upright, 1/rad2.")
    posture: NonNegative = key(0.3, "Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = key(0.1, "Velocities of base and joints.")
    acceleration: NonNegative = key(
        1e-2, "Joint accelerations, 1/(rad/s2)2; without it the joints decelerate in the last intervals only."
    )
    effort: Positive = key(0.1, "Squared torques, as fractions of their limits.")


class StandingReachSettings(TargetSettings):
    """A robot stands on soles at its contact frames and moves a hand from its reference posture to a target.

    Limits of joints and efforts, friction cones, and soles around the centres of pressure are hard constraints, which
    fddp and box_fddp do not support.
    """

    kind: Literal["standing_reach"] = key("standing_reach", "A hand of a standing robot reaches a target.")
    sole_half_size_m: tuple[Positive, Positive] = key(
        (0.1, 0.065), "Half length and half width of the soles, centred at the contact frames, m."
    )
    sole_margin_m: NonNegative = key(0.02, "Least distance of a centre of pressure from its sole's edge, m.")
    friction: Friction = key(0.5, "Friction coefficient of the contact forces' cones.")
    contact_gains: ContactGains = {}
    nodes: Count = key(30, "Number of intervals.")
    node_s: Interval = key(0.05, "Length of each interval, s.")
    weights: StandingReachWeights = key(StandingReachWeights(), "Weights of the cost.")

    @model_validator(mode="after")
    def _something_is_left(self) -> "StandingReachSettings":
        if self.sole_margin_m >= min(self.sole_half_size_m):
            expected = f"less than {min(self.sole_half_size_m):g}, half of a sole's width"
            raise problem(expected, key="sole_margin_m", got=self.sole_margin_m)
        return self


class Scaled(Residual):
    """A residual divided by a unit, for equal scaling of rows in newtons and in radians.

    Args:
        residual: the undivided residual.
        unit: (nr,) or a number, in the residual's units.
    """

    def __init__(self, residual: Residual, unit: ArrayLike) -> None:
        self.nr = residual.nr
        self.parameters = residual.parameters
        self._residual = residual
        self._unit = np.broadcast_to(np.asarray(unit, dtype=np.float64), self.nr).copy()

    def expression(self, s: StageSymbols) -> Any:
        """Return the quotients."""
        return self._residual.expression(s) / self._unit


@typed
def build_standing_reach(robot: Robot, settings: StandingReachSettings) -> Scenario:
    """Return the problem for a robot that stands at rest in its reference posture, on soles at its contact frames.

    Hard constraints: efforts and joints within the robot's limits, contact forces in friction cones, centres of
    pressure within the soles. Figures: ``position_error_m`` and ``rotation_error_deg`` (if a rotation is requested) of
    the hand, ``final_speed_m_s`` of the centre of mass and ``final_joint_velocity_rad_s``, the largest, at the end;
    ``com_margin_m`` and ``zmp_margin_m``, least distances of the projected centre of mass and of the zero moment point
    to the edge of the soles' convex hull; ``cop_margin_m``, least distance of a centre of pressure to its sole's edge;
    ``friction_ratio``, tangential force over its limit; ``slip_m`` and ``sole_turn_deg``, displacements of the soles;
    ``joint_limit_violation_rad``, largest violation of position limits; ``clearance_m``, the least distance of pairs of
    shapes (if there are clearances). Forces are recomputed from the motion by Pinocchio's inverse dynamics.

    Raises:
        InputError: a robot without free base or contact frames, an unknown frame, a margin as large as the soles, gains
            of a frame that is no contact, or a clearance of shapes that cannot move.
    """
    s = settings
    _check(robot, s)
    stance = [motion.frame_placements(robot, frame, robot.x_reference[None])[0] for frame in robot.contact_frames]
    corners = np.concatenate([sole_corners(sole, s.sole_half_size_m) for sole in stance])
    problem = _problem(robot, s, stance)
    durations, flags = np.full(s.nodes, s.node_s), np.ones((s.nodes, robot.nc), dtype=np.bool_)
    _, effort = motion.carry(robot, robot.q_reference, flags[0], 6)
    bounded = np.clip(effort, -robot.effort_limit, robot.effort_limit)
    guess = Trajectory(problem.hold().xs, np.tile(bounded, (s.nodes, 1)))

    def wrenches(trajectory: Trajectory) -> Array:
        return motion.reactions(robot, trajectory, durations, flags, 6).wrenches

    def least_margin(points: Array) -> float:
        hulls = np.broadcast_to(corners[:, :2], (len(points), len(corners), 2))
        return float(support_margin(hulls, np.ones(hulls.shape[:2], dtype=np.bool_), points).min())

    def figures(trajectory: Trajectory) -> dict[str, float]:
        xs = trajectory.xs
        feet = [motion.frame_placements(robot, frame, xs) for frame in robot.contact_frames]
        moved = [stood.actInv(foot) for stood, foots in zip(stance, feet, strict=True) for foot in foots]
        forces = wrenches(trajectory)
        ground = np.array([sole.translation for sole in stance])
        total = forces.sum(axis=1)
        total[:, 3:] += np.cross(ground[None], forces[..., :3]).sum(axis=1)
        pressure = np.array([[center_of_pressure(f) for f in node] for node in in_axes_of(stance, forces)])
        return {
            **s.figures(robot, xs),
            "final_speed_m_s": motion.com_speed(robot, xs[-1]),
            "final_joint_velocity_rad_s": float(np.abs(xs[-1, robot.nq :][robot.joint_v]).max()),
            "com_margin_m": least_margin(motion.com_positions(robot, xs)[:, :2]),
            "zmp_margin_m": least_margin(np.array([center_of_pressure(f) for f in total])),
            "cop_margin_m": float((np.array(s.sole_half_size_m) - np.abs(pressure)).min()),
            "friction_ratio": float(motion.friction_use(forces[..., :3].reshape(-1, 3), s.friction).max()),
            "slip_m": float(max(np.linalg.norm(move.translation) for move in moved)),
            "sole_turn_deg": float(np.degrees(max(np.linalg.norm(pin.log3(move.rotation)) for move in moved))),
            "joint_limit_violation_rad": motion.joint_limit_violation(robot, xs),
        }

    return Scenario(
        name="standing_reach",
        robot=robot,
        problem=problem,
        guess=guess,
        durations=durations,
        figures=figures,
        contact_flags=flags,
        contact_forces=lambda trajectory: wrenches(trajectory)[..., :3],
        waypoints=(s.waypoint(s.nodes * s.node_s),),
        friction=s.friction,
    )


def _check(robot: Robot, s: StandingReachSettings) -> None:
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", f"{robot.name} without soles", "a free base and contact_frames")
    if robot.nq - robot.nv != 1:
        raise InputError("robot", f"{robot.name} with joints of more than one coordinate", "joints of one angle each")
    robot.frame(s.frame)


def _problem(robot: Robot, s: StandingReachSettings, stance: list[pin.SE3]) -> ShootingProblem:
    w, nu = s.weights, robot.nu
    dynamics = ContactForwardDynamics(robot.model, [Contact(frame, 6) for frame in robot.contact_frames])
    state, (length, width) = dynamics.state, s.sole_half_size_m
    reduced = (length - s.sole_margin_m, width - s.sole_margin_m)
    deviation = np.repeat([0.0, w.base, w.posture, w.velocity], [3, 3, nu, robot.nv])
    # With a reference on its limit a joint would make a constraint weakly active, near which interior-point methods
    # lose accuracy.
    posture = robot.x_reference.copy()
    margin = np.minimum(_MARGIN, (robot.joint_upper - robot.joint_lower) / 2.0)
    posture[robot.joint_q] = np.clip(posture[robot.joint_q], robot.joint_lower + margin, robot.joint_upper - margin)
    running = [
        CostItem("posture", StateError(state, posture), deviation),
        CostItem("acceleration", JointAcceleration(nu), w.acceleration),
        # The efforts themselves: their difference from gravity and contact forces would leave internal forces between
        # the feet free.
        CostItem("effort", Control(nu), w.effort / robot.effort_limit**2),
    ]
    weight = robot.weight
    constraints = [
        ConstraintItem("effort_limit", Scaled(Control(nu), robot.effort_limit), -1.0, 1.0),
        ConstraintItem("joint_limit", JointPosition(nu), robot.joint_lower, robot.joint_upper),
    ]
    for k, frame in enumerate(robot.contact_frames):
        cone = Scaled(FrictionCone(frame, friction=s.friction), weight)
        pressure = Scaled(CenterOfPressure(frame, reduced), weight * length)
        constraints.append(ConstraintItem(f"cone_{k}", cone, 0.0, np.inf))
        constraints.append(ConstraintItem(f"pressure_{k}", pressure, 0.0, np.inf))
    rest = CostItem("rest", StateError(state, robot.x_reference), np.repeat([0.0, w.rest], robot.nv))
    hand, *rotation = s.costs("hand", w.position, w.rotation)
    ending = [hand, rest, *rotation]
    soft, hard = clearance_items(robot, s.clearances)
    action = MultibodyAction("standing_reach", dynamics, running + soft, constraints + hard)
    problem = ShootingProblem(action, s.nodes, MultibodyAction("standing_reach_end", dynamics, ending))
    nodes = list(range(s.nodes))
    h = s.node_s
    values: dict[str, ArrayLike] = {
        "duration": h,
        "contact_points": np.concatenate([sole.translation for sole in stance]),
        "contact_orientations": np.concatenate([pin.Quaternion(sole.rotation).coeffs() for sole in stance]),
        # These gains cancel the displacement of a contact in one step of the integrator.
        "contact_gains": gains_of_contacts(robot, s.contact_gains, np.array([[1.0 / h**2, 1.0 / h]]))[0],
    }
    for name, value in values.items():
        problem.set(name, value, nodes)
    # The first state is fixed: limits at its values are relaxed, so that interior-point methods have an interior.
    start = robot.q_reference[robot.joint_q]
    problem.set("joint_limit_lower", np.minimum(robot.joint_lower, start - 1.0), [0])
    problem.set("joint_limit_upper", np.maximum(robot.joint_upper, start + 1.0), [0])
    problem.set_initial_state(robot.x_reference)
    return problem


def center_of_pressure(wrench: Array) -> Array:
    """Return (2,) the point in the plane z = 0 of a wrench's axes about which its horizontal moment vanishes, m.

    ``[-m_y, m_x] / f_z`` (Sardain and Bessonnet, "Forces acting on a biped robot. Center of pressure - zero moment
    point", IEEE Trans. SMC A 34, 2004).
    """
    return np.array([-wrench[4], wrench[3]]) / wrench[2]


def sole_corners(placement: pin.SE3, half_size: tuple[float, float]) -> Array:
    """Return (4, 3) the corners of a rectangular sole about a frame's origin, world axes, m."""
    length, width = half_size
    local = np.array([[i * length, j * width, 0.0] for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    return local @ placement.rotation.T + placement.translation


def in_axes_of(soles: Sequence[pin.SE3], wrenches: Array) -> Array:
    """Rotate wrenches (n, nc, 6) at the soles' origins from world axes to the soles' own axes."""
    back = np.array([sole.rotation.T for sole in soles])
    turned = [np.einsum("cij,kcj->kci", back, part) for part in (wrenches[..., :3], wrenches[..., 3:])]
    return np.concatenate(turned, axis=2)
