"""Tuning by Bayesian optimisation (tree-structured Parzen estimators) with optuna, whose journal can be resumed."""

from __future__ import annotations

import itertools
import math
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from lgmpc.config.loading import dump_config
from lgmpc.config.session import stop_signals
from lgmpc.errors import InputError, Interrupted, RunFolderError
from lgmpc.notebook import reports
from lgmpc.runs import atomic_write, versions
from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.folder import open_folder
from lgmpc.sweeps.pool import Pool, available_cores
from lgmpc.sweeps.rows import Ending, Estimate, Row, mean_difference, paired
from lgmpc.sweeps.trial import Task, compute, start_worker, warm
from lgmpc.sweeps.tuning import Score, TuningProblem

__all__ = ["Tuned", "tune"]


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
        gained: whether the best values are better than the initial ones on the held-out points.
        files: the best configs.
        signal: the signal that ended it early, if any.
    """

    trial: int
    trials: int
    values: Mapping[str, Any]
    initial: Score
    best: Score
    initial_held_out: Score | None = None
    best_held_out: Score | None = None
    difference: Estimate | None = None
    gained: bool = False
    files: tuple[Path, ...] = ()
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
    progress: Callable[[Tuned], None] | None = None,
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
        progress: called with the result so far after every trial. In a notebook a bar displays both unless either is
            given.

    Raises:
        InputError: ``trials`` or ``workers`` is below 1.
        RunFolderError: the folder exists and ``resume`` is false, it contains another tuning, cannot be written, or
            the initial values have no score.
        Interrupted: by a signal before the first trial is finished.
    """
    for name, number in (("trials", trials), ("workers", 1 if workers is None else workers)):
        if number < 1:
            raise InputError(name, number, "at least 1")
    count, limit = workers or available_cores(), problem.tuned.settings.time_limit_s
    search = _Search(problem, folder, seed, resume)
    shown = reports(notify, progress, lambda now: (now.trials / trials, f"{now.trials} of {trials} trials"))
    try:
        with shown as (announce, advance), stop_signals() as stop, Pool(count, start_worker, limit) as pool:
            announce("starting, and compiling what is not in the cache")
            list(pool.map(warm, [problem.tuned.points[0].config], workers=1))
            announce("tuning")
            together = max(1, count // len(problem.tuned.points))
            while (missing := trials - search.done) > 0:
                for record in search.run(pool, min(together, missing)):
                    with stop.held():
                        record()
                    advance(search.found())
            announce("running the held-out points")
            return search.judged(pool, command)
    except Interrupted as error:
        if not search.scored():
            raise
        return replace(search.found(), signal=error.signal)
    finally:
        shutil.rmtree(folder / "scratch", ignore_errors=True)


class _Search:
    """A study of optuna in a folder: proposes values, computes their points, records their scores."""

    def __init__(self, problem: TuningProblem, folder: Path, seed: int, resume: bool) -> None:
        self._problem, self._folder = problem, folder
        self._distributions = {each.key: each.distribution for each in problem.dimensions}
        keys = {key: str(distribution) for key, distribution in self._distributions.items()}
        document = {"tuned": problem.tuned.settings.model_dump(mode="json"), "objective": problem.objective}
        open_folder(folder, "tuning.yaml", document | {"keys": keys}, resume=resume)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", category=optuna.exceptions.ExperimentalWarning)
            optuna.logging.set_verbosity(optuna.logging.WARNING)
            self.study = optuna.create_study(
                storage=JournalStorage(JournalFileBackend(str(folder / "journal.log"))),
                study_name=problem.name,
                direction="maximize" if problem.maximized else "minimize",
                load_if_exists=True,
            )
            # Seeded by the number of trials too, so that a resumed search does not repeat itself.
            seed += len(self.study.get_trials(deepcopy=False))
            self.study.sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True)
        if not self.scored():
            self.study.enqueue_trial(problem.initial)

    def scored(self) -> list[tuple[Score, optuna.trial.FrozenTrial]]:
        """Return the trials with a score, that of the initial values first; none that was killed while it was told."""
        trials = self.study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        return [(Score(float(each.user_attrs["passed"]), float(each.value or 0.0)), each) for each in trials]

    @property
    def done(self) -> int:
        """Number of computed trials, with a score or without."""
        return len(self.study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED)))

    def found(self) -> Tuned:
        """Return the result so far, without held-out points."""
        scored = self.scored()
        best, trial = max(scored, key=lambda each: self._problem.rank(each[0]))
        values = {each.key: each.value(trial.params[each.key]) for each in self._problem.dimensions}
        return Tuned(trial.number, self.done, values, scored[0][0], best)

    def run(self, pool: Pool, count: int) -> Iterator[Callable[[], None]]:
        """Run some trials at once, the first one alone, and yield a function for each that records its score."""
        asked = [self.study.ask(self._distributions) for _ in range(count if self.scored() else 1)]
        rows = self._compute(pool, self._problem.tuned, [trial.params for trial in asked])
        for trial, own in zip(asked, rows, strict=True):
            yield lambda trial=trial, own=own: self._record(trial, own)  # type: ignore[misc]

    def _record(self, trial: optuna.Trial, rows: Sequence[Row]) -> None:
        score, scored = self._problem.score(rows), self.scored()
        if math.isnan(score.value):
            if not scored:
                reason = next(("; ".join(row.reasons) for row in rows if row.reasons), "nothing was measured")
                raise RunFolderError(f"the initial values have no {self._problem.objective} at any point: {reason}")
            self.study.tell(trial, state=TrialState.PRUNED)
            return
        trial.set_user_attr("passed", score.passed)
        trial.set_constraint("lost passes", (scored[0][0] if scored else score).passed - score.passed)
        self.study.tell(trial, score.value)

    def judged(self, pool: Pool, command: str) -> Tuned:
        """Compare the best values with the initial ones on the held-out points, and write the best configs."""
        problem, found = self._problem, self.found()
        params = self.study.get_trials(deepcopy=False)[found.trial].params
        initial, best = self._compute(pool, problem.held_out, [problem.initial, params])
        first, second = problem.score(initial), problem.score(best)
        pairs = paired(zip(initial, best, strict=True)).get(problem.objective, [])
        bases = list(problem.bases())
        names = ["best.yaml"] if len(bases) == 1 else [f"best-{base.name}.yaml" for base in bases]
        found = replace(
            found,
            initial_held_out=first,
            best_held_out=second,
            difference=mean_difference([b - a for a, b in pairs]) if pairs else None,
            gained=problem.rank(second) > problem.rank(first),
            files=tuple(self._folder / name for name in names),
        )
        for base, file in zip(bases, found.files, strict=True):
            head = "".join(f"# {line}\n" for line in _provenance(problem, found, base.name, command))
            with atomic_write(file) as stream:
                stream.write((head + dump_config(problem.apply(base, params))).encode())
        return found

    def _compute(self, pool: Pool, sweep: Sweep, values: Sequence[Mapping[str, Any]]) -> list[list[Row]]:
        """Return the rows of all points with each of the values, in order."""
        scratch = (self._folder / "scratch").resolve()  # also for workers that run in another folder
        settings, tasks = sweep.settings, []
        for (number, params), (i, point) in itertools.product(enumerate(values), enumerate(sweep.points)):
            with suppress(InputError):  # an invalid combination of values: its points have no score
                config, key = self._problem.apply(point.config, params), f"{number}-{i}"
                tasks.append(Task(key, config, settings.bisect, None, scratch / key, settings.memory_limit_gb))
        rows = [[Row("", Ending.DIED)] * len(sweep.points) for _ in values]
        for task, result in pool.map(compute, tasks):
            number, i = map(int, task.key.split("-"))
            rows[number][i] = result if isinstance(result, Row) else Row(task.key, Ending.RAISED, (str(result),))
            shutil.rmtree(task.scratch, ignore_errors=True)
        return rows


def _provenance(problem: TuningProblem, found: Tuned, base: str, command: str) -> Iterator[str]:
    """Yield the lines of the comment that heads a best config."""
    name, held_out = problem.objective, f"{found.initial_held_out} became {found.best_held_out}"
    yield f"{base}, tuned: trial {found.trial} of {found.trials} of"
    yield f"  {command}"
    for each in problem.dimensions:
        yield f"{each.key}: {each.value(each.initial)} became {found.values[each.key]}"
    yield f"{name} over the {len(problem.tuned.points)} tuned points: {found.initial} became {found.best}"
    yield f"{name} over the {len(problem.held_out.points)} held-out points: {held_out}"
    yield f"mean difference in pairs on these: {found.difference}"
    yield ", ".join(f"{package} {version}" for package, version in versions().items())
    yield ""
