"""Tune keys of the controllers over the points of a sweep, with optuna (pip install "optuna>=5,<6").

    python scripts/tune.py late_commands --objective com_rms_error_m --keys mpc.observer_time_s=0.003:0.05:log

Each trial is the sweep with the trial's values; its folder, ``tuning/<sweep>/<number>``, can be looked at with
``lgmpc report``. Values that fail more points than the present ones count as infeasible. The same command again
continues. At the end the best values are compared, in pairs, with the present ones on held-out points: other draws,
seeds, and directions between those of the sweep.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from lgmpc.errors import InputError, Interrupted
from lgmpc.runs import metric_names
from lgmpc.sweeps import FinishedSweep, Sweep, load_sweep, run_sweep
from lgmpc.sweeps.comparison import higher_is_better


def distribution_of(text: str, sweep: Sweep) -> tuple[str, Any, BaseDistribution]:
    """Return key, present value and distribution of ``KEY=LOW:HIGH`` or ``KEY=LOW:HIGH:log``."""
    key, _, ends = text.partition("=")
    present = sweep.points[0].config.value(key)
    whole = isinstance(present, int)
    try:
        low, high = map(int if whole else float, ends.removesuffix(":log").split(":"))
        kind = IntDistribution if whole else FloatDistribution
        return key, present, kind(low, high, log=ends.endswith(":log"))
    except ValueError as error:
        raise InputError(key, ends or "nothing", f"a range around {present}: LOW:HIGH or LOW:HIGH:log") from error


def held_out(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of a sweep with other draws or seeds, and with directions between its directions."""
    other = {**document, "name": "held-out"}
    if other.get("samples"):
        other["samples"] = {**other["samples"], "seed": other["samples"]["seed"] + other["samples"]["count"]}
    else:
        other["set"] = {**other["set"], "seed": 1000}
    other["factors"] = [
        {**factor, "start_deg": factor["start_deg"] + 180.0 / factor["count"]} if "start_deg" in factor else factor
        for factor in other["factors"]
    ]
    return other


def score(finished: FinishedSweep, objective: str) -> tuple[float, float]:
    """Return the share of the points that pass, and the mean of the objective over those where it was measured."""
    if finished.signal is not None:
        raise Interrupted(finished.signal)
    rows = finished.rows.values()
    values = [row.quantities.get(objective) for row in rows]
    known = [value for value in values if value is not None and math.isfinite(value)]
    return sum(row.passed for row in rows) / len(rows), math.fsum(known) / len(known) if known else math.nan


def main(arguments: list[str] | None = None) -> int:
    """Tune, and return 0 if the best values are better on the held-out points."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweep", help="file or name of a sweep; its variants are not used")
    parser.add_argument("--keys", nargs="+", required=True, metavar="KEY=LOW:HIGH[:log]")
    parser.add_argument("--objective", required=True, choices=["passed", "boundary", *metric_names()], metavar="METRIC")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="changes of the sweep")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--workers", type=int)
    given = parser.parse_args(arguments)

    sweep = load_sweep(given.sweep, [*given.set, "variants={}"])
    document = sweep.settings.model_dump(mode="json", exclude_none=True) | {"metrics": None}
    folder: Path = given.out or Path("tuning") / document["name"]
    folder.mkdir(parents=True, exist_ok=True)
    keys = [distribution_of(text, sweep) for text in given.keys]
    larger = higher_is_better(given.objective)

    study = optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(folder / "journal.log"))),
        study_name=given.objective,
        direction="maximize" if larger else "minimize",
        load_if_exists=True,
    )
    # Seeded by the number of trials, so that a continued search does not repeat itself.
    study.sampler = optuna.samplers.TPESampler(seed=len(study.trials), multivariate=True)
    while len(done := study.get_trials(states=(TrialState.COMPLETE, TrialState.PRUNED))) < given.trials:
        if not done:
            study.enqueue_trial({key: present for key, present, _ in keys})
        trial = study.ask({key: distribution for key, _, distribution in keys})
        changed = document | {"set": document["set"] | trial.params, "name": f"trial-{trial.number}"}
        finished = run_sweep(changed, folder / str(trial.number), workers=given.workers, resume=True)
        passed, value = score(finished, given.objective)
        print(f"trial {trial.number}: {given.objective} {value:.4g}, {100.0 * passed:.3g} % passed: {trial.params}")
        trial.set_user_attr("passed", passed)
        trial.set_constraint("lost passes", (done[0].user_attrs["passed"] if done else passed) - passed)
        study.tell(trial, value) if math.isfinite(value) else study.tell(trial, state=TrialState.PRUNED)
    best = study.best_trial
    print(f"best, trial {best.number}: " + " ".join(f"{key}={value:.6g}" for key, value in best.params.items()))

    variants = {"present": {}, "tuned": best.params}
    compared = run_sweep(held_out(document) | {"variants": variants}, folder / "held_out", resume=True)
    for pairing in compared.summary.pairings:
        if pairing.quantity in ("passed", given.objective):
            print(f"held out, {pairing.quantity}: {pairing.difference} in {pairing.difference.count} pairs")
    gains = {each.quantity: each.difference.value for each in compared.summary.pairings}
    gain = gains.get(given.objective, 0.0)
    return 0 if gains.get("passed", 0.0) >= 0.0 and (gain > 0.0 if larger else gain < 0.0) else 1


if __name__ == "__main__":
    raise SystemExit(main())
