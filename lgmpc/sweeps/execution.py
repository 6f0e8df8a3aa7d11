"""A sweep from start to end: its points over worker processes, each saved when it is finished."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from typing import Any

from lgmpc.config.session import StopSignals, ignore, stop_signals
from lgmpc.config.yaml_text import write_yaml
from lgmpc.errors import InputError, Interrupted, required
from lgmpc.sweeps.design import Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.folder import SweepFolder
from lgmpc.sweeps.pool import Died, Hung, Pool, available_cores
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.summary import Summary, summarize
from lgmpc.sweeps.trial import Trial, compute, start_worker, warm
from lgmpc.typing import typed


@dataclass(frozen=True)
class SweepProgress:
    """Progress of a sweep.

    Attributes:
        total: number of points.
        done: finished points, those of earlier sessions included.
        failed: finished points that did not pass.
        simulated_s: simulated time in this session, s.
        computed_s: computing time of all workers in this session, s.
    """

    total: int
    done: int
    failed: int
    simulated_s: float = 0.0
    computed_s: float = 0.0

    @property
    def speed(self) -> float | None:
        """Simulated seconds per second and core; ``None`` before the first point."""
        return self.simulated_s / self.computed_s if self.computed_s > 0.0 else None

    def after(self, row: Row) -> "SweepProgress":
        """Return the progress with one more point finished."""
        return replace(
            self,
            done=self.done + 1,
            failed=self.failed + (not row.passed),
            simulated_s=self.simulated_s + row.simulated_s,
            computed_s=self.computed_s + row.elapsed_s,
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

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with a row for each finished point: base, variant, levels, ending, figures.

        Raises:
            MissingDependencyError: pandas is not installed.
        """
        rows = [
            {"base": row.base, "variant": row.variant, **row.levels, "ending": row.ending.value, **row.quantities}
            for row in self.rows.values()
        ]
        return required("pandas", "a DataFrame of a sweep", "data").DataFrame(rows)


@typed
def run_sweep(
    sweep: Sweep | str | Path | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    notify: Callable[[str], None] = ignore,
    progress: Callable[[SweepProgress], None] = ignore,
) -> FinishedSweep:
    """Compute the points of a sweep that are not finished yet, and save each.

    Ctrl-C, SIGTERM or SIGHUP end it at once: finished points are saved, points being computed are abandoned. Scripts
    that call this require the usual ``if __name__ == "__main__":``, because worker processes import them.

    Args:
        sweep: a YAML file, the name of a shipped sweep, the content of such a document, or a :class:`Sweep` of
            :func:`load_sweep`, which takes changes too.
        folder: its folder; ``sweeps/<name>`` unless given.
        workers: number of processes; that of the processors unless given.
        resume: whether to continue in an existing folder.
        notify: called with a description of what is being prepared.
        progress: called after every point.

    Raises:
        ConfigError: as :func:`load_sweep`.
        InputError: ``workers`` is below 1.
        RunFolderError: as :meth:`SweepFolder.open`, or if results cannot be written.
    """
    if isinstance(sweep, Mapping):
        sweep = parse_sweep(write_yaml(dict(sweep)))
    elif not isinstance(sweep, Sweep):
        sweep = load_sweep(sweep)
    folder = Path("sweeps") / sweep.settings.name if folder is None else Path(folder)
    if workers is not None and workers < 1:
        raise InputError("workers", workers, "at least 1")
    received = None
    with closing(SweepFolder.open(folder, sweep, resume=resume)) as place:
        session = _Session(sweep, place, progress)
        try:
            with stop_signals() as stop:
                if session.now.done < session.now.total:
                    with Pool(workers or available_cores(), start_worker, sweep.settings.time_limit_s) as pool:
                        session.run(pool, stop, notify)
        except Interrupted as error:
            received = error.signal
    return FinishedSweep(sweep, folder, session.finished(), session.now, received)


class _Session:
    """The work of this process on a sweep."""

    def __init__(self, sweep: Sweep, folder: SweepFolder, progress: Callable[[SweepProgress], None]) -> None:
        self._settings, self._folder, self._progress = sweep.settings, folder, progress
        self._points = {point.key: point for point in sweep.points}
        done = self.finished()
        self.now = SweepProgress(len(self._points), len(done), sum(not row.passed for row in done.values()))

    def finished(self) -> dict[str, Row]:
        """Return the sweep's finished points by their keys."""
        return {key: row for key, row in self._folder.rows.items() if key in self._points}

    def run(self, pool: Pool, stop: StopSignals, notify: Callable[[str], None]) -> None:
        """Compute and save every point that is not finished."""
        self._progress(self.now)
        notify("starting, and compiling what is not in the cache")
        # A config of each base and variant, whose functions are compiled once instead of by every worker.
        typical = {(point.base, point.variant): point.config for point in reversed(self._points.values())}
        list(pool.map(warm, typical.values(), workers=1))
        notify("running")
        for task, result in pool.map(compute, self._tasks()):
            with stop.held():
                self._save(task, result)
            self._progress(self.now)

    def _tasks(self) -> Iterator[Trial]:
        settings = self._settings
        for key, point in self._points.items():
            if key not in self._folder.rows:
                scratch = self._folder.scratch(key).resolve()
                yield Trial(key, point.config, settings.bisect, settings.metrics, scratch, settings.memory_limit_gb)

    def _save(self, task: Trial, result: Row | Exception) -> None:
        point = self._points[task.key]
        if isinstance(result, Exception):
            ending = {Hung: Ending.HUNG, Died: Ending.DIED}.get(type(result), Ending.RAISED)
            result = Row(task.key, ending, (str(result) or type(result).__name__,))
        if result.ending in (Ending.RAISED, Ending.HUNG, Ending.DIED):
            self._folder.keep_config(point)
        log = self._folder.keep_log(result, self._settings.logs.keep)
        row = replace(
            result, log=log, base=point.base, variant=point.variant, levels=dict(point.levels), draw=point.draw
        )
        self._folder.append(row)
        self.now = self.now.after(row)
