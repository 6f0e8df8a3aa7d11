"""A sweep from start to end: its points over worker processes, each saved when it is finished."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lgmpc.config.interrupts import StopSignals, stop_signals
from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import write_yaml
from lgmpc.errors import InputError, Interrupted
from lgmpc.notebook import html_table, reports
from lgmpc.sweeps.cluster import DaskPool
from lgmpc.sweeps.design import Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.folder import Claim, SweepFolder
from lgmpc.sweeps.pool import Died, Hung, Pool, available_cores
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.summary import Summary, summarize
from lgmpc.sweeps.tables import group_table
from lgmpc.sweeps.trial import Task, compute, start_worker, warm

if TYPE_CHECKING:
    import distributed

    Cluster = Callable[[Path], AbstractContextManager[distributed.Client]]
    """Connects to a Dask cluster for the duration of a block, for the sweep of a folder."""

__all__ = ["FinishedSweep", "SweepProgress", "run_sweep"]


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep.

    Attributes:
        total: number of points.
        done: finished points, those of earlier sessions included.
        failed: finished points that did not pass.
        new: points finished in this session.
        simulated_s: simulated time in this session, s.
        computed_s: computing time of all workers in this session, s.
        elapsed_s: time since this session began, s.
    """

    total: int
    done: int
    failed: int
    new: int = 0
    simulated_s: float = 0.0
    computed_s: float = 0.0
    elapsed_s: float = 0.0

    @property
    def remaining_s(self) -> float | None:
        """Estimate of the time until the end; ``None`` before the first point."""
        return self.elapsed_s / self.new * (self.total - self.done) if self.new else None

    @property
    def speed(self) -> float | None:
        """Simulated seconds per second and core; ``None`` before the first point."""
        return self.simulated_s / self.computed_s if self.computed_s > 0.0 else None

    def after(self, row: Row, elapsed_s: float) -> SweepProgress:
        """Return the progress with one more point finished."""
        return replace(
            self,
            done=self.done + 1,
            failed=self.failed + (not row.passed),
            new=self.new + 1,
            simulated_s=self.simulated_s + row.simulated_s,
            computed_s=self.computed_s + row.elapsed_s,
            elapsed_s=elapsed_s,
        )


@dataclass(frozen=True, repr=False)
class FinishedSweep:
    """A sweep that is finished or was stopped.

    Attributes:
        sweep: document and points.
        folder: the sweep's folder.
        rows: finished points by their keys.
        progress: progress at the end.
        signal: the signal that ended it early, if any.
    """

    sweep: Sweep
    folder: Path
    rows: dict[str, Row]
    progress: SweepProgress
    signal: Signals | None = None

    @property
    def summary(self) -> Summary:
        """Shares that pass, boundaries, medians of metrics, and differences in pairs, with 95 % intervals."""
        return summarize(self.sweep, self.rows)

    def __repr__(self) -> str:
        return f"FinishedSweep({self.sweep.settings.name}: {self.summary.count}, in {self.folder})"

    def _repr_html_(self) -> str:
        """Return the table of the summary's groups."""
        from lgmpc.viz.report import table  # imported here, because lgmpc.viz imports much

        summary = self.summary
        head = html_table(summary.name, [("verdict", f"{summary.verdict}: {summary.count}"), ("folder", self.folder)])
        return head + table(*group_table(summary, self.sweep.settings.metrics))


def run_sweep(
    sweep: Sweep | str | Path | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: Cluster | None = None,
    resume: bool = False,
    notify: Callable[[str], None] | None = None,
    progress: Callable[[SweepProgress], None] | None = None,
) -> FinishedSweep:
    """Compute the points of a sweep that are not finished yet, and save each.

    Ctrl-C, SIGTERM or SIGHUP end it at once: finished points are saved, points being computed are abandoned. Scripts
    that call this require the usual ``if __name__ == "__main__":``, because worker processes import them.

    Args:
        sweep: a YAML file, the name of a shipped sweep, the content of such a document, or a :class:`Sweep` of
            :func:`load_sweep`, which takes changes too.
        folder: its folder; ``sweeps/<name>`` unless given.
        workers: number of processes; that of the processors unless given.
        cluster: connection to a Dask cluster that computes the points instead of processes of this machine; called
            with the folder, for example ``lambda folder: dask_client("tcp://host:8786")``.
        resume: whether to continue in an existing folder; other processes may work on it at the same time.
        notify: called with a description of what is being prepared.
        progress: called after every point. In a notebook a bar displays both unless either is given.

    Raises:
        ConfigError: as :func:`load_sweep`.
        InputError: ``workers`` is below 1, or given with a cluster, which has its own.
        RunFolderError: as :meth:`SweepFolder.open`, or if results cannot be written.
        ClusterError: the cluster cannot be used, or the connection to it is lost.
    """
    if isinstance(sweep, Mapping):
        sweep = parse_sweep(write_yaml(dict(sweep)))
    elif not isinstance(sweep, Sweep):
        sweep = load_sweep(sweep)
    folder = Path("sweeps") / sweep.settings.name if folder is None else Path(folder)
    if workers is not None and (workers < 1 or cluster is not None):
        raise InputError("workers", workers, "at least 1" if cluster is None else "none: the cluster has its own")
    place, received = SweepFolder.open(folder, sweep, resume=resume), None
    with reports(notify, progress, _counted) as (announce, advance):
        session = _Session(sweep, place, advance)
        try:
            with stop_signals() as stop, _pool(sweep, folder, workers, cluster) as pool:
                session.run(pool, stop, announce)
        except Interrupted as error:
            received = error.signal
        finally:
            session.close()
    return FinishedSweep(sweep, folder, session.finished(), session.now, received)


@contextmanager
def _pool(sweep: Sweep, folder: Path, workers: int | None, cluster: Cluster | None) -> Iterator[Pool]:
    limit = sweep.settings.time_limit_s
    if cluster is None:
        with Pool(workers or available_cores(), start_worker, limit) as pool:
            yield pool
    else:
        with cluster(folder) as client, DaskPool(client, start_worker, limit, folder) as there:
            yield there


def _counted(now: SweepProgress) -> tuple[float, str]:
    return now.done / now.total, f"{now.done} of {now.total} points, {now.failed} failed"


class _Session:
    """The work of this process on a sweep."""

    def __init__(self, sweep: Sweep, folder: SweepFolder, progress: Callable[[SweepProgress], None]) -> None:
        self._sweep, self._folder, self._progress = sweep, folder, progress
        self._points = {point.key: point for point in sweep.points}
        self._claims: dict[str, Claim] = {}
        self._started = perf_counter()
        done = self.finished()
        self.now = SweepProgress(len(self._points), len(done), sum(not row.passed for row in done.values()))

    def finished(self) -> dict[str, Row]:
        """Return the sweep's finished points by their keys."""
        return {key: row for key, row in self._folder.results.rows().items() if key in self._points}

    def run(self, pool: Pool, stop: StopSignals, notify: Callable[[str], None]) -> None:
        """Compute and save every point that no other process has finished or is computing."""
        if self.now.done == self.now.total:
            return
        self._progress(self.now)
        notify("starting, and compiling what is not in the cache")
        list(pool.map(warm, self._typical(), workers=1))
        self._started = perf_counter()
        notify("running")
        for task, result in pool.map(compute, self._tasks(stop)):
            with stop.held():  # atomic: a claim without its row would belong to no process
                self._save(task, result)
            self._progress(self.now)

    def close(self) -> None:
        """Release the claims of unfinished points."""
        for key, claim in self._claims.items():
            shutil.rmtree(self._folder.scratch(key), ignore_errors=True)
            claim.release()
        self._claims.clear()

    def _typical(self) -> Iterable[Config]:
        """Return a config of each base and variant, whose functions are compiled once instead of by every worker."""
        return {(point.base, point.variant): point.config for point in reversed(self._points.values())}.values()

    def _tasks(self, stop: StopSignals) -> Iterator[Task]:
        """Yield the points that this process computes: no other one does, or has done so."""
        settings = self._sweep.settings
        for key, point in self._points.items():
            with stop.held():
                claim = None if key in self._folder.results.rows() else self._folder.claim(key)
                if claim is not None:
                    self._claims[key] = claim
            if claim is not None:
                scratch = self._folder.scratch(key).resolve()  # also for workers that run in another folder
                yield Task(key, point.config, settings.bisect, settings.metrics, scratch, settings.memory_limit_gb)

    def _save(self, task: Task, result: Row | Exception) -> None:
        point = self._points[task.key]
        if isinstance(result, Exception):
            ending = {Hung: Ending.HUNG, Died: Ending.DIED}.get(type(result), Ending.RAISED)
            result = Row(task.key, ending, (str(result) or type(result).__name__,))
        if result.ending in (Ending.RAISED, Ending.HUNG, Ending.DIED):
            self._folder.keep_config(point)
        log = self._folder.keep_log(result, self._sweep.settings.logs.keep)
        row = replace(
            result, log=log, base=point.base, variant=point.variant, levels=dict(point.levels), draw=point.draw
        )
        self._folder.results.append(row)
        self._claims.pop(task.key).release()
        self.now = self.now.after(row, perf_counter() - self._started)
