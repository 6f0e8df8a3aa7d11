"""Tuning by Bayesian optimisation (tree-structured Parzen estimators) with optuna; its journal can be resumed."""

from __future__ import annotations

import itertools
import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from time import perf_counter
from typing import TYPE_CHECKING, Any

from lgmpc.config.interrupts import StopSignals, stop_signals
from lgmpc.config.loading import dump_config
from lgmpc.errors import InputError, Interrupted, RunFolderError
from lgmpc.notebook import reports
from lgmpc.runs import atomic_write, versions
from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.journal import completed_trials, open_study, score_of, suggested
from lgmpc.sweeps.pool import Pool, available_cores
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.statistics import Estimate, mean_difference
from lgmpc.sweeps.trial import Task, compute, start_worker, warm
from lgmpc.sweeps.tuning import Score, TuningProblem, task_key

if TYPE_CHECKING:
    import optuna

__all__ = ["Tuned", "TuningProgress", "tune"]

BEST = "best.yaml"


@dataclass(frozen=True)
class TuningProgress:
    """Progress of a tuning.

    Attributes:
        done: finished trials.
        total: number of trials.
        initial: score of the initial values.
        best: score of the best values so far.
        rest_s: estimate of the time until the last trial is finished, s.
    """

    done: int
    total: int
    initial: Score
    best: Score
    rest_s: float


@dataclass(frozen=True)
class Tuned:
    """The result of a tuning.

    Attributes:
        trial: number of the best trial; 0 is that of the initial values.
        trials: number of finished trials.
        values: the best values by their keys, as they are in a config.
        initial: score of the initial values on the tuned points.
        best: score of the best values on the tuned points.
        initial_held_out: score of the initial values on the held-out points; ``None`` if stopped early.
        best_held_out: score of the best values on the held-out points.
        difference: mean difference in pairs on the held-out points, best minus initial; ``None`` without pairs.
        files: the best configs.
        signal: the signal that ended it early, if any.
    """

    trial: int
    trials: int
    values: Mapping[str, Any]
    initial: Score
    best: Score
    initial_held_out: Score | None
    best_held_out: Score | None
    difference: Estimate | None
    files: tuple[Path, ...]
    signal: Signals | None = None


def tune(
    problem: TuningProblem,
    folder: Path,
    *,
    trials: int,
    seed: int = 0,
    workers: int | None = None,
    resume: bool = False,
    command: str = "lgmpc.sweeps.study.tune",
    notify: Callable[[str], None] | None = None,
    progress: Callable[[TuningProgress], None] | None = None,
) -> Tuned:
    """Search values with a better objective than the initial ones, without failing more points.

    The first trial has the initial values. Ctrl-C, SIGTERM and SIGHUP end it: finished trials stay in the journal.

    Args:
        problem: keys, points, objective.
        folder: folder of journal and results.
        trials: number of trials, those of earlier sessions included.
        seed: seed of the search.
        workers: number of processes; that of the processors unless given.
        resume: whether to continue in an existing folder.
        command: command noted in the results.
        notify: called with a description of the present step.
        progress: called after every trial. In a notebook a bar displays both unless either is given.

    Raises:
        InputError: ``trials`` or ``workers`` is below 1.
        RunFolderError: the folder exists and ``resume`` is false, it contains another tuning, cannot be written, or
            the initial values have no score.
        MissingDependencyError: if optuna is not installed.
        Interrupted: by a signal before the first trial is finished.
    """
    for name, number in (("trials", trials), ("workers", 1 if workers is None else workers)):
        if number < 1:
            raise InputError(name, number, "at least 1")
    with open_study(problem, folder, seed, resume) as study, reports(notify, progress, _counted) as (announce, advance):
        session = _Session(problem, folder, study, advance)
        received = None
        limit = problem.tuned.settings.time_limit_s
        try:
            with stop_signals() as stop, Pool(workers or available_cores(), start_worker, limit) as pool:
                announce("starting, and compiling what is not in the cache")
                for _ in pool.map(warm, [problem.tuned.points[0].config], workers=1):
                    pass
                announce("tuning")
                session.search(pool, stop, trials, workers or available_cores())
                announce("running the held-out points")
                held_out = session.compare(pool)
        except Interrupted as error:
            if not completed_trials(study):
                raise
            received, held_out = error.signal, None
        finally:
            shutil.rmtree(folder / "scratch", ignore_errors=True)
        return session.result(held_out, command, received)


def _counted(now: TuningProgress) -> tuple[float, str]:
    return now.done / now.total, f"{now.done} of {now.total} trials"


_HeldOut = tuple[Score, Score, "Estimate | None"]


class _Session:
    """The search: draws values from the sampler, computes their points, and records their scores."""

    def __init__(
        self,
        problem: TuningProblem,
        folder: Path,
        study: optuna.Study,
        progress: Callable[[TuningProgress], None],
    ) -> None:
        self._problem, self._folder, self._study, self._progress = problem, folder, study, progress

    def search(self, pool: Pool, stop: StopSignals, trials: int, workers: int) -> None:
        """Run trials up to their number, several at once if one does not occupy all workers."""
        points = self._problem.tuned.points
        together = max(1, workers // len(points))
        started, earlier = perf_counter(), self._done()
        while (missing := trials - self._done()) > 0:
            first = not self._finished()
            drawn = [self._study.ask() for _ in range(1 if first else min(together, missing))]
            values = {trial.number: self._suggest(trial) for trial in drawn}
            rows = self._compute(pool, self._problem.tuned, values, "tuned")
            for trial in drawn:
                with stop.held():
                    self._report(trial, rows[trial.number])
                done = self._done()
                rest_s = (perf_counter() - started) / (done - earlier) * (trials - done)
                initial, best = score_of(self._finished()[0]), score_of(self._best())
                self._progress(TuningProgress(done, trials, initial, best, rest_s))

    def compare(self, pool: Pool) -> _HeldOut:
        """Return scores of initial and best values on the held-out points, and their difference in pairs."""
        best = self._best()
        values = {0: self._problem.initial, 1: dict(best.params)}
        rows = self._compute(pool, self._problem.held_out, values, "held-out")
        objective = self._problem.objective
        pairs = [(objective.of(a), objective.of(b)) for a, b in zip(rows[0], rows[1], strict=True)]
        differences = [b - a for a, b in pairs if a is not None and b is not None and math.isfinite(b - a)]
        difference = mean_difference(differences) if differences else None
        return objective.score(rows[0]), objective.score(rows[1]), difference

    def result(self, held_out: _HeldOut | None, command: str, received: Signals | None) -> Tuned:
        """Write the best config and return the result."""
        best, initial = self._best(), score_of(self._finished()[0])
        first, second, difference = held_out or (None, None, None)
        found = Tuned(
            best.number,
            self._done(),
            {each.key: each.value(best.params[each.key]) for each in self._problem.dimensions},
            initial,
            score_of(best),
            first,
            second,
            difference,
            (),
            received,
        )
        files = tuple(self._write(found, best.params, command)) if held_out else ()
        return replace(found, files=files)

    def _finished(self) -> list[optuna.trial.FrozenTrial]:
        """Return the finished trials with a score, that of the initial values first."""
        return completed_trials(self._study)

    def _done(self) -> int:
        """Return the number of computed trials, with a score or without."""
        unmeasured = ("unmeasured" in each.user_attrs for each in self._study.get_trials(deepcopy=False))
        return len(self._finished()) + sum(unmeasured)

    def _best(self) -> optuna.trial.FrozenTrial:
        finished = self._finished()
        if not finished:
            raise RunFolderError(f"no trial in {self._folder} is finished: the same command with --resume continues")
        best = finished[0]
        for trial in finished[1:]:
            if self._problem.objective.better(score_of(trial), score_of(best)):
                best = trial
        return best

    def _suggest(self, trial: optuna.Trial) -> dict[str, Any]:
        return {each.key: suggested(trial, each) for each in self._problem.dimensions}

    def _compute(
        self, pool: Pool, sweep: Sweep, values: Mapping[int, Mapping[str, Any]], half: str
    ) -> dict[int, list[Row]]:
        """Return the rows of all points of each trial, in order."""
        settings, scratch = sweep.settings, (self._folder / "scratch").resolve()  # as in a sweep
        wanted: dict[str, tuple[int, int]] = {}
        tasks = []
        for number, (i, point) in itertools.product(values, enumerate(sweep.points)):
            key = task_key(half, number, point)
            wanted[key] = (number, i)
            try:
                config = self._problem.apply(point.config, values[number])
            except InputError:  # an invalid combination of values: its points have no score
                continue
            tasks.append(Task(key, config, settings.bisect, None, scratch / key, settings.memory_limit_gb))
        rows: dict[int, list[Row]] = {number: [Row("", Ending.DIED)] * len(sweep.points) for number in values}
        for task, result in pool.map(compute, tasks):
            number, i = wanted[task.key]
            rows[number][i] = result if isinstance(result, Row) else Row(task.key, Ending.RAISED, (str(result),))
            shutil.rmtree(task.scratch, ignore_errors=True)
        return rows

    def _report(self, trial: optuna.Trial, rows: Sequence[Row]) -> None:
        from optuna.trial import TrialState

        score = self._problem.objective.score(rows)
        finished = self._finished()
        if math.isnan(score.value):
            if not finished:
                reason = next(("; ".join(row.reasons) for row in rows if row.reasons), "nothing was measured")
                name = self._problem.objective.name
                raise RunFolderError(f"the initial values have no {name} at any point: {reason}")
            trial.set_user_attr("unmeasured", True)
            self._study.tell(trial, state=TrialState.FAIL)
            return
        initial = score_of(finished[0]) if finished else score
        trial.set_user_attr("passed", score.passed)
        trial.set_user_attr("value", score.value)
        trial.set_constraint("lost passes", initial.passed - score.passed)
        self._study.tell(trial, score.value)

    def _write(self, found: Tuned, params: Mapping[str, Any], command: str) -> Iterator[Path]:
        """Write the best config of each base, with its provenance."""
        bases = list(self._problem.bases())
        for base in bases:
            file = self._folder / (BEST if len(bases) == 1 else f"best-{base.name}.yaml")
            head = "".join(f"# {line}\n" for line in _provenance(self._problem, found, base.name, command))
            with atomic_write(file) as stream:
                stream.write((head + dump_config(self._problem.apply(base, params))).encode())
            yield file


def _provenance(problem: TuningProblem, found: Tuned, base: str, command: str) -> Iterator[str]:
    name = problem.objective.name
    yield f"{base}, tuned: trial {found.trial} of {found.trials} of"
    yield f"  {command}"
    for each in problem.dimensions:
        yield f"{each.key}: {each.value(each.initial)} became {found.values[each.key]}"
    tuned = f"{_words(found.initial)} became {_words(found.best)}"
    yield f"{name} over the {len(problem.tuned.points)} tuned points: {tuned}"
    if found.initial_held_out is not None and found.best_held_out is not None:
        held = f"{_words(found.initial_held_out)} became {_words(found.best_held_out)}"
        yield f"{name} over the {len(problem.held_out.points)} held-out points: {held}"
        if found.difference is not None:
            yield f"mean difference in pairs on these: {found.difference}"
    yield ", ".join(f"{package} {version}" for package, version in versions().items())
    yield ""


def _words(score: Score) -> str:
    return f"{score.value:.5g} ({100.0 * score.passed:.3g} % passed)"
