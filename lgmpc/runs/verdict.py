"""The verdict on a run by its gate."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum

from lgmpc.runs.figures import figure_of, judge_figures
from lgmpc.runs.gate import Gate
from lgmpc.runs.metrics import Metrics
from lgmpc.runs.modes import ModeMetrics
from lgmpc.runs.walking import WalkingMetrics

__all__ = ["Outcome", "Verdict", "judge", "measured"]


class Outcome(str, Enum):
    """The outcome of a run, as in ``run.json``."""

    PASS = "pass"
    FAIL = "fail"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Verdict:
    """The outcome of a run and its reasons: one sentence with numbers for each violated limit."""

    outcome: Outcome
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the run passed its gate."""
        return self.outcome is Outcome.PASS

    @property
    def exit_code(self) -> int:
        """The command line's exit code."""
        return {Outcome.PASS: 0, Outcome.FAIL: 1, Outcome.INTERRUPTED: 130}[self.outcome]


def judge(metrics: Metrics, gate: Gate, *, interrupted: bool = False) -> Verdict:
    """Compare a run's metrics with its gate.

    Args:
        metrics: of the run.
        gate: the limits.
        interrupted: whether the run was stopped before its end: it has neither passed nor failed.
    """
    if interrupted:
        return Verdict(Outcome.INTERRUPTED, (f"interrupted after {metrics.survived_s:.3g} s",))
    limits = dict(gate.limits)
    reasons = []
    if gate.max_falls == 0 and metrics.falls:
        del limits["max_falls"]
        reasons.append(f"the robot fell after {metrics.survived_s:.3g} s")
    values = {figure_of(limit): measured(metrics, limit) for limit in limits}
    reasons += judge_figures(values, limits, {limit: gate.phrase(limit) for limit in limits})
    return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))


def measured(metrics: Metrics, limit: str) -> float | None:
    """Return the metric of a limit of the gate; ``None`` if it was not measured.

    Its name is that of the limit, with or without ``max_`` or ``min_``, or that of a median duration; it is a metric of
    the run, of its walking or of its modes.
    """
    if limit in ("max_mpc_p50_ms", "max_wbc_p50_ms"):
        timing = metrics.mpc_ms if limit == "max_mpc_p50_ms" else metrics.wbc_ms
        return None if timing is None else timing.p50
    groups = ((metrics.walking, WalkingMetrics), (metrics.modes, ModeMetrics), (metrics, Metrics))
    for owner, kind in groups:
        for name in {each.name for each in fields(kind)} & {limit, figure_of(limit)}:
            value = getattr(owner, name, None)
            return None if value is None else float(value)
    raise AttributeError(limit)
