"""Construction of a closed loop from its config: the only module that imports every package."""

import math
from collections.abc import Callable

import numpy as np

from lgmpc.compile import reporting
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.extensions import called, load_extension, own_costs, own_tasks, wrong
from lgmpc.config.maneuvers import build_maneuvers
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import Config, GroundTruth
from lgmpc.config.session import Notify, Session
from lgmpc.control.interface import CommandGuard, Measurement, RobotState
from lgmpc.control.legged import LeggedController
from lgmpc.control.planner import Planner
from lgmpc.control.reference import StandReference
from lgmpc.errors import InputError
from lgmpc.estimation import FrictionMonitor, JointFaultMonitor, JointFrictionEstimator, LeggedEstimator
from lgmpc.estimation.joint_faults import legs_of_three
from lgmpc.locomotion.command import CommandTimeline
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.maps import ElevationMap, KnownMap, KnownMapSettings, NoMap, OwnMapSettings, SeenMap
from lgmpc.locomotion.settings import gaits_of
from lgmpc.mpc import Mpc, make_mpc
from lgmpc.robot import Robot
from lgmpc.runs import Recorder
from lgmpc.simulation import Plant, make_plant
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.drives import Computing, Drives, Spent, StateLink
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.loop import Hardware, Sensing, TrueState, control_ticks
from lgmpc.simulation.parameters import real_effort_limit
from lgmpc.simulation.sensors import DepthScan, Sensors
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyController, standard_tasks
from lgmpc.world import World, make_world

_MAP, _RANGE, _ABOVE = "locomotion.terrain.map", 5.0, 0.5
"""Key of the map, and defaults of what is seen, in heights of the centre of mass."""
_LINK, _DRIVES, _COMPUTING, _MAP_ERRORS = 1, 2, 3, 5
"""Numbers of the random streams besides that of the sensors, each seeded by the config's seed."""


def build_sensors(config: Config, robot: Robot) -> Sensors:
    """Return the simulated sensors of section ``sensors``, their noise seeded by ``seed``."""
    return Sensors(robot, config.sensors, 1.0 / config.wbc.rate_hz, np.random.default_rng(config.seed))


def build_drives(config: Config, robot: Robot, plant: Plant) -> Drives:
    """Return the simulated drives of section ``plant``, their jitter and losses seeded by ``seed``."""
    rng = np.random.default_rng((config.seed, _DRIVES))
    limits = dict(zip(robot.joint_names, real_effort_limit(robot, config.plant).tolist(), strict=True))
    return Drives(config.plant.link, config.plant.actuators, plant.dt, rng, limits)


def build_estimator(
    config: Config,
    robot: Robot,
    controller: LeggedController | None = None,
    start: Array | None = None,
    notify: Notify = lambda message: None,
) -> LeggedEstimator | None:
    """Return the estimator of section ``estimator``; None if the controllers receive the simulator's state.

    Args:
        config: the closed loop.
        robot: from :func:`build_robot`.
        controller: whose belief of the ground the estimator reads; a level floor unless given.
        start: (7,) pose of the base at the start; that of the reference posture unless given.
        notify: called with a description of what is being prepared.
    """
    if isinstance(config.estimator, GroundTruth):
        return None
    with reporting(notify):
        estimator = LeggedEstimator(robot, 1.0 / config.wbc.rate_hz, config.estimator, start)
    if controller is not None:
        estimator.ground = controller.feet.ground
    return estimator


def build_controller(
    config: Config,
    robot: Robot,
    notify: Notify = lambda message: None,
    world: World | None = None,
    pose: Callable[[], Array] | None = None,
) -> LeggedController:
    """Return the controller of sections ``mpc``, ``wbc``, ``locomotion``, ``commands`` and ``reference``.

    Args:
        config: the closed loop.
        robot: from :func:`build_robot`, which checks that the config fits it.
        notify: called with a description of what is being prepared.
        world: of the simulated robot, for its map.
        pose: returns the true pose (7,) of its base, for what it sees.
    """
    period, delay, friction = 1.0 / config.wbc.rate_hz, config.delays.total_s, config.joint_friction
    faults = None if legs_of_three(robot) is None else config.joint_faults
    gaits = gaits_of(robot, config.locomotion)
    mpc = build_mpc(config, robot, notify) if config.mpc.enabled else None
    controller = LeggedController(
        robot,
        _build_whole_body(config, robot),
        FrictionMonitor(config.wbc.friction, period, points=robot.foot_points),
        Planner(robot, mpc, period, delay) if mpc is not None else None,
        commands=CommandTimeline(config.commands, gaits=gaits),
        offset=None if isinstance(config.reference, StandReference) else config.reference,
        locomotion=config.locomotion,
        gaits=gaits,
        modes=config.modes,
        delays=config.delays,
        joint_friction=None if friction is None else JointFrictionEstimator(robot, period, friction),
        joint_faults=None if faults is None else JointFaultMonitor(robot, period, faults, delay),
        drives=config.drives,
        maneuvers=build_maneuvers(config, robot, notify),
        period=period,
    )
    elevation = build_map(config, robot, world, pose)
    if elevation is not None:
        controller.feet.read_map(elevation, controller.wbc.terms.q[:7])
    return controller


def build_map(
    config: Config, robot: Robot, world: World | None = None, pose: Callable[[], Array] | None = None
) -> ElevationMap | None:
    """Return the map of key ``locomotion.terrain.map``, or None.

    Args:
        config: the closed loop.
        robot: the controller's model.
        world: of the simulated robot, if it is one.
        pose: returns the true pose (7,) of its base.

    Raises:
        ConfigError: one's own class cannot be used, or a map of the simulated world on a robot.
    """
    settings = config.locomotion.terrain.map
    if isinstance(settings, NoMap):
        return None
    if isinstance(settings, OwnMapSettings):
        found = called(config, _MAP, settings, load_extension(config, _MAP, settings.use))
        if not isinstance(found, ElevationMap):
            raise wrong(config, _MAP, settings, found, "an object with update, height and steppable")
        return found
    if world is None or pose is None:
        raise config.error(f"{_MAP}.kind", f"'{settings.kind}' without a simulated world", "'none' or 'own'")
    legs = LegGeometry.of(robot)
    height, scale = legs.height, legs.scale
    rng = np.random.default_rng((config.seed if settings.seed is None else settings.seed, _MAP_ERRORS))
    if isinstance(settings, KnownMapSettings):
        return KnownMap(world.height, settings, scale, rng)
    reach = _RANGE * height if settings.range_m is None else settings.range_m
    above = _ABOVE * height if settings.above_m is None else settings.above_m
    seen = SeenMap(lambda: scan(), settings, scale)
    scan = DepthScan(world.height, pose, reach, seen.cell, above, settings.noise_m, rng)
    return seen


def build_mpc(config: Config, robot: Robot, notify: Notify = lambda message: None) -> Mpc:
    """Return the predictive controller of section ``mpc``."""
    costs = own_costs(config, robot)
    try:
        with reporting(notify):
            return make_mpc(robot, config.mpc, costs)
    except InputError as error:
        if not costs:
            raise
        raise config.error("mpc.costs", f"{error.argument}: {error.got}", error.expected) from error


def _build_whole_body(config: Config, robot: Robot) -> WholeBodyController:
    own = own_tasks(config, robot)
    try:
        return WholeBodyController(robot, config.wbc, [*standard_tasks(robot, config.wbc), *own])
    except InputError as error:
        if not own:
            raise
        raise config.error("wbc.tasks", f"{error.argument}: {error.got}", error.expected) from error


def build_recorder(
    config: Config, robot: Robot, ticks: TimeGrid, *, estimated: bool, world: World | None = None
) -> Recorder:
    """Return an empty recorder.

    Args:
        config: the closed loop.
        robot: its robot.
        ticks: of the run.
        estimated: whether an estimate is recorded beside the true state.
        world: the world of a simulated robot; None for a real one, whose limits and mass are those of the model.
    """
    plant, effort_limit, mass, friction = config.plant, robot.effort_limit, robot.mass, config.wbc.friction
    if world is not None:
        effort_limit, friction = real_effort_limit(robot, plant), plant.friction
        mass = plant.mass_scale * mass + plant.base_added_mass_kg
    mpc = next((part.mpc for _, part in config.parts() if part.mpc.enabled), None)
    optional = {
        "belief": world is not None and bool(robot.contact_frames) and not world.level,
        "estimate": estimated,
        "fault": not isinstance(config.estimator, GroundTruth) and config.estimator.replace_implausible,
        "friction": config.joint_friction is not None,
        "motor": any(part.plant.actuators.faults for _, part in config.parts()),
        "forecast": config.locomotion.reaction.enabled,
        "hand": bool(config.wbc.hands),
    }
    return Recorder(
        nq=robot.nq, nv=robot.nv, effort_limit=effort_limit, joint_names=robot.joint_names, mass=mass,
        optional={name for name, recorded in optional.items() if recorded}, hands=len(config.wbc.hands),
        contact_frames=robot.contact_frames, contact_radius=robot.foot_points.radius, friction=friction,
        upright_axis=robot.upright_axis, world=world, control_period_s=ticks.period, ticks=ticks.count,
        mpc_nodes=0 if mpc is None else mpc.nodes, mpc_period_s=0.0 if mpc is None else 1.0 / mpc.rate_hz,
        mpc_updates=0 if mpc is None else int(config.duration_s * mpc.rate_hz) + 1,
    )  # fmt: skip


def prepare(config: Config, *, notify: Notify = lambda message: None) -> Session:
    """Build the session of a closed loop.

    Args:
        config: the closed loop.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: what cannot be built, naming the key.
    """
    session: ClosedLoopSession | None = None
    for begin_s, part in config.parts():
        session = _build_session(config, part, notify, session, begin_s)
    assert session is not None
    return session


def _build_session(
    whole: Config, config: Config, notify: Notify, before: ClosedLoopSession | None, begin_s: float
) -> ClosedLoopSession:
    """Return the session of a part of a run, which begins at ``begin_s`` and continues another session."""
    notify("loading the robot")
    robot = build_robot(config)
    world = make_world(config.world, config.plant.friction, config.seed)
    same = before is not None and before.simulated == config.plant
    plant = before.plant if before and same else make_plant(robot, config.plant, world)
    controller = build_controller(config, robot, notify, world, lambda: plant.sense().q[:7])
    initial = initial_state(robot, config.plant, world)
    estimator = build_estimator(config, robot, controller, initial[:7], notify)
    ticks = control_ticks(plant.dt, config.wbc.rate_hz, config.duration_s)
    estimated = estimator is not None
    recorder = before.recorder if before else build_recorder(whole, robot, ticks, estimated=estimated, world=world)
    return ClosedLoopSession(
        robot=robot, plant=plant, controller=controller, initial=initial, estimator=estimator, world=world,
        pushes=PushSchedule(config.pushes, plant.dt, plant.bodies), simulated=config.plant,
        ticks=ticks, recorder=recorder, log_every=config.log_every, gate=config.gate,
        after_fall_s=math.inf if config.after_fall_s is None else config.after_fall_s,
        sensing=_build_sensing(config, robot, estimator),
        hardware=_build_hardware(config, plant, controller, estimator),
        earlier=(*before.earlier, (before, ticks.nearest(begin_s))) if before else (),
    )  # fmt: skip


def _build_sensing(config: Config, robot: Robot, estimator: LeggedEstimator | None) -> Sensing | TrueState | None:
    """Return the source of the controller's state; None for the plant's true state without delay."""
    link = config.plant.link
    rng = np.random.default_rng((config.seed, _LINK))
    if estimator is not None:
        way = None if link.transparent else StateLink[Measurement](link, rng)
        return Sensing(build_sensors(config, robot), estimator, way)
    return None if link.transparent else TrueState(StateLink[RobotState](link, rng), robot.nu)


def _build_hardware(
    config: Config, plant: Plant, controller: LeggedController, estimator: LeggedEstimator | None
) -> Hardware:
    """Return drives, delays and computing times, their random numbers seeded by ``seed``."""
    computing = Computing(config.timing, np.random.default_rng((config.seed, _COMPUTING)))

    def measured() -> Spent:
        report = controller.report
        time = 1e-3 * (report.tick_ms + report.plan_ms + report.forecast_ms)
        time += 0.0 if estimator is None else estimator.spent
        return Spent(time, report.planned, report.forecast_ms > 0.0)

    guard = CommandGuard(config.wbc.fallback_damping_nms)
    return Hardware(build_drives(config, controller.robot, plant), computing, measured, guard)
