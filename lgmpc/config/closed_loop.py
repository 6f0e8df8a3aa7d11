"""The session that a config describes: plant, controller and pushes in closed loop, recorded and judged."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from time import perf_counter

from lgmpc.config.session import Progress, ProgressReport, SessionResult
from lgmpc.control.legged import LeggedController
from lgmpc.errors import SolverError
from lgmpc.estimation import LeggedEstimator
from lgmpc.locomotion.contacts import ContactState
from lgmpc.robot import Robot
from lgmpc.runs import Gate, Outcome, Recorder, Verdict, compute_metrics, judge
from lgmpc.runs.log import CONTACT_STATES
from lgmpc.runs.metrics import FALL_HEIGHT_FRACTION, FALL_TILT_DEG
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Rates, Sensing, Tick, simulate
from lgmpc.simulation.plant import Plant
from lgmpc.simulation.sensors import Sensors
from lgmpc.wbc import TickStatus, WholeBodyTerms

__all__ = ["ClosedLoopSession"]

_LOG = logging.getLogger(__name__)
_REPORT_PERIOD = 0.05  # s of simulated time
_STATE_CODES = {state: CONTACT_STATES.index(state.name.lower()) for state in ContactState}
_AFTERMATH = 0.5  # s that a fall is still watched: long enough for the replay, and nothing is learnt from more


@dataclass
class ClosedLoopSession:
    """A :class:`lgmpc.config.session.Session`; see there.

    Attributes:
        robot: the controller's model.
        plant: the simulated world.
        controller: the controller.
        pushes: the disturbances.
        rates: steps and ticks.
        recorder: empty.
        log_every: control ticks per logged tick in the saved log.
        gate: what counts as success.
        sensors: of the simulated robot; None, as the estimator, if the controller receives the plant's true state.
        estimator: of the state from what the sensors measure.
    """

    robot: Robot
    plant: Plant
    controller: LeggedController
    pushes: PushSchedule
    rates: Rates
    recorder: Recorder
    log_every: int
    gate: Gate
    sensors: Sensors | None = None
    estimator: LeggedEstimator | None = None

    @property
    def log_bytes(self) -> int:
        """Size of the log's arrays, B."""
        return self.recorder.log_bytes(self.log_every)

    def run(self, progress: ProgressReport) -> SessionResult:
        """Simulate from the robot's reference posture at rest; see :meth:`lgmpc.config.session.Session.run`."""
        observer = _Observer(self, progress)
        self.plant.reset(self.robot.x_reference)
        sensing = Sensing(self.sensors, self.estimator) if self.sensors and self.estimator else None
        interrupted, broken = False, ""
        started = perf_counter()
        try:
            simulate(self.plant, self.controller, self.pushes, self.rates, observer, sensing)
        except KeyboardInterrupt:
            interrupted = True
        except SolverError as error:
            broken = str(error)
            _LOG.error("the run ended early: %s", error)
        elapsed = perf_counter() - started
        log = self.recorder.log()
        if log.ticks == 0:
            return SessionResult(log, None, Verdict(Outcome.INTERRUPTED, ("stopped before the first tick",)), True)
        metrics = compute_metrics(log, steady_from_s=self.gate.steady_from_s, elapsed_s=elapsed)
        verdict = judge(metrics, self.gate, interrupted=interrupted)
        if broken:
            verdict = Verdict(Outcome.FAIL, (broken, *verdict.reasons))
        return SessionResult(log.decimated(self.log_every), metrics, verdict, interrupted)


class _Observer:
    """Record every control tick, report the progress now and then, and end a run soon after the robot fell."""

    def __init__(self, session: ClosedLoopSession, progress: ProgressReport) -> None:
        self._record = session.recorder.record
        self._record_plan = session.recorder.record_mpc
        self._record_steps = session.recorder.record_steps
        self._record_estimate = session.recorder.record_estimate
        self._estimator = session.estimator
        # Runs are judged by the true state, not by the estimate.
        self._truth = None if session.estimator is None else WholeBodyTerms(session.robot)
        self._controller = session.controller
        self._progress = progress
        self._duration = session.rates.ticks * session.rates.period
        self._every = max(1, round(_REPORT_PERIOD / session.rates.period))
        self._start_height = float(session.robot.q_reference[2])
        self._end = math.inf
        self._started = perf_counter()

    def __call__(self, tick: Tick) -> bool:
        sample, controller = tick.sample, self._controller
        wbc, planner = controller.wbc, controller.planner
        terms = wbc.terms
        if self._truth is not None and self._estimator is not None:
            estimator = self._estimator
            terms = self._truth
            terms.update(sample.q, sample.v)
            self._record_estimate(tick.state.q, tick.state.v, estimator.contacts, 1e3 * estimator.spent)
        feet, command = controller.feet, controller.command
        self._record_steps(
            command=(command.vx, command.vy, command.yaw_rate),
            gait_period_s=feet.clock.gait.period_s,
            stance=feet.stance,
            contact_states=[_STATE_CODES[state] for state in feet.events.states],
            swing_targets=feet.position,
            footholds=feet.footholds,
        )
        self._record(
            time=sample.time,
            q=sample.q,
            v=sample.v,
            tau=sample.tau,
            tau_command=tick.torque,
            contact_forces=sample.contact_forces,
            contact_forces_desired=wbc.forces,
            contact_points=terms.contact_points,
            com=terms.com,
            com_reference=controller.target,
            momentum=terms.momentum,
            base_reference=controller.base_target,
            push=tick.disturbance.wrench,
            push_point=tick.disturbance.point,
            wbc_status=0 if wbc.status is TickStatus.SOLVED else 1,
            wbc_ms=controller.wbc_ms,
        )
        if planner is not None and planner.planned and planner.plan is not None:
            plan = planner.plan
            failed = int(not plan.status.fresh)
            self._record_plan(sample.time, plan.xs[:, :3], plan.first_forces, failed, 1e3 * planner.spent)
        if tick.index % self._every == 0:
            self._report(sample.time, terms)
        return sample.time < self._end

    def _report(self, time: float, terms: WholeBodyTerms) -> None:
        elapsed = perf_counter() - self._started
        tilt = math.degrees(math.acos(min(max(float(terms.rotation[2, 2]), -1.0), 1.0)))
        if math.isinf(self._end) and (tilt > FALL_TILT_DEG or terms.q[2] < FALL_HEIGHT_FRACTION * self._start_height):
            _LOG.warning("the robot fell at %.2f s; the run ends %g s later", time, _AFTERMATH)
            self._end = time + _AFTERMATH
        self._progress(Progress(time, self._duration, tilt, time / elapsed if elapsed > 0 else 0.0))
