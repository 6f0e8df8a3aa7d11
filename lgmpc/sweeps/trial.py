"""One point of a sweep, computed in a worker process through what ``lgmpc run`` uses."""

from __future__ import annotations

import logging
import os
import resource
import signal
import threading
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from time import perf_counter

from lgmpc.config.build import prepare
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.schema import Config
from lgmpc.errors import Interrupted
from lgmpc.runs import flat_metrics
from lgmpc.sweeps.bisection import bisect, scaled
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.settings import BisectionSettings

__all__ = ["Task", "compute", "start_worker", "warm"]


@dataclass(frozen=True)
class Task:
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
    """Prepare a worker process: without output, ignoring Ctrl-C, and ended with the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger("lgmpc").addHandler(logging.NullHandler())
    warnings.simplefilter("ignore")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def warm(config: Config) -> None:
    """Build the session of a config, so that its compiled functions are in the cache.

    What cannot be built is the reason of its points' rows. An exception would be pickled, which not all can be: the
    process would end.
    """
    with suppress(Exception):
        prepare(config)


def compute(task: Task) -> Row:
    """Run a point, or search its boundary; exceptions become the reason of its row.

    Raises:
        Interrupted: by a signal to this process.
    """
    started = perf_counter()
    _limit_memory(task.memory_gb)
    trial = _Trial(task)
    try:
        row = trial.row()
    except Exception as error:
        row = Row(task.key, Ending.RAISED, (f"{type(error).__name__}: {error}",), simulated_s=trial.simulated_s)
    return replace(row, elapsed_s=perf_counter() - started)


def _limit_memory(gigabytes: float) -> None:
    """Limit the allocations of this process, which raise beyond the limit instead of exhausting the memory."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = int(1e9 * gigabytes)
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


class _Trial:
    """The runs of one point.

    Attributes:
        simulated_s: simulated time of all runs, s.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self.simulated_s = 0.0

    def row(self) -> Row:
        """Run the point and return its row."""
        task = self._task
        if task.bisect is None:
            run = self._run(task.config)
            ending = Ending.PASS if run.result.verdict.passed else Ending.FAIL
            metrics = {} if run.result.metrics is None else flat_metrics(run.result.metrics)
            if task.metrics is not None:
                metrics = {name: metrics.get(name) for name in task.metrics}
            return Row(task.key, ending, run.result.verdict.reasons, metrics, simulated_s=self.simulated_s)
        found = bisect(self._passes, task.bisect)
        return Row(
            task.key,
            Ending.UNBRACKETED if found.value is None else Ending.PASS,
            (found.reason,) if found.reason else (),
            boundary=found.value,
            trials=found.trials,
            violations=found.violations,
            simulated_s=self.simulated_s,
        )

    def _passes(self, value: float) -> bool:
        assert self._task.bisect is not None
        return self._run(scaled(self._task.config, self._task.bisect.key, value)).result.verdict.passed

    def _run(self, config: Config) -> FinishedRun:
        run = run_config(config, self._task.scratch)
        if run.signal is not None:
            raise Interrupted(run.signal)
        log = run.session.log
        self.simulated_s += float(log.time[-1] - log.time[0]) + log.control_period_s if log.ticks else 0.0
        return run
