"""Tuning by Bayesian optimisation (tree-structured Parzen estimators) with optuna; its journal can be resumed."""

from __future__ import annotations

import itertools
import math
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from typing import TYPE_CHECKING, Any

from lgmpc.config.interrupts import StopSignals, stop_signals
from lgmpc.config.loading import dump_config
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import InputError, Interrupted, MissingDependencyError, RunFolderError
from lgmpc.notebook import reports
from lgmpc.runs import atomic_write, versions
from lgmpc.runs.atomic import reason_of
from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.pool import Pool, available_cores
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.statistics import Estimate, mean_difference
from lgmpc.sweeps.trial import Task, compute, start_worker, warm
from lgmpc.sweeps.tuning import Dimension, Score, TuningProblem, task_key

if TYPE_CHECKING:
    import optuna

__all__ = ["Tuned", "TuningProgress", "tune"]

DOCUMENT, JOURNAL, BEST = "tuning.yaml", "journal.log", "best.yaml"


@dataclass(frozen=True)
class TuningProgress:
    """Where a tuning is.

    Attributes:
        done: finished trials.
        total: trials to do.
        initial: score of the initial values; ``None`` before the first trial.
        best: score of the best values so far.
    """

    done: int
    total: int
    initial: Score | None
    best: Score | None


@dataclass(frozen=True)
class Tuned:
    """What tuning found.

    Attributes:
        trial: number of the best trial; 0 is that of the initial values.
        trials: how many were finished.
        values: the best ones by their keys.
        initial: score of the initial values on the tuned points.
        best: of the best values.
        initial_held_out: score of the initial values on the points that were held out; ``None`` if stopped early.
        best_held_out: of the best values.
        difference: mean difference in pairs on the held-out points, best minus initial; ``None`` without pairs.
        files: the best configs.
        signal: what ended it early.
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
    """Search values that make the objective better than the initial ones do, without failing more points.

    The first trial has the initial values. Ctrl-C, SIGTERM and SIGHUP end it: finished trials stay in the journal.

    Args:
        problem: keys, points, objective.
        folder: for journal and results.
        trials: how many in all, those of earlier sessions included.
        seed: of the search.
        workers: processes; as many as processors unless given.
        resume: whether to take up a folder that is there.
        command: that is noted in the results.
        notify: called with what is being done.
        progress: called after every trial. In a notebook a bar displays both unless either is given.

    Raises:
        InputError: ``trials`` or ``workers`` is below 1.
        RunFolderError: the folder is there and ``resume`` is false, it holds another tuning, cannot be written, or the
            initial values have no score.
        MissingDependencyError: if optuna is not installed.
    """
    for name, number in (("trials", trials), ("workers", 1 if workers is None else workers)):
        if number < 1:
            raise InputError(name, number, "at least 1")
    with _study(problem, folder, seed, resume) as study, reports(notify, progress, _counted) as (announce, advance):
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
            received, held_out = error.signal, None
        finally:
            shutil.rmtree(folder / "scratch", ignore_errors=True)
        return session.result(held_out, command, received)


def _counted(now: TuningProgress) -> tuple[float, str]:
    return now.done / now.total, f"{now.done} of {now.total} trials"


_HeldOut = tuple[Score, Score, "Estimate | None"]


class _Session:
    """The search: asks for values, computes their points, reports their scores."""

    def __init__(
        self,
        problem: TuningProblem,
        folder: Path,
        study: optuna.Study,
        progress: Callable[[TuningProgress], None],
    ) -> None:
        self._problem, self._folder, self._study, self._progress = problem, folder, study, progress

    def search(self, pool: Pool, stop: StopSignals, trials: int, workers: int) -> None:
        """Run trials until there are as many as wanted, several at once if one does not occupy all workers."""
        points = self._problem.tuned.points
        together = max(1, workers // len(points))
        while (missing := trials - self._done()) > 0:
            first = not self._finished()
            asked = [self._study.ask() for _ in range(1 if first else min(together, missing))]
            values = {trial.number: self._suggest(trial) for trial in asked}
            rows = self._compute(pool, self._problem.tuned, values, "tuned")
            for trial in asked:
                with stop.held():
                    self._report(trial, rows[trial.number])
                best = _score(self._best())
                self._progress(TuningProgress(self._done(), trials, _score(self._finished()[0]), best))

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
        """Write the best config and return what was found."""
        best, initial = self._best(), _score(self._finished()[0])
        first, second, difference = held_out or (None, None, None)
        found = Tuned(
            best.number,
            self._done(),
            dict(best.params),
            initial,
            _score(best),
            first,
            second,
            difference,
            (),
            received,
        )
        files = tuple(self._write(found, command)) if held_out else ()
        return replace(found, files=files)

    def _finished(self) -> list[optuna.trial.FrozenTrial]:
        """Return the finished trials with a score, that of the initial values first."""
        return _complete(self._study)

    def _done(self) -> int:
        """Return how many trials were computed, with a score or without."""
        unmeasured = ("unmeasured" in each.user_attrs for each in self._study.get_trials(deepcopy=False))
        return len(self._finished()) + sum(unmeasured)

    def _best(self) -> optuna.trial.FrozenTrial:
        finished = self._finished()
        if not finished:
            raise RunFolderError(f"no trial in {self._folder} is finished: the same command with --resume goes on")
        best = finished[0]
        for trial in finished[1:]:
            if self._problem.objective.better(_score(trial), _score(best)):
                best = trial
        return best

    def _suggest(self, trial: optuna.Trial) -> dict[str, Any]:
        return {each.key: _suggested(trial, each) for each in self._problem.dimensions}

    def _compute(
        self, pool: Pool, sweep: Sweep, values: Mapping[int, Mapping[str, Any]], half: str
    ) -> dict[int, list[Row]]:
        """Return the rows of all points of each trial, in order."""
        settings, scratch = sweep.settings, self._folder / "scratch"
        wanted: dict[str, tuple[int, int]] = {}
        tasks = []
        for number, (i, point) in itertools.product(values, enumerate(sweep.points)):
            key = task_key(half, number, point)
            wanted[key] = (number, i)
            try:
                config = self._problem.apply(point.config, values[number])
            except InputError:  # values that do not go together: their points stay without a score
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
        initial = _score(finished[0]) if finished else score
        trial.set_user_attr("passed", score.passed)
        trial.set_user_attr("value", score.value)
        trial.set_constraint("lost passes", initial.passed - score.passed)
        self._study.tell(trial, score.value)

    def _write(self, found: Tuned, command: str) -> Iterator[Path]:
        """Write the best config of each base, with where it is from."""
        bases = {point.base: point.config for point in reversed(self._problem.tuned.points)}
        for base, config in bases.items():
            file = self._folder / (BEST if len(bases) == 1 else f"best-{base}.yaml")
            base_config = self._problem.apply(config, found.values)
            head = "".join(f"# {line}\n" for line in _provenance(self._problem, found, base, command))
            with atomic_write(file) as stream:
                stream.write((head + dump_config(base_config)).encode())
            yield file


def _complete(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """Return the trials that were told; one that was killed between its attributes and that has failed."""
    from optuna.trial import TrialState

    return [each for each in study.get_trials(deepcopy=False) if each.state == TrialState.COMPLETE]


def _score(trial: optuna.trial.FrozenTrial) -> Score:
    return Score(float(trial.user_attrs["passed"]), float(trial.user_attrs["value"]))


def _suggested(trial: optuna.Trial, each: Dimension) -> Any:
    if each.choices:
        return trial.suggest_categorical(each.key, list(each.choices))
    if each.whole:
        return trial.suggest_int(each.key, int(each.low), int(each.high), log=each.logarithmic)
    return trial.suggest_float(each.key, each.low, each.high, log=each.logarithmic)


def _provenance(problem: TuningProblem, found: Tuned, base: str, command: str) -> Iterator[str]:
    name = problem.objective.name
    yield f"{base}, tuned: trial {found.trial} of {found.trials} of"
    yield f"  {command}"
    for key, value in found.values.items():
        yield f"{key}: {problem.initial[key]} became {value}"
    tuned = f"{_words(found.initial)} became {_words(found.best)}"
    yield f"{name} over the {len(problem.tuned.points)} tuned points: {tuned}"
    if found.initial_held_out is not None and found.best_held_out is not None:
        held = f"{_words(found.initial_held_out)} became {_words(found.best_held_out)}"
        yield f"{name} over the {len(problem.held_out.points)} held-out points: {held}"
    yield ", ".join(f"{package} {version}" for package, version in versions().items())
    yield ""


def _words(score: Score) -> str:
    return f"{score.value:.5g} ({100.0 * score.passed:.3g} % passed)"


@contextmanager
def _study(problem: TuningProblem, folder: Path, seed: int, resume: bool) -> Iterator[optuna.Study]:
    """Open the journal of a tuning; trials that were running when it was stopped are given up."""
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError as error:
        raise MissingDependencyError("optuna", "lgmpc tune", 'pip install "lgmpc[tune]"') from error
    _open(folder, problem.document(), resume)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", category=optuna.exceptions.ExperimentalWarning)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        # Seeded by the trials that are there, so that a resumed search does not repeat itself.
        storage = JournalStorage(JournalFileBackend(str(folder / JOURNAL)))
        study = optuna.create_study(
            storage=storage,
            study_name=problem.name,
            direction="maximize" if problem.objective.maximized else "minimize",
            load_if_exists=True,
        )
        there = study.get_trials(deepcopy=False)
        study.sampler = optuna.samplers.TPESampler(seed=seed + len(there), multivariate=True)
        for trial in there:
            if trial.state == optuna.trial.TrialState.RUNNING:
                study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
        if not _complete(study):
            study.enqueue_trial(problem.initial)
        yield study


def _open(folder: Path, document: Mapping[str, Any], resume: bool) -> None:
    file = folder / DOCUMENT
    if file.is_file():
        there = parse_yaml(file.read_text(encoding="utf-8"), str(file))[0]
        if there != parse_yaml(write_yaml(dict(document)), "")[0]:
            raise RunFolderError(f"{folder} holds another tuning: choose another folder with --out, or remove this one")
        if not resume:
            raise RunFolderError(f"{folder} already holds this tuning: add --resume to go on, or choose another --out")
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunFolderError(f"{folder} is there and is no folder of a tuning: choose another one with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make {folder}: {reason_of(error)}. Choose another one with --out") from error
    with atomic_write(file) as stream:
        stream.write(write_yaml(dict(document)).encode())
