"""The journal of a tuning: optuna's study on disk, its sampler, and the scores of its trials."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lgmpc.errors import MissingDependencyError
from lgmpc.sweeps.dimensions import Dimension
from lgmpc.sweeps.folder import open_folder
from lgmpc.sweeps.tuning import Score, TuningProblem

if TYPE_CHECKING:
    import optuna

__all__ = ["completed_trials", "open_study", "score_of", "suggested"]

_DOCUMENT, _JOURNAL = "tuning.yaml", "journal.log"


@contextmanager
def open_study(problem: TuningProblem, folder: Path, seed: int, resume: bool) -> Iterator[optuna.Study]:
    """Open the journal of a tuning; trials that were running when it was stopped are marked as failed.

    Args:
        problem: the tuning.
        folder: its folder, created if it does not exist.
        seed: seed of the sampler.
        resume: whether to continue in an existing folder.

    Raises:
        RunFolderError: the folder exists and ``resume`` is false, contains something else, or cannot be written.
        MissingDependencyError: optuna is not installed.
    """
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError as error:
        raise MissingDependencyError("optuna", "lgmpc tune", 'pip install "lgmpc[tune]"') from error
    open_folder(folder, _DOCUMENT, problem.document(), resume=resume)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", category=optuna.exceptions.ExperimentalWarning)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        # Seeded by the number of trials too, so that a resumed search does not repeat itself.
        storage = JournalStorage(JournalFileBackend(str(folder / _JOURNAL)))
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
        if not completed_trials(study):
            study.enqueue_trial(problem.initial)
        yield study


def completed_trials(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """Return the completed trials; one that was killed between writing its attributes and its state has failed."""
    from optuna.trial import TrialState

    return [each for each in study.get_trials(deepcopy=False) if each.state == TrialState.COMPLETE]


def score_of(trial: optuna.trial.FrozenTrial) -> Score:
    """Return the score of a completed trial."""
    return Score(float(trial.user_attrs["passed"]), float(trial.user_attrs["value"]))


def suggested(trial: optuna.Trial, dimension: Dimension) -> Any:
    """Return the value that the sampler proposes for a key."""
    key, low, high, log = dimension.key, dimension.low, dimension.high, dimension.logarithmic
    if dimension.choices:
        return trial.suggest_categorical(key, list(dimension.choices))
    if dimension.whole:
        return trial.suggest_int(key, int(low), int(high), log=log)
    return trial.suggest_float(key, low, high, log=log)
