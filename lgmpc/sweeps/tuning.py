"""The definition of a tuning: keys, objective, and points, of which some are held out."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lgmpc.config.loading import load_config, parse_assignment
from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import InputError
from lgmpc.runs import metric_names
from lgmpc.shipped import config_file, shipped_sweeps, sweep_file
from lgmpc.sweeps.comparison import higher_is_better
from lgmpc.sweeps.design import Point, Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.dimensions import Dimension, parse_dimensions
from lgmpc.sweeps.rows import Row
from lgmpc.sweeps.settings import Directions

__all__ = ["Objective", "Score", "TuningProblem", "task_key", "tuning_problem"]


@dataclass(frozen=True)
class Score:
    """The score of values over a set of points.

    Attributes:
        passed: share of the points that pass.
        value: mean of the objective over the points at which it was measured; NaN if there are none.
    """

    passed: float
    value: float


@dataclass(frozen=True)
class Objective:
    """The objective, optimised subject to at least as many passing points as with the initial values.

    Attributes:
        name: a metric, ``boundary``, or ``passed``.
    """

    name: str

    @property
    def maximized(self) -> bool:
        """Whether larger values are better."""
        return higher_is_better(self.name)

    def score(self, rows: Sequence[Row]) -> Score:
        """Return the score of finished points."""
        passed = sum(row.passed for row in rows) / len(rows)
        values = [value for row in rows if (value := self.of(row)) is not None and math.isfinite(value)]
        return Score(passed, math.fsum(values) / len(values) if values else math.nan)

    def of(self, row: Row) -> float | None:
        """Return the objective of one point; ``None`` if it was not measured."""
        if self.name == "passed":
            return float(row.passed)
        return row.boundary if self.name == "boundary" else row.metrics.get(self.name)

    def better(self, first: Score, second: Score) -> bool:
        """Return whether the first score is better: more points pass, or as many with a better value."""
        if first.passed != second.passed:
            return first.passed > second.passed
        if math.isnan(second.value) or math.isnan(first.value):
            return math.isnan(second.value) and not math.isnan(first.value)
        return first.value > second.value if self.maximized else first.value < second.value


@dataclass(frozen=True)
class TuningProblem:
    """Keys, points and objective.

    Attributes:
        name: name of the config or sweep.
        dimensions: the tuned keys.
        objective: the objective.
        tuned: the points of the trials.
        held_out: points of the same kind with other seeds, draws and directions, not used in trials.
    """

    name: str
    dimensions: tuple[Dimension, ...]
    objective: Objective
    tuned: Sweep
    held_out: Sweep

    @property
    def initial(self) -> dict[str, Any]:
        """The numbers and choices, by their keys, that leave the configs as they are."""
        return {each.key: each.initial for each in self.dimensions}

    def apply(self, config: Config, values: Mapping[str, Any]) -> Config:
        """Return a config with the numbers and choices of a trial.

        Raises:
            InputError: a value is invalid in the config.
        """
        for each in self.dimensions:
            config = each.apply(config, values[each.key])
        return config

    def bases(self) -> Iterator[Config]:
        """Yield the base configs, with the changes for all points, without factors, draws and variants."""
        for base in self.tuned.bases:
            yield base.replace(copy.deepcopy(dict(self.tuned.settings.set)))

    def document(self) -> dict[str, Any]:
        """Return the data that identify the problem, as plain values."""
        return {
            "tuned": self.tuned.settings.model_dump(mode="json"),
            "objective": self.objective.name,
            "keys": {
                each.key: list(each.choices) or [each.low, each.high, "log" if each.logarithmic else "linear"]
                for each in self.dimensions
            },
        }


def tuning_problem(
    source: str | Path, keys: Sequence[str], objective: str, *, overrides: Sequence[str] = (), seeds: int | None = None
) -> TuningProblem:
    """Return the problem of tuning a config over its seeds, or over the points of a sweep.

    Args:
        source: a config or a sweep: a file, or the name of a shipped one.
        keys: see :func:`lgmpc.sweeps.dimensions.parse_dimension`.
        objective: a metric of a run, ``passed``, or of sweeps with a bisection ``boundary``.
        overrides: changes ``key=value`` of the config, or of the document of the sweep.
        seeds: number of seeds of a config to tune over, and of further ones held out, 4 unless given. Not for sweeps.

    Raises:
        ConfigError: config or sweep cannot be read or used.
        InputError: a key, the objective or ``seeds`` cannot be used.
    """
    sweep = _is_sweep(source)
    if seeds is not None and (sweep or seeds < 1):
        raise InputError("seeds", seeds, "no seeds: a sweep has its own points" if sweep else "at least 1")
    if not keys:
        raise InputError("keys", "nothing", "keys to tune: --keys mpc.weights.force=1e-4:1e-2:log")
    tuned, held_out = _sweep_pair(source, overrides) if sweep else _config_pair(source, overrides, seeds or 4)
    searched = tuned.settings.bisect is not None
    known = ["boundary"] if searched else ["passed", *metric_names()]
    if objective not in known:
        raise InputError(
            "objective", objective, "boundary" if searched else "a metric of a run, or passed", known, word=objective
        )
    problem = TuningProblem(tuned.settings.name, (), Objective(objective), tuned, held_out)
    configs = [*(point.config for point in tuned.points), *problem.bases()]
    dimensions = parse_dimensions(configs, keys)
    problem = replace(problem, dimensions=dimensions)
    for each in dimensions:
        for end in each.choices or (each.low, each.high):
            problem.apply(tuned.points[0].config, {**problem.initial, each.key: end})
    return problem


def _is_sweep(source: str | Path) -> bool:
    """Return whether a source is a sweep: a shipped one's name, or a document with a base."""
    if str(source) in shipped_sweeps() and not Path(source).is_file():
        return True
    try:
        data, _ = parse_yaml(Path(source).read_text(encoding="utf-8"), str(source))
    except (OSError, UnicodeDecodeError):
        return False
    return isinstance(data, dict) and "base" in data


def _sweep_pair(source: str | Path, overrides: Sequence[str]) -> tuple[Sweep, Sweep]:
    """Return a sweep, and the same with other draws or seeds, and with directions between its directions."""
    sweep = load_sweep(source, list(overrides))
    folder = sweep_file(source).resolve().parent
    document = sweep.settings.model_dump(mode="json", exclude_none=True)
    samples = document.get("samples")
    if samples is not None:
        samples["seed"] += samples["count"]
    else:
        document["set"] = {**document["set"], "seed": sweep.points[0].config.seed + 1000}
    for factor, written in zip(sweep.settings.factors, document["factors"], strict=True):
        if isinstance(factor, Directions):
            written["start_deg"] = factor.start_deg + 180.0 / factor.count
    return sweep, parse_sweep(write_yaml(document), name=f"{source}, held out", folder=folder)


def _config_pair(source: str | Path, overrides: Sequence[str], seeds: int) -> tuple[Sweep, Sweep]:
    config = load_config(source, list(overrides))

    def over(first: int) -> Sweep:
        document = {
            "name": "tuning",
            "base": str(config_file(source).resolve()),
            "set": dict(map(parse_assignment, overrides)),
            "factors": [{"key": "seed", "kind": "values", "values": list(range(first, first + seeds))}],
        }
        return parse_sweep(write_yaml(document), name=f"the tuning of {source}")

    return over(config.seed), over(config.seed + seeds)


def task_key(half: str, trial: int, point: Point) -> str:
    """Return a name of a point of a trial, for its scratch folder."""
    return f"{half}-{trial}-{point.key[:12]}"
