"""The definition of a tuning: keys, objective, and points, of which some are held out."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from lgmpc.config.loading import load_config, parse_assignment
from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import parse_scalar, parse_yaml, write_yaml
from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.runs import metric_names
from lgmpc.shipped import config_file, shipped_sweeps, sweep_file
from lgmpc.sweeps.comparison import higher_is_better
from lgmpc.sweeps.design import Sweep, load_sweep, parse_sweep, scaled, value_at
from lgmpc.sweeps.rows import Row
from lgmpc.sweeps.settings import Directions

try:
    from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
except ImportError as error:
    raise MissingDependencyError("optuna", "lgmpc tune", 'pip install "lgmpc[tune]"') from error

__all__ = ["Dimension", "Score", "TuningProblem", "parse_dimension", "tuning_problem"]

_SPREAD = 3.0
"""Factor of the default range of a key, from a third of the present value to three times it."""


class Dimension(NamedTuple):
    """A tuned key. If it is a vector, numbers multiply that vector.

    Attributes:
        key: dotted key.
        present: the present value.
        distribution: range or choices of the tried values.
    """

    key: str
    present: Any
    distribution: BaseDistribution

    @property
    def initial(self) -> Any:
        """The number or choice that leaves the key as it is: the present value, or 1 if a vector is scaled."""
        return 1.0 if isinstance(self.present, (list, tuple)) else self.present

    @property
    def ends(self) -> tuple[Any, ...]:
        """The choices, or the ends of the range."""
        kind: Any = self.distribution
        return tuple(kind.choices) if isinstance(kind, CategoricalDistribution) else (kind.low, kind.high)

    def value(self, number: Any) -> Any:
        """Return the value that the key gets from a number of the range, or from a choice."""
        return [number * each for each in self.present] if isinstance(self.present, (list, tuple)) else number


@dataclass(frozen=True)
class Score:
    """The score of values over a set of points.

    Attributes:
        passed: share of the points that pass.
        value: mean of the objective over the points at which it was measured; NaN if there are none.
    """

    passed: float
    value: float

    def __str__(self) -> str:
        return f"{self.value:.4g} ({100.0 * self.passed:.3g} % passed)"


@dataclass(frozen=True)
class TuningProblem:
    """Keys, points and objective.

    Attributes:
        name: name of the config or sweep.
        dimensions: the tuned keys.
        objective: a metric, ``boundary``, or ``passed``.
        tuned: the points of the trials.
        held_out: points of the same kind with other seeds, draws and directions, not used in trials.
    """

    name: str
    dimensions: tuple[Dimension, ...]
    objective: str
    tuned: Sweep
    held_out: Sweep

    @property
    def initial(self) -> dict[str, Any]:
        """The numbers and choices, by their keys, that leave the configs as they are."""
        return {each.key: each.initial for each in self.dimensions}

    @property
    def maximized(self) -> bool:
        """Whether larger values of the objective are better."""
        return higher_is_better(self.objective)

    def score(self, rows: Sequence[Row]) -> Score:
        """Return the score of finished points."""
        measured = (row.quantities.get(self.objective) for row in rows)
        values = [value for value in measured if value is not None and math.isfinite(value)]
        mean = math.fsum(values) / len(values) if values else math.nan
        return Score(sum(row.passed for row in rows) / len(rows), mean)

    def rank(self, score: Score) -> tuple[float, float]:
        """Return a rank, higher for a better score: more points pass, or as many with a better value."""
        value = score.value if self.maximized else -score.value
        return score.passed, -math.inf if math.isnan(value) else value

    def apply(self, config: Config, values: Mapping[str, Any]) -> Config:
        """Return a config with the numbers and choices of a trial; raise InputError if one is invalid in it."""
        for each in self.dimensions:
            number = values[each.key]
            chosen = isinstance(each.distribution, CategoricalDistribution)
            config = config.replace({each.key: number}) if chosen else scaled(config, each.key, number)
        return config

    def bases(self) -> Iterator[Config]:
        """Yield the base configs, with the changes for all points, without factors, draws and variants."""
        for base in self.tuned.bases:
            yield base.replace(copy.deepcopy(dict(self.tuned.settings.set)))


def tuning_problem(
    source: str | Path, keys: Sequence[str], objective: str, *, overrides: Sequence[str] = (), seeds: int | None = None
) -> TuningProblem:
    """Return the problem of tuning a config over its seeds, or over the points of a sweep.

    Args:
        source: a config or a sweep: a file, or the name of a shipped one.
        keys: see :func:`parse_dimension`.
        objective: a metric of a run, ``passed``, or of sweeps with a bisection ``boundary``.
        overrides: changes ``key=value`` of the config, or of the document of the sweep.
        seeds: number of seeds of a config to tune over, and of further ones held out, 4 unless given. Not for sweeps.

    Raises:
        ConfigError: config or sweep cannot be read or used.
        InputError: a key, the objective or ``seeds`` cannot be used; a key is named twice, or its present values
            differ between the points.
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
        raise InputError("objective", objective, "boundary" if searched else "a metric of a run, or passed", known)
    problem = TuningProblem(tuned.settings.name, (), objective, tuned, held_out)
    configs = [*(point.config for point in tuned.points), *problem.bases()]
    dimensions = tuple(parse_dimension(configs[0], text) for text in keys)
    for i, each in enumerate(dimensions):
        if each.key in [other.key for other in dimensions[:i]]:
            raise InputError(each.key, "the key twice", "each key to tune once")
        there = {repr(value): str(value) for value in (value_at(config, each.key) for config in configs)}
        if len(there) > 1:
            words = f"{', '.join(list(there.values())[:3])} at different points"
            raise InputError(each.key, words, "a key with one present value at all points")
    problem = replace(problem, dimensions=dimensions)
    for key, end in ((each.key, end) for each in dimensions for end in each.ends):
        problem.apply(configs[0], {**problem.initial, key: end})
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
    document = sweep.settings.model_dump(mode="json", exclude_none=True)
    samples = document.get("samples")
    if samples is not None:
        samples["seed"] += samples["count"]
    else:
        document["set"] = {**document["set"], "seed": sweep.points[0].config.seed + 1000}
    for factor, written in zip(sweep.settings.factors, document["factors"], strict=True):
        if isinstance(factor, Directions):
            written["start_deg"] = factor.start_deg + 180.0 / factor.count
    folder = sweep_file(source).resolve().parent
    return sweep, parse_sweep(write_yaml(document), name=f"{source}, held out", folder=folder)


def _config_pair(source: str | Path, overrides: Sequence[str], seeds: int) -> tuple[Sweep, Sweep]:
    first = load_config(source, list(overrides)).seed

    def over(first: int) -> Sweep:
        document = {
            "name": "tuning",
            "base": str(config_file(source).resolve()),
            "set": dict(map(parse_assignment, overrides)),
            "factors": [{"key": "seed", "kind": "values", "values": list(range(first, first + seeds))}],
        }
        return parse_sweep(write_yaml(document), name=f"the tuning of {source}")

    return over(first), over(first + seeds)


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
    if isinstance(present, Mapping):
        raise InputError(key, "a table", "one value of it", [f"{key}.{each}" for each in present])
    if value.startswith("["):
        choices = list(dict.fromkeys([present, *_choices(key, value, present)]))
        if len(choices) < 2:
            raise InputError(key, value, "a choice besides the present value")
        return Dimension(key, present, CategoricalDistribution(choices))
    vector = isinstance(present, (list, tuple)) and all(isinstance(each, (int, float)) for each in present)
    if not vector and (isinstance(present, bool) or not isinstance(present, (int, float))):
        raise InputError(key, present, "a number or a vector, or choices: KEY=[A, B]")
    initial: Any = 1.0 if vector else present
    number, spread = (int, IntDistribution) if isinstance(initial, int) else (float, FloatDistribution)
    if not given:
        if initial <= 0:
            raise InputError(key, f"no range, and the present value is {initial:g}", "a range: KEY=LOW:HIGH")
        low, high, logarithmic = initial / _SPREAD, initial * _SPREAD, True
        if number is int:
            low, high = max(1, round(low)), round(high)
    else:
        ends, logarithmic = value.removesuffix(":log").split(":"), value.endswith(":log")
        try:
            low, high = map(number, ends)
        except ValueError:
            kind = "whole numbers" if number is int else "numbers"
            raise InputError(key, value, f"a range of {kind}: LOW:HIGH or LOW:HIGH:log") from None
        if not low < high or (logarithmic and low <= 0):
            raise InputError(key, value, f"LOW below HIGH{', above zero' if logarithmic else ''}")
        if not low <= initial <= high:
            words = "1: the vector is multiplied by it" if vector else f"the present value, {initial:g}"
            raise InputError(key, value, f"a range that contains {words}")
    return Dimension(key, present, spread(low, high, log=logarithmic))


def _choices(key: str, text: str, present: Any) -> list[Any]:
    choices = parse_scalar(text, key, "--keys")
    if not all(isinstance(each, (str, int, float)) for each in [*choices, present]):
        raise InputError(key, text, "choices that are words, numbers or truth values: KEY=[A, B]")
    return list(choices)
