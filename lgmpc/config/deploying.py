"""The two ends of a deployment, from one config: the controllers on a robot, and a simulated robot to test them."""

import json
import logging
import math
from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from lgmpc.config.build import build_controller, build_drives, build_estimator, build_mpc, build_recorder, build_sensors
from lgmpc.config.closed_loop import RunObserver, judged, link_distances
from lgmpc.config.execution import FinishedRun, run_session
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import Config, GroundTruth
from lgmpc.config.session import Notify, ProgressReport, SessionResult, ignore
from lgmpc.control.interface import Command, CommandGuard, Measurement, command_limits
from lgmpc.control.legged import LeggedController
from lgmpc.estimation import LeggedEstimator, LeggedEstimatorSettings
from lgmpc.hardware.deployment import DeployedTick, Deployment, Driver, StopReason, deploy
from lgmpc.hardware.realtime import raise_priority, real_time
from lgmpc.hardware.safety import JointLimits, Operator
from lgmpc.hardware.simulated import LockStep, NoControllerError, RealTime, RobotLink, Served, serve
from lgmpc.locomotion.command import CommandSource, MotionCommand
from lgmpc.mpc import Mpc
from lgmpc.mpc.process import ProcessMpc
from lgmpc.robot import Robot
from lgmpc.runs import Gate, Metrics, Outcome, Recorder, Verdict, atomic_write
from lgmpc.runs.folder import DEPLOYMENT_FILE
from lgmpc.simulation import make_plant
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.drives import Computing, Spent, TimingSettings
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.loop import Disturbance, Hardware, Tick, control_ticks
from lgmpc.simulation.plant import PlantSample
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array
from lgmpc.world import make_world

_LOG = logging.getLogger(__name__)


def deploy_config(
    config: Config,
    driver: Callable[[Robot], Driver],
    out: str | Path = "runs",
    *,
    notify: Notify = ignore,
    progress: ProgressReport = ignore,
    operator: Operator | None = None,
    dry_run: bool = False,
    prepared: "Callable[[DeploymentSession], None]" = ignore,
) -> tuple[FinishedRun, Deployment]:
    """Run the controllers of ``config`` on a robot, in real time, and save the run.

    The run folder is that of :func:`lgmpc.config.execution.run_config`, with the estimated state in place of the true
    one, and contact forces estimated from the torques; it has no certificate, and ``deployment.json`` besides. The gate
    judges what a robot measures: :data:`UNMEASURED` says what it does not. Torques are judged as requested of the
    drives, without the noise of measured ones.

    Args:
        config: the closed loop; of its plant, the rates and the initial posture are used.
        driver: constructs the driver of the robot from its model, after everything else is ready: a
            :class:`lgmpc.hardware.UdpDriver`, or one's own.
        out: folder of run folders.
        notify: called with a description of what is being prepared.
        progress: called with the progress of the run.
        operator: emergency stop, arming and lying down by the person who watches; none unless given.
        dry_run: whether nothing is sent to the robot.
        prepared: called when all is ready, before the driver is constructed; it may watch the ticks and replace the
            commands.

    Returns:
        The run, and the figures of link and loop.

    Raises:
        ConfigError: if the config changes settings during the run.
        LgmpcError: as :func:`lgmpc.config.execution.run_config`.
    """
    if isinstance(config.estimator, GroundTruth):
        _LOG.warning("the config has no estimator: inekf with its defaults estimates the state")
        config = config.model_copy(update={"estimator": LeggedEstimatorSettings()})
    sessions: list[DeploymentSession] = []

    def prepare(announce: Notify) -> DeploymentSession:
        session = _prepare(config, driver, announce)
        session.operator, session.dry_run = Operator() if operator is None else operator, dry_run
        prepared(session)
        sessions.append(session)
        return session

    finished = run_session(config, prepare, out, notify=notify, progress=progress)
    deployment = sessions[0].deployment
    assert deployment is not None
    with atomic_write(finished.folder.path / DEPLOYMENT_FILE) as file:
        figures = _figures(deployment) | {"not_measured": not_measured(config.gate)}
        file.write((json.dumps(figures, indent=2, allow_nan=False) + "\n").encode())
    return finished, deployment


def serve_config(
    config: Config,
    link: Callable[[Robot], RobotLink],
    *,
    lock_step: bool = False,
    wait_s: float = math.inf,
    notify: Notify = lambda message: None,
) -> Served:
    """Simulate the robot of ``config`` at the end of a link, with its sensors, drives and pushes.

    Args:
        config: the closed loop; of its controllers, only the rates are used.
        link: constructs the robot's end of the link from its model; it is closed at the end.
        lock_step: whether the robot waits for the answer to each measurement, instead of moving in real time.
        wait_s: longest time to wait for a controller, s.
        notify: called with a description of what is being done.

    Returns:
        The motion until the end or, after a KeyboardInterrupt, until then.

    Raises:
        LgmpcError: if the robot cannot be built, or no controller connects within ``wait_s``.
        KeyboardInterrupt: before the first command.
    """
    robot = build_robot(config)
    world = make_world(config.world, config.plant.friction, config.seed)
    plant = make_plant(robot, config.plant, world)
    ticks = control_ticks(plant.dt, config.wbc.rate_hz, config.duration_s + config.deployment.lie_down_s)
    computing = Computing(TimingSettings(), np.random.default_rng(0))
    guard = CommandGuard(config.deployment.damping_nms, command_limits(robot.effort_limit))
    hardware = Hardware(build_drives(config, robot, plant), computing, lambda: Spent(0.0, False, False), guard)
    priority = 0 if lock_step else config.deployment.priority  # in lock step it computes all the time
    with real_time(priority), closing(link(robot)) as end:
        notify(f"{robot.name} waits for a controller at {end.place}")
        if not end.wait_for_controller(wait_s):
            raise NoControllerError(f"no controller within {wait_s:g} s")
        plant.reset(initial_state(robot, config.plant, world))
        pace: LockStep | RealTime = LockStep(end) if lock_step else RealTime(end, ticks.period)
        pushes = PushSchedule(config.pushes, plant.dt, plant.bodies)
        return serve(plant, build_sensors(config, robot), pushes, ticks, pace, world, hardware)


def _prepare(config: Config, driver: Callable[[Robot], Driver], notify: Notify) -> "DeploymentSession":
    if config.changes:
        raise config.error("changes", f"{len(config.changes)} entries", "none: only simulated runs change settings")
    notify("loading the robot")
    robot = build_robot(config)
    controller = build_controller(config, robot, notify)
    start = initial_state(robot, config.plant, make_world(config.world, config.plant.friction, config.seed))
    estimator = build_estimator(config, robot, controller, start[:7], notify)
    assert estimator is not None
    ticks = control_ticks(1.0 / config.plant.rate_hz, config.wbc.rate_hz, config.duration_s)
    _warm_up(controller, estimator, start[7 : robot.nq], ticks)
    _arrange_planning(config, controller)
    recorder = build_recorder(config, robot, ticks, estimated=False)
    return DeploymentSession(config, controller, ticks, recorder, estimator, driver)


def _warm_up(controller: LeggedController, estimator: LeggedEstimator, joints: Array, ticks: TimeGrid) -> None:
    """Make what the first ticks would make, buffers and bound calls, by some ticks at rest that are then forgotten."""
    still, nothing, upward = np.zeros(3), np.zeros(len(joints)), -np.array(controller.robot.gravity)
    torques = nothing
    for time in ticks.nodes[:5].tolist():
        reading = Measurement(time, still, upward, joints, nothing, torques)
        torques = controller.update(estimator.update(reading)).tau
    controller.reset()
    estimator.reset()


def _arrange_planning(config: Config, controller: LeggedController) -> None:
    """Let the MPC plan when the config says so."""
    planner, planning, reacts = controller.planner, config.deployment.planning, config.locomotion.reaction.enabled
    if planner is None:
        return
    planner.deferred = planning == "after_command" and not reacts
    if planning == "own_process":
        if reacts:
            expected = "another: steps against pushes are forecast in the loop's own process (locomotion.reaction)"
            raise config.error("deployment.planning", planning, expected)
        planner.mpc = ProcessMpc(partial(_own_mpc, config), config.mpc)


def _own_mpc(config: Config) -> Mpc:
    if config.deployment.priority:
        raise_priority(config.deployment.priority)
    return build_mpc(config, build_robot(config))


@dataclass
class DeploymentSession:
    """A :class:`lgmpc.config.session.Session` whose plant is a robot.

    Attributes:
        config: the closed loop.
        controller: the controller.
        ticks: of the run.
        recorder: an empty recorder.
        legs: the estimator.
        driver: constructs the driver of the robot.
        operator: the person who watches.
        dry_run: whether nothing is sent.
        watch: called after each recorded tick.
        deployment: figures of link and loop, after the run.
    """

    config: Config
    controller: LeggedController
    ticks: TimeGrid
    recorder: Recorder
    legs: LeggedEstimator
    driver: Callable[[Robot], Driver]
    operator: Operator = field(default_factory=Operator)
    dry_run: bool = False
    watch: Callable[[Tick], bool] | None = None
    deployment: Deployment | None = None

    @property
    def log_bytes(self) -> int:
        """Size of the log's arrays, B."""
        return self.recorder.log_bytes(self.config.log_every)

    def run(self, progress: ProgressReport, scratch: Path | None = None) -> SessionResult:
        """Run until the end of the config's duration, by the robot's clock. Ticks are in memory: a file's may wait."""
        # The estimate takes the place of the true state, and a fall does not end the run.
        observer = RunObserver(self.controller, self.recorder, self.ticks, progress, monitor=self.legs.monitor)
        nothing = Disturbance(np.zeros(6), np.zeros(3))

        def record(tick: DeployedTick) -> None:
            measured, state = tick.measurement, tick.state
            sample = PlantSample(state.time, state.q, state.v, measured.torques, self.legs.legs.forces)
            torque = tick.command.torque(measured.joints, measured.speeds)
            recorded = Tick(tick.index, sample, state, tick.command, tick.replaced, torque, nothing)
            observer(recorded)
            if self.watch is not None:
                self.watch(recorded)

        def finish() -> None:
            controller.finish()
            if apart is not None and planner is not None and apart.arrived:
                planner.expire()  # the next tick takes the plan

        robot, controller, planner = self.controller.robot, self.controller, self.controller.planner
        apart = planner.mpc if planner is not None and isinstance(planner.mpc, ProcessMpc) else None
        controller.finishes = False
        controller.commands = _LyingAtTheEnd(controller.commands, self.operator)
        with closing(apart) if apart is not None else nullcontext():
            driver = self.driver(robot)
            self.deployment = deploy(
                _Listening(driver) if self.dry_run else driver,
                self.controller,
                self.legs,
                ticks=self.ticks,
                settings=self.config.deployment,
                after_command=finish,
                on_tick=record,
                limits=JointLimits(robot.joint_names, robot.effort_limit, robot.velocity_limit),
                operator=self.operator,
            )
        ending = self.deployment.ending
        early = ending not in (StopReason.DURATION, StopReason.INTERRUPTED)
        failure = self.deployment.failure or (ending.value if early else "")
        interrupted = ending is StopReason.INTERRUPTED
        log = self.recorder.log()
        gate = self.config.gate
        metrics, verdict = judged(
            replace(log, tau=np.clip(log.tau_command, -log.effort_limit_over_time, log.effort_limit_over_time)),
            gate.model_copy(update=dict.fromkeys(not_measured(gate))),
            link_distances(robot, log),
            interrupted=interrupted,
            failure=failure,
        )
        if metrics is not None:
            metrics = _without_unmeasured(metrics)
        if self.dry_run:
            verdict = Verdict(Outcome.INTERRUPTED, ("dry run: nothing was sent", *verdict.reasons))
        if self.deployment.too_slow and verdict.outcome is Outcome.FAIL:
            verdict = Verdict(Outcome.FAIL, (*verdict.reasons, self.deployment.too_slow))
        return SessionResult(log.decimated(self.config.log_every), metrics, verdict, interrupted)


UNMEASURED = (
    "max_slip_m",
    "max_scuff_m",
    "min_friction_margin_n",
    "max_peak_impact_n",
    "max_odometry_drift_percent",
    "min_real_time_factor",
)
"""Limits of a gate on quantities that need the true contacts, forces or positions, or a simulation."""


def not_measured(gate: Gate) -> tuple[str, ...]:
    """Return the limits of a gate that a run on a robot cannot be judged by: it measures no contacts."""
    return tuple(name for name in UNMEASURED if name in gate.limits)


def _without_unmeasured(metrics: Metrics) -> Metrics:
    walking = metrics.walking
    if walking is not None:
        walking = replace(walking, max_scuff_m=math.nan, peak_impact_n=None)
    return replace(metrics, max_slip_m=math.nan, min_friction_margin_n=None, walking=walking)


class _Listening:
    """A driver that sends nothing: a dry run."""

    def __init__(self, driver: Driver) -> None:
        self.read, self.close = driver.read, driver.close

    def write(self, command: Command) -> None:
        pass


@dataclass(frozen=True)
class _LyingAtTheEnd:
    """Commands of a source, until the robot shall lie down."""

    source: CommandSource
    operator: Operator

    def at(self, t: float) -> MotionCommand:
        return MotionCommand(mode="lie") if self.operator.lies else self.source.at(t)


def _figures(deployment: Deployment) -> dict[str, object]:
    """Return the content of ``deployment.json``."""
    flags = None if deployment.error_flags is None else deployment.error_flags.tolist()
    content = {**vars(deployment), "ending": deployment.ending.name.lower(), "error_flags": flags}
    spent = 1e3 * content.pop("spent")
    if spent.size:
        p50, p99 = np.percentile(spent, [50.0, 99.0])
        content |= {"command_p50_ms": p50, "command_p99_ms": p99, "command_max_ms": spent.max()}
    return content
