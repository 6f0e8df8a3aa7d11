"""The definition of a tuning: keys and ranges, points, and objective."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lgmpc.config.loading import load_config
from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import parse_scalar, parse_yaml, write_yaml
from lgmpc.errors import InputError
from lgmpc.runs import metric_names
from lgmpc.shipped import config_file, shipped_sweeps, sweep_file
from lgmpc.sweeps.bisection import scaled
from lgmpc.sweeps.comparison import higher_is_better
from lgmpc.sweeps.design import Point, Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.rows import Row
from lgmpc.sweeps.values import parse_assignments, value_at

__all__ = ["Dimension", "Objective", "Score", "TuningProblem", "parse_dimension", "tuning_problem"]

_SPREAD = 3.0
"""Factor of the default range of a key, from a third of the present value to three times it."""


@dataclass(frozen=True)
class Dimension:
    """A tuned key. If it is a vector, numbers multiply that vector.

    Attributes:
        key: dotted key.
        low: lower end of the range; unused with choices.
        high: upper end of the range.
        logarithmic: whether the range is sampled logarithmically.
        whole: whether only whole numbers are tried.
        choices: values instead of a range; empty for a range.
        initial: the present value; 1 where a vector is scaled.
    """

    key: str
    low: float
    high: float
    logarithmic: bool
    whole: bool
    choices: tuple[Any, ...]
    initial: Any


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
        held_out: points of the same kind with other seeds and draws, not used in trials.
    """

    name: str
    dimensions: tuple[Dimension, ...]
    objective: Objective
    tuned: Sweep
    held_out: Sweep

    @property
    def initial(self) -> dict[str, Any]:
        """The present values by their keys."""
        return {each.key: each.initial for each in self.dimensions}

    def apply(self, config: Config, values: Mapping[str, Any]) -> Config:
        """Return a config with tuned values.

        Raises:
            InputError: a value is invalid in the config.
        """
        for each in self.dimensions:
            value = values[each.key]
            config = config.replace({each.key: value}) if each.choices else scaled(config, each.key, value)
        return config

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
    source: str | Path, keys: Sequence[str], objective: str, *, overrides: Sequence[str] = (), seeds: int = 4
) -> TuningProblem:
    """Return the problem of tuning a config over its seeds, or over the points of a sweep.

    Args:
        source: a config or a sweep: a file, or the name of a shipped one.
        keys: see :func:`parse_dimension`.
        objective: a metric of a run, ``passed``, or of sweeps with a bisection ``boundary``.
        overrides: changes ``key=value`` of the config, or of the document of the sweep.
        seeds: number of seeds of a config to tune over, and of further ones held out; unused for sweeps.

    Raises:
        ConfigError: config or sweep cannot be read or used.
        InputError: a key, the objective or ``seeds`` cannot be used.
    """
    if seeds < 1:
        raise InputError("seeds", seeds, "at least 1")
    if not keys:
        raise InputError("keys", "nothing", "keys to tune: --keys mpc.weights.force=1e-4:1e-2:log")
    tuned, held_out = _sweep_pair(source, overrides) if _is_sweep(source) else _config_pair(source, overrides, seeds)
    searched = tuned.settings.bisect is not None
    known = ["boundary"] if searched else ["passed", *metric_names()]
    if objective not in known:
        raise InputError(
            "objective", objective, "boundary" if searched else "a metric of a run, or passed", known, word=objective
        )
    dimensions = tuple(parse_dimension(tuned.points[0].config, text) for text in keys)
    problem = TuningProblem(tuned.settings.name, dimensions, Objective(objective), tuned, held_out)
    for each in dimensions:
        for end in each.choices or (each.low, each.high):
            problem.apply(tuned.points[0].config, {**problem.initial, each.key: end})
    return problem


def parse_dimension(config: Config, text: str) -> Dimension:
    """Parse a key to tune, with its range or choices.

    Args:
        config: config with the present values.
        text: ``KEY``, ``KEY=LOW:HIGH``, ``KEY=LOW:HIGH:log`` or ``KEY=[A, B, C]``.

    Raises:
        InputError: no such key, it is neither a number nor a vector, or the range is invalid.
    """
    key, given, value = (part.strip() for part in text.partition("="))
    present = value_at(config, key)
    if value.startswith("["):
        choices = parse_scalar(value, key, "--keys")
        if not all(isinstance(each, (str, int, float)) for each in [*choices, present]):
            raise InputError(key, value, "choices that are words, numbers or truth values: KEY=[A, B]")
        choices = tuple(dict.fromkeys([present, *choices]))
        if len(choices) < 2:
            raise InputError(key, value, "a choice besides the present value")
        return Dimension(key, math.nan, math.nan, False, False, choices, present)
    vector = isinstance(present, (list, tuple)) and all(isinstance(each, (int, float)) for each in present)
    if not vector and (isinstance(present, bool) or not isinstance(present, (int, float))):
        raise InputError(key, present, "a number or a vector, or choices: KEY=[A, B]")
    initial = 1.0 if vector else present
    whole = isinstance(initial, int)
    if not given:
        if initial <= 0:
            raise InputError(key, f"no range, and the present value is {initial:g}", "a range: KEY=LOW:HIGH")
        low, high, logarithmic = initial / _SPREAD, initial * _SPREAD, True
        if whole:
            low, high = max(1, round(low)), round(high)
        return Dimension(key, low, high, logarithmic, whole, (), initial)
    ends, logarithmic = value.removesuffix(":log").split(":"), value.endswith(":log")
    try:
        low, high = map(int if whole else float, ends)
    except ValueError:
        kind = "whole numbers" if whole else "numbers"
        raise InputError(key, value, f"a range of {kind}: LOW:HIGH or LOW:HIGH:log") from None
    if not low < high or (logarithmic and low <= 0):
        raise InputError(key, value, f"LOW below HIGH{', above zero' if logarithmic else ''}")
    if not low <= initial <= high:
        present_is = "1: a vector is scaled" if vector else f"the present value, {initial:g}"
        raise InputError(key, value, f"a range that contains {present_is}")
    return Dimension(key, low, high, logarithmic, whole, (), initial)


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
    sweep = load_sweep(source, list(overrides))
    folder = sweep_file(source).resolve().parent
    document = sweep.settings.model_dump(mode="json", exclude_none=True)
    samples = document.get("samples")
    if samples is not None:
        samples["seed"] += samples["count"]
    else:
        document["set"] = {**document["set"], "seed": sweep.points[0].config.seed + 1000}
    return sweep, parse_sweep(write_yaml(document), name=f"{source}, held out", folder=folder)


def _config_pair(source: str | Path, overrides: Sequence[str], seeds: int) -> tuple[Sweep, Sweep]:
    config = load_config(source, list(overrides))

    def over(first: int) -> Sweep:
        document = {
            "name": "tuning",
            "base": str(config_file(source).resolve()),
            "set": parse_assignments(overrides),
            "factors": [{"key": "seed", "kind": "values", "values": list(range(first, first + seeds))}],
        }
        return parse_sweep(write_yaml(document), name=f"the tuning of {source}")

    return over(config.seed), over(config.seed + seeds)


def task_key(half: str, trial: int, point: Point) -> str:
    """Return a name of a point of a trial, for its scratch folder."""
    return f"{half}-{trial}-{point.key[:12]}"
