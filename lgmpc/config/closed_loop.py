"""The session of a closed loop: plant, controller and pushes, recorded and judged."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.config.robots import joint_limits
from lgmpc.config.session import ProgressReport, RunProgress, SessionResult
from lgmpc.control.legged import LeggedController
from lgmpc.control.modes import Mode
from lgmpc.control.report import TickReport
from lgmpc.errors import LgmpcError, cause_of
from lgmpc.estimation import LeggedEstimator, MeasurementMonitor
from lgmpc.lie import quaternion
from lgmpc.locomotion.command import MotionCommand
from lgmpc.locomotion.contacts import ContactState
from lgmpc.robot import Robot, leg_joints
from lgmpc.runs import Gate, Metrics, Outcome, Recorder, RunLog, Verdict, compute_metrics, judge
from lgmpc.runs.certificate import Balances, Certificate, certify, window_edges
from lgmpc.runs.ground import ground_below, leg_length
from lgmpc.runs.log import CONTACT_STATES, MODES
from lgmpc.runs.metrics import LinkDistances
from lgmpc.runs.modes import FALL_HEIGHT_FRACTION, FALL_TILT_DEG
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Hardware, Loop, Sensing, Tick, TrueState
from lgmpc.simulation.parameters import PlantSettings, momentum_and_energy, real_effort_limit
from lgmpc.simulation.plant import Plant
from lgmpc.status import Status
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyTerms
from lgmpc.world import World

_LOG = logging.getLogger(__name__)
_REPORT_PERIOD = 0.05  # s of simulated time
_MODE_CODES = {mode: MODES.index(mode.name.lower()) for mode in Mode}
_DISTANCE_PERIOD_S = 0.02
_LOW = (Mode.LIE, Mode.RISE, Mode.SIT, Mode.MANEUVER)
_STATE_CODES = {state: CONTACT_STATES.index(state.name.lower()) for state in ContactState}


def link_distances(robot: Robot, log: RunLog) -> LinkDistances | None:
    """Return how near links of a robot are every 20 ms of a log; None if their geometry is not known."""
    pairs, legs = robot.link_pairs, [leg_joints(robot, frame) for frame in robot.foot_ids]
    if not pairs.names:
        return None
    ticks = np.arange(0, log.finite_ticks, max(TimeGrid(log.control_period_s).nearest(_DISTANCE_PERIOD_S), 1))
    q = log.q[ticks]
    return LinkDistances(log.time[ticks], *pairs.distances(q), pairs.distances(q, pairs.between(legs))[0])


def failed(error: BaseException, time: float) -> str:
    """Log an exception that ended a run at ``time`` (s), and return the reason for the verdict."""
    unexpected = not isinstance(error, LgmpcError)
    _LOG.error("the run ended early, at %.3f s: %s", time, cause_of(error), exc_info=error if unexpected else None)
    return f"ended early, at {time:.3f} s: {cause_of(error)}"


def judged(
    log: RunLog, gate: Gate, distances: LinkDistances | None, *, elapsed_s: float | None = None, interrupted: bool,
    failure: str,
) -> tuple[Metrics | None, Verdict]:  # fmt: skip
    """Return metrics and verdict of a run, whatever ended it; no metrics without a tick of finite state.

    Args:
        log: at the full control rate.
        gate: the criteria of success.
        distances: of the robot's links.
        elapsed_s: duration of the run on the clock, s.
        interrupted: whether it was stopped by the user.
        failure: what else ended it early, in words; empty if nothing did.
    """
    if log.finite_ticks == 0:
        outcome = Outcome.INTERRUPTED if interrupted else Outcome.FAIL
        return None, Verdict(outcome, (failure or "stopped before the first tick",))
    metrics = compute_metrics(log, steady_from_s=gate.steady_from_s, elapsed_s=elapsed_s, distances=distances)
    verdict = judge(metrics, gate, interrupted=interrupted)
    return metrics, Verdict(Outcome.FAIL, (failure, *verdict.reasons)) if failure else verdict


@dataclass
class ClosedLoopSession:
    """A :class:`lgmpc.config.session.Session` of a closed loop.

    Attributes:
        robot: the controller's model.
        plant: the simulated robot and floor.
        controller: the controller.
        initial: (nq + nv,) initial state.
        pushes: the disturbances.
        ticks: control ticks.
        recorder: an empty recorder.
        log_every: control ticks per logged tick in the saved log.
        gate: the criteria of success.
        after_fall_s: time recorded after a fall, s; inf: to the end of the run.
        simulated: parameters in which the simulated robot differs from the controller's model.
        world: the world of the simulated robot.
        sensing: source of the controller's state; None for the plant's true state without delay.
        hardware: drives and delays that commands pass through, and computing times.
        estimator: estimator of the state from the measurements; None if the controller receives the true state.
        earlier: sessions with the settings before each change, and the tick at which each of them ends; they share the
            recorder.
        watch: called after each recorded tick; returns whether the run continues.
    """

    robot: Robot
    plant: Plant
    controller: LeggedController
    initial: Array
    pushes: PushSchedule
    ticks: TimeGrid
    recorder: Recorder
    log_every: int
    gate: Gate
    after_fall_s: float
    simulated: PlantSettings
    world: World
    sensing: Sensing | TrueState | None = None
    hardware: Hardware | None = None
    estimator: LeggedEstimator | None = None
    earlier: "tuple[tuple[ClosedLoopSession, int], ...]" = ()
    watch: Callable[[Tick], bool] | None = None
    _loop: Loop = field(init=False, repr=False)
    _elapsed: float = field(init=False, default=0.0)
    _fell_s: float = field(init=False, default=math.inf)
    _begun: int = field(init=False, default=0)  # number of ticks that were recorded by earlier sessions

    def __post_init__(self) -> None:
        self.plant.reset(self.initial)
        self._loop = Loop(self.plant, self.controller, self.pushes, self.ticks, self.sensing, self.hardware)
        if self.earlier:
            self.earlier[0][0]._loop.samples = []

    @property
    def log_bytes(self) -> int:
        """Size of the log's arrays, B."""
        return self.recorder.log_bytes(self.log_every)

    def run(self, progress: ProgressReport, scratch: Path | None = None) -> SessionResult:
        """Simulate to the end; see :meth:`lgmpc.config.session.Session.run`."""
        if scratch is not None:
            self.recorder.spill(scratch, self.log_bytes)
        interrupted, failure, active, before = False, "", self, None
        try:
            for active, end in (*self.earlier, (self, None)):
                if before is not None:
                    active._continue(before)
                    active._loop.samples = None if end is None else before._loop.samples
                if not active.advance(progress, end):
                    break
                before = active
        except KeyboardInterrupt:
            interrupted = True
        except (Exception, SystemExit) as error:
            failure = failed(error, active._loop.index * self.ticks.period)
        return active.result(interrupted=interrupted, failure=failure)

    def result(self, *, interrupted: bool, failure: str = "") -> SessionResult:
        """Judge what was recorded until now; arguments as of :func:`judged`."""
        log = self.recorder.log()
        distances = link_distances(self.robot, log)
        metrics, verdict = judged(
            log, self.gate, distances, elapsed_s=self._elapsed, interrupted=interrupted, failure=failure
        )
        # Without the first tick after a change, whose logged forces acted in a step of the session before.
        certificate = self._certificate(log.since(self._begun + 1) if self._begun else log, distances)
        return SessionResult(log.decimated(self.log_every), metrics, verdict, interrupted, certificate)

    def advance(self, progress: ProgressReport, until: int | None = None) -> bool:
        """Simulate up to tick ``until``, exclusive, or to the end; return whether no fall ended the run before.

        Raises:
            SolverError: the plant's state diverged.
            KeyboardInterrupt: from ``progress``.
            Exception: any other from estimator, controller or ``progress``.
        """
        observer = RunObserver(
            self.controller,
            self.recorder,
            self.ticks,
            progress,
            # Runs are judged by the true state, not by the estimate.
            truth=None if self.sensing is None else WholeBodyTerms(self.robot),
            estimator=self.estimator,
            monitor=None if self.estimator is None else self.estimator.monitor,
            after_fall_s=self.after_fall_s,
            fell_s=self._fell_s,
        )
        watch, started = self.watch, perf_counter()
        on_tick: Callable[[Tick], bool] = observer
        if watch is not None:
            on_tick = lambda tick: observer(tick) and watch(tick)  # noqa: E731
        try:
            return self._loop.run(on_tick, until)
        finally:
            self._elapsed += perf_counter() - started
            self._fell_s = observer.fell_s

    def _continue(self, before: "ClosedLoopSession") -> None:
        """Continue the run of another session, whose every state this one's sensors and controllers receive first."""
        samples = before._loop.samples
        assert samples is not None
        control = logging.getLogger("lgmpc.control")
        level = control.level
        control.setLevel(logging.CRITICAL)  # nothing that it decides happens
        try:
            self._loop.follow(samples)
        finally:
            control.setLevel(level)
        if self.controller.fallen and not before.controller.fallen:
            _LOG.warning("with the settings from %.3f s on, the controller gave up before", samples[-1].time)
        self.controller.take_estimates(before.controller)
        if self.plant is not before.plant:
            self.plant.resume(before.plant.sense())
        self._elapsed, self._fell_s, self._begun = before._elapsed, before._fell_s, self.recorder.ticks
        self.recorder.set_limits(
            friction=self.simulated.friction,
            effort_limit=real_effort_limit(self.robot, self.simulated),
            mass=self.simulated.mass_scale * self.robot.mass + self.simulated.base_added_mass_kg,
            world=self.world,
        )

    def _certificate(self, log: RunLog, distances: LinkDistances | None) -> Certificate | None:
        finite = log.until(log.finite_ticks)
        if finite.ticks < 2:
            return None
        robot, balances = self.robot, None
        whole = bool((np.diff(finite.time) < 1.5 * finite.control_period_s).all())
        if self.ticks.period == self.plant.dt and whole:  # every step of the plant is in the log
            edges = window_edges(finite)
            balances = Balances(edges, *momentum_and_energy(robot, self.simulated, finite.q[edges], finite.v[edges]))
        soft = self.world.soft
        stiffness = math.inf if soft is None else soft.stiffness_n_m
        return certify(finite, joint_limits(robot, self.simulated.actuators), balances, stiffness, distances)


class RunObserver:
    """Record every control tick, report the progress periodically, and end a run some time after a fall.

    Args:
        controller: whose reports are recorded.
        recorder: of the run.
        ticks: of the run.
        progress: called periodically.
        truth: terms of the controller's model, for runs judged by a state that the controller does not receive.
        estimator: whose estimate is recorded beside the true state.
        monitor: of measurements, whose faults are recorded.
        after_fall_s: time until the run ends after a fall, s.
        fell_s: time of a fall before, s.

    Attributes:
        fell_s: time of the fall, s; inf before one.
    """

    def __init__(
        self,
        controller: LeggedController,
        recorder: Recorder,
        ticks: TimeGrid,
        progress: ProgressReport,
        *,
        truth: WholeBodyTerms | None = None,
        estimator: LeggedEstimator | None = None,
        monitor: MeasurementMonitor | None = None,
        after_fall_s: float = math.inf,
        fell_s: float = math.inf,
    ) -> None:
        self._controller, self._truth, self._estimator, self._monitor = controller, truth, estimator, monitor
        self._record, self._record_plan = recorder.append, recorder.record_mpc
        self._channels, self._progress, self._hands = recorder.channels, progress, controller.wbc.hands
        self._reported = [name for name in ("joint_friction", "motor_shares", "forecast_ms") if name in self._channels]
        self._every, self._last = max(1, ticks.nearest(_REPORT_PERIOD)), ticks.count - 1
        self._duration = ticks.end
        self._lowest = FALL_HEIGHT_FRACTION * float(controller.robot.q_reference[2])
        self._after_fall, self.fell_s = after_fall_s, fell_s
        self._world, self._upright = recorder.world, controller.robot.upright_axis
        self._feet = controller.robot.foot_points
        # An update computes the contact points before the normals: those of the last update belong to them.
        self._next_normals = (controller.wbc.terms if truth is None else truth).normals
        self._normals = self._next_normals.copy()
        self._started, self._from = perf_counter(), math.nan
        # Arrays, which are recorded faster than sequences, of what seldom changes.
        self._command, self._velocities = MotionCommand(), np.zeros(3)
        self._states: list[ContactState] = []
        self._codes = np.zeros(0)

    def __call__(self, tick: Tick) -> bool:
        """Record a tick after its command was computed, and return whether the run continues."""
        sample, report = tick.sample, self._controller.report
        sensed: WholeBodyTerms | TickReport = report
        if self._truth is not None:
            sensed = self._truth
            sensed.update(sample.q, sample.v)
        if report.command is not self._command:
            self._command = command = report.command
            self._velocities[:] = command.vx, command.vy, command.yaw_rate
        if report.contact_states != self._states:
            self._states = list(report.contact_states)
            self._codes = np.array([_STATE_CODES[state] for state in self._states], dtype=np.float64)
        values: dict[str, ArrayLike] = {
            "time": sample.time, "q": sample.q, "v": sample.v, "tau": sample.tau, "tau_command": tick.torque,
            "contact_forces": sample.contact_forces, "contact_forces_desired": report.forces,
            "contact_points": sensed.contact_points, "contact_normals": self._normals, "com": sensed.com,
            "com_reference": report.com_target, "momentum": sensed.momentum, "base_reference": report.base_target,
            "push": tick.disturbance.wrench, "push_point": tick.disturbance.point,
            "wbc_status": 2 if tick.replaced else 0 if report.status is Status.CONVERGED else 1,
            "wbc_ms": report.tick_ms, "command": self._velocities, "mode": _MODE_CODES[report.mode],
            "gait_period_s": report.gait.period_s, "stance": report.stance, "contact_states": self._codes,
            "swing_targets": report.foot_targets, "footholds": report.footholds,
        }  # fmt: skip
        if self._estimator is not None:
            estimator = self._estimator
            values["estimate_q"] = tick.state.q if report.finite else math.nan
            values["estimate_v"] = tick.state.v if report.finite else math.nan
            feet, rejected = self._feet, estimator.rejected
            values["estimate_contacts"] = feet.touching(estimator.contacts).astype(np.int8) + feet.touching(rejected)
            values["estimate_ms"] = 1e3 * estimator.spent
        if self._monitor is not None:
            values["sensor_faults"] = self._monitor.faults
        for name in self._reported:
            values[name] = getattr(report, name)
        if "believed_ground" in self._channels:
            ground, (x, y, z) = report.ground, tick.state.q[:3].tolist()
            values["believed_ground"] = (z - ground.plane_at(x, y), *ground.slope)
        if self._hands:
            poses = np.array([hand.poses(sample.q) for hand in self._hands])
            values["hand_poses"], values["hand_targets"] = poses[:, 0], poses[:, 1]
        self._record(values)
        self._normals[...] = self._next_normals
        plan = report.plan
        if report.planned and plan is not None:
            failed = int(not plan.status.usable)
            self._record_plan(sample.time, plan.xs[:, :3], plan.first_forces, failed, report.plan_ms)
        if tick.number % self._every == 0 or tick.number == self._last:
            self._show(sample.time, sample.q, sensed.contact_points, report.mode)
        return sample.time < self.fell_s + self._after_fall

    def _show(self, time: float, q: Array, contact_points: Array, mode: Mode) -> None:
        elapsed = perf_counter() - self._started
        self._from = time if math.isnan(self._from) else self._from
        base = q[None, :7]
        leg = 0.0 if self._world.planar else leg_length(base[:, :3], contact_points[None])
        below, normal = ground_below(self._world, base[:, :3], leg)
        apart = quaternion.act.unchecked(q[3:7], self._upright) - normal[0]
        tilt = 2.0 * math.degrees(math.asin(min(0.5 * math.hypot(*apart.tolist()), 1.0)))
        height = (q[2] - below[0]) * normal[0, 2]
        if self.fell_s == math.inf and mode not in _LOW and (height < self._lowest or tilt > FALL_TILT_DEG):
            self.fell_s = time
            end = min(time + self._after_fall, self._duration)
            _LOG.warning("the robot fell at %.2f s; the run ends by %g s", time, end)
        self._progress(RunProgress(time, self._duration, tilt, (time - self._from) / elapsed if elapsed > 0 else 0.0))
