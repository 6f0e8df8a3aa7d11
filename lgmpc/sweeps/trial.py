"""One point of a sweep, computed in a worker process through what ``lgmpc run`` uses."""

import logging
import resource
import signal
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from lgmpc.config.build import prepare
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.schema import Config
from lgmpc.errors import Interrupted
from lgmpc.runs import flat_metrics
from lgmpc.sweeps.design import scaled
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.settings import BisectionSettings


@dataclass(frozen=True)
class Trial:
    """The data of a point that a worker receives.

    Attributes:
        key: key of the point.
        config: config of the point.
        bisect: the search, if there is one.
        metrics: names of the metrics to keep; all if ``None``.
        scratch: folder of the run folders.
        memory_gb: memory that the process may allocate from then on, GB.
    """

    key: str
    config: Config
    bisect: BisectionSettings | None
    metrics: tuple[str, ...] | None
    scratch: Path
    memory_gb: float


def start_worker() -> None:
    """Prepare a worker process: without output, and ended by the process that started it, not by signals to both.

    So a point whose machine ends, with a signal to all its processes, is computed again, and not one that died.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    logging.getLogger("lgmpc").addHandler(logging.NullHandler())
    warnings.simplefilter("ignore")


def warm(config: Config) -> None:
    """Build the session of a config, so that its compiled functions are in the cache.

    An exception is the reason of the rows of the config's points.
    """
    with suppress(Exception):
        prepare(config)


def compute(task: Trial) -> Row:
    """Run a point, or search its boundary; exceptions become the reason of its row.

    Raises:
        Interrupted: by Ctrl-C during a run.
    """
    started, simulated_s = perf_counter(), 0.0
    _limit_memory(task.memory_gb)

    def run(config: Config) -> FinishedRun:
        nonlocal simulated_s
        finished = run_config(config, task.scratch)
        if finished.signal is not None:
            raise Interrupted(finished.signal)
        log = finished.session.log
        simulated_s += float(log.time[-1] - log.time[0]) + log.control_period_s if log.ticks else 0.0
        return finished

    try:
        if task.bisect is None:
            row = _judged(task, run(task.config))
        else:
            key = task.bisect.key
            found = bisect(lambda x: run(scaled(task.config, key, x)).result.verdict.passed, task.bisect)
            row = Row(
                task.key,
                Ending.UNBRACKETED if found.value is None else Ending.PASS,
                (found.reason,) if found.reason else (),
                boundary=found.value,
                trials=found.trials,
            )
    except Exception as error:
        row = Row(task.key, Ending.RAISED, (f"{type(error).__name__}: {error}",))
    return replace(row, simulated_s=simulated_s, elapsed_s=perf_counter() - started)


def _judged(task: Trial, run: FinishedRun) -> Row:
    """Return the row of a single run."""
    verdict, measured = run.result.verdict, run.result.metrics
    metrics = {} if measured is None else flat_metrics(measured)
    if task.metrics is not None:
        metrics = {name: metrics.get(name) for name in task.metrics}
    return Row(task.key, Ending.PASS if verdict.passed else Ending.FAIL, verdict.reasons, metrics)


def _limit_memory(gigabytes: float) -> None:
    """Limit the allocations of this process, which raise beyond the limit instead of exhausting the memory."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = int(1e9 * gigabytes)
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


@dataclass(frozen=True)
class Boundary:
    """The result of a bisection.

    Attributes:
        value: the largest value that passed; ``None`` if both ends of the range have the same verdict.
        trials: each value that was tried, in order, and whether it passed.
        reason: why there is no value; empty if there is one.
    """

    value: float | None
    trials: tuple[tuple[float, bool], ...]
    reason: str = ""


def bisect(passes: Callable[[float], bool], settings: BisectionSettings) -> Boundary:
    """Find the value at which ``passes`` changes from true to false, to within ``settings.tolerance``.

    The verdict is assumed monotonic; otherwise the value found is one of several changes.

    Args:
        passes: the verdict at a value.
        settings: range, tolerance.
    """
    trials: list[tuple[float, bool]] = []

    def holds(value: float) -> bool:
        verdict = passes(value)
        trials.append((value, verdict))
        return verdict

    low, high = settings.range
    if not holds(low):
        reason = f"bisect.range: got {low:g}, where the run fails already; expected a value where it passes: lower it"
        return Boundary(None, tuple(trials), reason=reason)
    if holds(high):
        reason = f"bisect.range: got {high:g}, where the run still passes; expected one where it fails: raise it"
        return Boundary(None, tuple(trials), reason=reason)
    while high - low > settings.tolerance:
        middle = 0.5 * (low + high)
        if middle in (low, high):  # adjacent floating-point numbers, further apart than the tolerance
            break
        low, high = (middle, high) if holds(middle) else (low, middle)
    return Boundary(low, tuple(trials))
