"""From the document of a sweep to its points, each with a whole checked config and a key that identifies it."""

import copy
import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from lgmpc.config.loading import apply_overrides, load_config, validated
from lgmpc.config.schema import Config, ConfigSource
from lgmpc.config.yaml_text import parse_yaml, read_text
from lgmpc.errors import ConfigError, InputError
from lgmpc.runs import metric_names, versions
from lgmpc.settings.messages import show_value
from lgmpc.shipped import shipped_configs, shipped_sweeps, sweep_file
from lgmpc.sweeps.settings import (
    Choice,
    Directions,
    Distribution,
    Factor,
    Horizontal,
    Normal,
    Samples,
    SweepSettings,
    Uniform,
)
from lgmpc.typing import Array


@dataclass(frozen=True)
class Point:
    """One point of a sweep.

    Attributes:
        key: identifier of the computation: a hash of the resolved config, the search, and the versions of packages.
        base: name of the base config.
        variant: name of the variant; empty if there are none.
        levels: value of each factor and draw, by the first of its keys.
        draw: number of the random draw; ``None`` if nothing is drawn.
        config: the resolved config.
    """

    key: str
    base: str
    variant: str
    levels: Mapping[str, Any]
    draw: int | None
    config: Config


@dataclass(frozen=True)
class Sweep:
    """A sweep, checked.

    Attributes:
        settings: its document.
        points: points in the order of computation: variants next to each other.
        bases: the base configs, without any of its changes.
    """

    settings: SweepSettings
    points: tuple[Point, ...]
    bases: tuple[Config, ...]

    def part(self, number: int, count: int) -> "Sweep":
        """Return every ``count``-th point, from the ``number``-th on: a part for one of several machines.

        Raises:
            InputError: a number that is not from 1 to ``count``.
        """
        if not 1 <= number <= count:
            raise InputError("part", f"{number}/{count}", "K/N, K from 1 to N")
        return replace(self, points=self.points[number - 1 :: count])


def load_sweep(path: str | Path, overrides: list[str] | tuple[str, ...] = ()) -> Sweep:
    """Read, change and check the document of a sweep, and build its points.

    Args:
        path: the YAML file, or the name of a shipped sweep such as ``push_map``.
        overrides: changes ``key=value`` of the document, such as ``samples.count=20``.

    Raises:
        ConfigError: if the file cannot be read, is not YAML, or has keys or values that cannot be used; if a factor,
            draw, variant or search is of a key that the base configs do not have, or gives it an invalid value.
    """
    file = sweep_file(path)
    expected = "a YAML file, or the name of a shipped sweep (`lgmpc configs` lists them)"
    text = read_text(file, expected, list(shipped_sweeps()))
    return parse_sweep(text, name=str(file), folder=file.parent, overrides=overrides)


def parse_sweep(
    text: str, *, name: str = "sweep", folder: Path | None = None, overrides: list[str] | tuple[str, ...] = ()
) -> Sweep:
    """Check the document of a sweep, given as text; errors as :func:`load_sweep`.

    Args:
        text: the YAML document.
        name: name of the document in messages.
        folder: folder for relative paths of base configs; the working directory unless given.
        overrides: changes ``key=value``.
    """
    data, places = parse_yaml(text, name)
    if not isinstance(data, dict):
        raise ConfigError(name, "", show_value(data), "a table of keys (name: ..., base: ..., factors: ...)")
    source = ConfigSource(name, places | apply_overrides(data, overrides))
    settings = validated(SweepSettings, data, source)
    _check_metrics(settings, source)
    files = [_base_file(base, folder or Path(), source) for base in settings.base]
    bases = tuple(map(load_config, files))
    # Absolute, so that the copy of the document in the sweep's folder refers to the same files.
    settings = settings.model_copy(update={"base": tuple(map(_base_name, settings.base, files))})
    return Sweep(settings, tuple(_points(settings, bases, source)), bases)


@dataclass(frozen=True)
class _Change:
    """Values that are written into a base config, and the key of the sweep's document that they come from."""

    origin: str
    values: Mapping[str, Any]


def _points(settings: SweepSettings, bases: tuple[Config, ...], source: ConfigSource) -> Iterator[Point]:
    """Yield the points; variants vary fastest, then draws, then factors, then bases."""
    drawn = list(enumerate(_draws(settings.samples))) if settings.samples else [(None, ())]
    grid = list(itertools.product(*(_factor_values(factor) for factor in settings.factors)))
    common = [_Change(f"set.{key}", {key: value}) for key, value in settings.set.items()]
    if settings.gate is not None:
        common.append(_Change("gate", {"gate": settings.gate.model_dump(exclude_unset=True)}))
    for config in bases:
        for levels, (number, draw) in itertools.product(grid, drawn):
            named: dict[str, Any] = {}
            varied = []
            for i, (factor, level) in enumerate(zip(settings.factors, levels, strict=True)):
                named[factor.key[0]] = level
                varied.append(_Change(f"factors.{i}", dict.fromkeys(factor.key, level)))
            if settings.samples and number is not None:
                varied.append(_Change("samples.seed", {"seed": settings.samples.seed + number}))
                for i, (distribution, value) in enumerate(zip(settings.samples.keys, draw, strict=True)):
                    named[distribution.key[0]] = value
                    varied.append(_Change(f"samples.keys.{i}", dict.fromkeys(distribution.key, value)))
            for variant, changes in settings.variants.items() or (("", {}),):
                own = [_Change(f"variants.{variant}.{key}", {key: value}) for key, value in changes.items()]
                resolved = _resolve(config, [*common, *own, *varied], source)
                if settings.bisect is not None:
                    _check_bisection(resolved, settings, source)
                yield Point(_key(resolved, settings), config.name, variant, named, number, resolved)


def _resolve(config: Config, changes: list[_Change], source: ConfigSource) -> Config:
    """Return the config with all changes; an error names the part of the document with the invalid value."""
    # Copied, because a later key may reach into an earlier value: pushes, then pushes.0.impulse_ns.
    values = copy.deepcopy({key: value for change in changes for key, value in change.values.items()})
    try:
        return config.replace(values)
    except InputError as error:
        key = error.argument
        own = [each for each in changes if any(_within(key, name) or _within(name, key) for name in each.values)]
        origin = own[-1].origin if own else "base"
        got = f"{key}: {error.got}"
        raise ConfigError(source.where(origin), origin, got, error.expected, error.choices, word=key) from error


def _within(key: str, outer: str) -> bool:
    return key == outer or key.startswith(f"{outer}.")


def _check_bisection(config: Config, settings: SweepSettings, source: ConfigSource) -> None:
    assert settings.bisect is not None
    for end in settings.bisect.range:
        try:
            scaled(config, settings.bisect.key, end)
        except InputError as error:
            where = source.where("bisect.key")
            got = f"{error.argument}: {error.got}"
            raise ConfigError(where, "bisect", got, error.expected, error.choices, word=error.argument) from error


def _check_metrics(settings: SweepSettings, source: ConfigSource) -> None:
    known = metric_names()
    for i, name in enumerate(settings.metrics or ()):
        if name not in known:
            key = f"metrics.{i}"
            raise ConfigError(source.where(key), key, name, "a metric of a run", known)


def _base_file(base: str, folder: Path, source: ConfigSource) -> Path:
    if (folder / base).is_file():
        return folder / base
    shipped = shipped_configs()
    if base not in shipped:
        expected = f"a file (from {folder.resolve()} on), or the name of a shipped config"
        raise ConfigError(source.where("base"), "base", base, expected, list(shipped), word=base)
    return shipped[base].file


def _base_name(base: str, file: Path) -> str:
    """Return the name of a shipped config, or the absolute path of another one's file."""
    shipped = shipped_configs().get(base)
    return base if shipped is not None and shipped.file == file else str(file.resolve())


def _key(config: Config, settings: SweepSettings) -> str:
    content = {
        "config": config.model_dump(mode="json", exclude={"name"}),
        "bisect": None if settings.bisect is None else settings.bisect.model_dump(mode="json"),
        "versions": dict(versions()),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


_EDGE = 1e-12  # a normal distribution has no value at probabilities 0 and 1


def _factor_values(factor: Factor) -> tuple[Any, ...]:
    """Return the values that a factor takes, in order."""
    if isinstance(factor, Directions):
        start = math.radians(factor.start_deg)
        angles = (start + 2.0 * math.pi * i / factor.count for i in range(factor.count))
        return tuple(_horizontal(factor.size, angle) for angle in angles)
    return factor.values


def _draws(samples: Samples) -> list[tuple[Any, ...]]:
    """Return the drawn values of all keys: ``count`` tuples with one value for each of ``samples.keys``."""
    widths = [2 if isinstance(each, Horizontal) else 1 for each in samples.keys]
    cube = _unit_cube(samples.method, samples.count, sum(widths), np.random.default_rng(samples.seed))
    starts = np.cumsum([0, *widths])
    return [tuple(_value(each, row[starts[k] : starts[k + 1]]) for k, each in enumerate(samples.keys)) for row in cube]


def _unit_cube(method: str, count: int, width: int, rng: np.random.Generator) -> Array:
    """Return (count, width) numbers in [0, 1): independent, or a Latin hypercube.

    A Latin hypercube (McKay, Beckman and Conover, Technometrics 1979) has in each column exactly one number in each of
    ``count`` equal parts of the interval.
    """
    cube = rng.random((count, width))
    if method == "latin_hypercube":
        cube = (np.column_stack([rng.permutation(count) for _ in range(width)]) + cube) / count
    return cube


def _value(distribution: Distribution, u: Array) -> Any:
    """Return the value whose cumulative probability is ``u``; a horizontal vector takes two, for direction and size."""
    x = float(u[0])
    if isinstance(distribution, Choice):
        return distribution.values[int(x * len(distribution.values))]
    if isinstance(distribution, Normal):
        return NormalDist(distribution.mean, distribution.std).inv_cdf(min(max(x, _EDGE), 1.0 - _EDGE))
    low, high = distribution.range
    if distribution.kind == "log_uniform":
        return math.exp(math.log(low) + x * math.log(high / low))
    if isinstance(distribution, Uniform):
        return low + x * (high - low)
    return _horizontal(low + float(u[1]) * (high - low), 2.0 * math.pi * x)


def _horizontal(size: float, angle: float) -> tuple[float, float, float]:
    """Return the horizontal vector of a size and direction; rounded, so that an axis is hit exactly."""
    return round(size * math.cos(angle), 12), round(size * math.sin(angle), 12), 0.0


def scaled(config: Config, key: str, value: float) -> Config:
    """Return the config with ``value`` at ``key``; if the key is a vector, with the vector times ``value``.

    Raises:
        InputError: no such key, it is neither a number nor a vector, or the value is invalid.
    """
    present = config.value(key)
    if isinstance(present, (list, tuple)) and present and all(isinstance(each, (int, float)) for each in present):
        return config.replace({key: tuple(value * each for each in present)})
    return config.replace({key: value})
