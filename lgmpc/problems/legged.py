"""Full-body problems of gaits and jumps, defined by a sequence of contacts and a motion of the base.

Every interval has the same action, contact forward dynamics whose flags are parameters, and every touchdown is an
impact after which no foot on the ground moves. The impact's costs penalise the distance of feet from their footholds
and their speed, so that impulses are small.

On the ground, contacts have the damping 1 / h and the stiffness 1 / (4 h^2), h being the interval's length, unless the
settings give others. With the damping alone a foot would be at rest at the end of each interval up to the order h^2 of
the integrator, and creep by the sum of these errors; the stiffness halves the error with each interval. (With 1 / h^2
the position at the end, ``p + h (v + h a)``, would be held exactly, but forces would jump from interval to interval.)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.actions import ContactForwardDynamics, ImpulseAction, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import Control, FrameTranslation, FrameVelocity, FrictionCone, StateError
from lgmpc.errors import InputError
from lgmpc.locomotion.sequence import GaitGrid, GaitSequence
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.footsteps import BaseLeap, BasePath, BaseProfile, Footsteps
from lgmpc.problems.ground import BodySpheres, GroundDistance, ProblemGround
from lgmpc.problems.legged_figures import LeggedFigures
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings, LeggedSettings, LeggedWeights, gains_of_contacts
from lgmpc.problems.motion import carry, contact_positions
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.typing import Array, typed

_FACETS = 8
SPEED_USED = 0.95
"""Fraction of the joints' speed limits at which their barriers begin."""


@typed
def build_gait(robot: Robot, settings: GaitSettings) -> Scenario:
    """Return the problem of a gait at a commanded velocity. Figures: :class:`LeggedFigures`.

    Raises:
        InputError: as :func:`build_legged`, or a ramp longer than half of the time in which feet swing.
    """
    s = settings
    check_legged(robot)
    gait = s.gait(robot)
    stop = gait.duration - s.settle_s
    most = (stop - s.settle_s) / 2.0
    if s.ramp_s > most * (1.0 + 1e-12):
        raise InputError("ramp_s", s.ramp_s, f"at most {most:g} s, half of the time in which feet swing")
    path = BasePath.walking(s.velocity_m_s, math.radians(s.yaw_rate_deg_s), s.settle_s, stop, s.ramp_s)
    return build_legged(s.pattern or "gait", robot, gait, path, s)


@typed
def build_jump(robot: Robot, settings: JumpSettings | None = None) -> Scenario:
    """Return the problem of a jump. Figures: :class:`LeggedFigures`.

    Raises:
        InputError: as :func:`build_legged`.
    """
    s = JumpSettings() if settings is None else settings
    check_legged(robot)
    leap = BaseLeap(
        np.array(s.displacement_m),
        math.radians(s.yaw_deg),
        s.takeoff_s,
        s.takeoff_s + s.flight_s,
        LeggedScale.of(robot).gravity,
    )
    return build_legged("jump", robot, s.gait(robot), leap, s)


@typed
def build_legged(
    name: str, robot: Robot, gait: GaitSequence, motion: BaseProfile, settings: LeggedSettings
) -> Scenario:
    """Return the problem of any gait along any motion of the base.

    The guess is the reference posture moved with the base, and the torques that balance it at rest.

    Args:
        name: a C identifier.
        robot: initially at rest in its reference posture.
        gait: of all its contact frames, with every foot on the ground at beginning and end.
        motion: motion of its base.
        settings: of weights, friction and grid.

    Raises:
        InputError: a robot without free base or contact frames, or a gait of other feet.
    """
    check_legged(robot)
    if gait.feet != robot.contact_frames:
        raise InputError("gait.feet", ", ".join(gait.feet), f"the contact frames ({', '.join(robot.contact_frames)})")
    grid = gait.grid(settings.step_s)
    start = contact_positions(robot, robot.x_reference[None])[0]
    ground = ProblemGround(settings.ground())
    steps = ground.laid(Footsteps.plan(gait, motion, start, robot.q_reference[:3]), robot.foot_points.radius)
    reference = reference_states(robot, motion, grid.times, ground, steps)
    problem = legged_problem(robot, grid, reference, steps, settings, ground)
    figures = LeggedFigures(robot, grid, steps, reference[-1], settings.friction, ground)

    return Scenario(
        name=name,
        robot=robot,
        problem=problem,
        guess=Trajectory(resting_guess(robot, grid, reference), carrying_efforts(robot, grid, reference[0])),
        durations=grid.durations,
        figures=figures.measure,
        contact_flags=grid.flags,
        contact_forces=figures.forces,
        waypoints=_waypoints(gait, steps),
        friction=settings.friction,
    )


def check_legged(robot: Robot) -> None:
    """Check that a robot has a free base, feet, and joints of one angle each.

    Raises:
        InputError: it lacks one of these.
    """
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", f"{robot.name} without feet", "a free base and contact_frames")
    if robot.nq - 7 != robot.nu:
        raise InputError("robot", f"{robot.name} with continuous joints", "joints of one angle each, which have limits")


def reference_states(robot: Robot, motion: BaseProfile, times: Array, ground: ProblemGround, steps: Footsteps) -> Array:
    """Return (N+1, nx) the reference posture moved with the base, from the start, raised as the footsteps are."""
    states = np.tile(robot.x_reference, (len(times), 1))
    position, turn = robot.q_reference[:3], np.asarray(pin.Quaternion(robot.q_reference[3:7]).matrix())
    for x, moved, velocity in zip(states, motion.placements(times), motion.velocities(times), strict=True):
        x[:3] = position + moved[:3, 3]
        x[3:7] = pin.Quaternion(moved[:3, :3] @ turn).coeffs()
        x[robot.nq : robot.nq + 6] = np.concatenate([velocity[:3] @ turn, velocity[3:] @ turn])
    return ground.raised(ground.placed(states), steps, times)


def resting_guess(robot: Robot, grid: GaitGrid, reference: Array) -> Array:
    """Return the reference with zero velocities except in flight: a moving base over resting feet is infeasible."""
    states = reference.copy()
    states[:-1][~grid.flight, robot.nq :] = 0.0
    states[-1, robot.nq :] = 0.0
    return states


def _waypoints(gait: GaitSequence, steps: Footsteps) -> tuple[Waypoint, ...]:
    marks = [
        Waypoint(f"{foot}, step {i + 1}", swing.touchdown, swing.end)
        for foot, swings in zip(gait.feet, steps.swings, strict=True)
        for i, swing in enumerate(swings)
    ]
    return tuple(sorted(marks, key=lambda mark: mark.time))


@dataclass(frozen=True)
class LeggedScale:
    """A robot's mass, leg length and gravity, and the units that follow from them.

    Dynamically similar robots have equal Froude numbers, and equal motions in these units (Alexander,
    "The gaits of bipedal and quadrupedal animals", Int. J. Robot. Res. 3, 1984).

    Attributes:
        mass: kg.
        length: height of the base above the feet in the reference posture, m.
        gravity: m/s2.
    """

    mass: float
    length: float
    gravity: float

    @classmethod
    def of(cls, robot: Robot) -> "LeggedScale":
        """Return the scale of a robot."""
        model, data = robot.model, robot.create_data()
        pin.framesForwardKinematics(model, data, robot.q_reference)
        feet = np.mean([data.oMf[i].translation[2] for i in robot.contact_ids])
        return cls(robot.mass, float(robot.q_reference[2] - feet), float(np.linalg.norm(robot.gravity)))

    @property
    def force(self) -> float:
        """The weight, N."""
        return self.mass * self.gravity

    @property
    def torque(self) -> float:
        """The weight times the length, N.m."""
        return self.force * self.length

    @property
    def time(self) -> float:
        """``sqrt(length / gravity)``, s."""
        return math.sqrt(self.length / self.gravity)

    @property
    def speed(self) -> float:
        """``sqrt(length gravity)``, m/s."""
        return self.length / self.time

    @property
    def impulse(self) -> float:
        """The mass times the speed, N.s."""
        return self.mass * self.speed


def legged_problem(
    robot: Robot,
    grid: GaitGrid,
    reference: Array,
    steps: Footsteps,
    settings: LeggedSettings,
    ground: ProblemGround,
    more: Sequence[CostItem] = (),
) -> ShootingProblem:
    """Return the problem.

    Args:
        robot: with free base and contact frames; initially at rest in its reference posture.
        grid: the intervals (N).
        reference: (N+1, nx) reference states.
        steps: reference positions of the feet.
        settings: weights, friction and grid.
        ground: from which the bodies keep a distance.
        more: further costs of the motion.
    """
    scale, w, places = LeggedScale.of(robot), settings.weights, steps.positions(grid.times)
    spheres = BodySpheres.optimised(robot)
    planes, boxes, solids = ground.solids(spheres, reference)
    dynamics = ContactForwardDynamics(robot.model, robot.contact_frames)
    deviation = StateError(dynamics.state, robot.x_reference)
    rate, state = 1.0 / scale.time, _state_weights(robot, scale, w)
    friction = settings.friction * (1.0 - settings.friction_margin)
    effort = robot.effort_limit * (1.0 - settings.effort_margin)
    within = QuadraticBarrier(*_range(robot, settings.joint_margin_rad))
    move = MultibodyAction(
        "legged_move",
        dynamics,
        [
            CostItem("posture", deviation, rate * state),
            CostItem("limits", deviation, rate * w.limits * _beyond(robot, scale), within),
            CostItem("effort", Control(robot.nu), rate * w.effort / scale.torque**2),
            *_cones(robot, friction, rate * w.friction / scale.force**2),
            *_feet(robot, rate * w.swing / scale.length**2),
            CostItem(
                "clearance",
                GroundDistance(spheres, planes, boxes),
                rate * w.clearance / scale.length**2,
                QuadraticBarrier(0.0, np.inf),
            ),
            *more,
        ],
        [ConstraintItem("torque", Control(robot.nu), -effort, effort)],
    )
    stop = np.repeat([w.touchdown / scale.speed**2, 0.0], 3)
    impact = ImpulseAction(
        "legged_impact",
        robot.model,
        robot.contact_frames,
        [
            *_cones(robot, friction, w.friction / scale.impulse**2),
            *_feet(robot, w.foothold / scale.length**2),
            *(
                CostItem(f"speed_{i}", FrameVelocity(foot, pin.LOCAL_WORLD_ALIGNED), stop)
                for i, foot in enumerate(robot.contact_frames)
            ),
        ],
    )
    problem = ShootingProblem([impact if hit else move for hit in grid.impacts], terminal=move)
    problem.set_initial_state(ground.placed(robot.x_reference[None])[0])
    moving, last = np.flatnonzero(~grid.impacts).tolist(), problem.nodes

    h = grid.durations[moving]
    problem.set("duration", h[:, None], moving)
    gains = gains_of_contacts(robot, settings.contact_gains, np.column_stack([0.25 / h**2, 1.0 / h]))
    problem.set("contact_gains", gains, moving)
    problem.set("contact_flags", grid.flags.astype(np.float64), range(last))
    problem.set("contact_points", places[moving].reshape(len(moving), -1), moving)
    problem.set("posture_reference", reference[[*moving, last]], [*moving, last])
    problem.set("posture_weight", w.terminal * state, [last])
    problem.set("effort_reference", carrying_efforts(robot, grid, reference[0])[moving], moving)
    problem.set("clearance_solids", solids, [*moving, last])
    problem.set(
        "clearance_lower", _distances(spheres, grid, steps, settings.clearance_m)[[*moving, last]], [*moving, last]
    )
    problem.set("clearance_weight", 0.0, [last])
    pressed = np.zeros(_FACETS + 1)
    pressed[-1] = settings.least_force * scale.force
    for i in range(robot.nc):
        problem.set(f"foot_{i}_reference", places[:, i])
        problem.set(f"cone_{i}_normal", ground.axes[:, 2], range(last))
        problem.set(f"cone_{i}_lower", np.outer(grid.flags[moving, i], pressed), moving)
        problem.set(f"foot_{i}_weight", 0.0, [*np.flatnonzero(grid.flags[:, i] & ~grid.impacts).tolist(), last])
        others = np.flatnonzero(grid.impacts & ~grid.touchdowns[:, i]).tolist()
        for item in ("foot", "speed"):
            problem.set(f"{item}_{i}_weight", 0.0, others)
    return problem


def _distances(spheres: BodySpheres, grid: GaitGrid, steps: Footsteps, clearance: float) -> Array:
    """Return (N+1, n) distances that spheres keep from the ground: feet in the air rise to it and return, others -1."""
    kept = np.tile(clearance * spheres.shares, (len(grid.times), 1))
    for column, swings in enumerate(steps.swings, start=len(spheres.shares) - len(steps.swings)):
        kept[:, column] = -1.0
        for swing in swings:
            s = swing.progress(grid.times)
            air = (s > 0.0) & (s < 1.0)
            kept[air, column] = clearance * 64.0 * (s[air] * (1.0 - s[air])) ** 3
    return kept


def carrying_efforts(robot: Robot, grid: GaitGrid, x: Array) -> Array:
    """Return (N, nu) the torques that balance the posture of state x (nx,) on the feet on the ground, in least squares.

    Zero in flight and at impacts.
    """
    known: dict[bytes, Array] = {}
    for flags in grid.flags:
        if flags.tobytes() not in known:
            _, known[flags.tobytes()] = carry(robot, x[: robot.nq], flags)
    efforts = np.array([known[flags.tobytes()] for flags in grid.flags])
    efforts[grid.impacts] = 0.0
    return efforts


def _cones(robot: Robot, friction: float, weight: float) -> list[CostItem]:
    inside = QuadraticBarrier(0.0, np.inf)
    return [
        CostItem(f"cone_{i}", FrictionCone(foot, _FACETS, friction), weight, inside)
        for i, foot in enumerate(robot.contact_frames)
    ]


def _feet(robot: Robot, weight: float) -> list[CostItem]:
    return [CostItem(f"foot_{i}", FrameTranslation(foot), weight) for i, foot in enumerate(robot.contact_frames)]


def _state_weights(robot: Robot, scale: LeggedScale, w: LeggedWeights) -> Array:
    """Return (ndx,) weights of base position, rotation, joints, and of their velocities."""
    length, speed, turn = scale.length**-2, scale.speed**-2, scale.time**2
    weights = (w.position * length, w.height * length, w.rotation, w.joints)
    rates = (w.velocity * speed, w.velocity * turn, w.joint_velocity * turn)
    return np.repeat([*weights, *rates], [2, 1, 3, robot.nu, 3, 3, robot.nu])


def _beyond(robot: Robot, scale: LeggedScale) -> Array:
    """Return (ndx,) inverse squared units of joint positions and speeds beyond their limits; zero for the base."""
    return np.repeat([0.0, 1.0, 0.0, scale.time**2], [6, robot.nu, 6, robot.nu])


def _range(robot: Robot, margin: float) -> tuple[Array, Array]:
    """Return (ndx,) the smallest and the largest deviation from the reference posture at rest."""
    free, speed = np.full(6, np.inf), SPEED_USED * robot.velocity_limit
    middle = robot.q_reference[robot.joint_q]
    lower = np.concatenate([-free, robot.joint_lower + margin - middle, -free, -speed])
    upper = np.concatenate([free, robot.joint_upper - margin - middle, free, speed])
    return lower, upper
