"""Values of factors, and draws from distributions by inverse transform: the same for random and stratified draws."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any, Literal

import numpy as np

from lgmpc.sweeps.settings import (
    Choice,
    Directions,
    Distribution,
    Factor,
    Horizontal,
    LogUniform,
    Normal,
    Samples,
    Spaced,
    Uniform,
)
from lgmpc.typing import Array

__all__ = ["draws", "factor_values", "unit_cube"]

_EDGE = 1e-12  # a normal distribution has no value at probabilities 0 and 1


def factor_values(factor: Factor) -> tuple[Any, ...]:
    """Return the values that a factor takes, in order."""
    if isinstance(factor, Spaced):
        return tuple(float(x) for x in np.linspace(*factor.range, factor.count))
    if isinstance(factor, Directions):
        start = math.radians(factor.start_deg)
        angles = (start + 2.0 * math.pi * i / factor.count for i in range(factor.count))
        return tuple(_horizontal(factor.size, angle) for angle in angles)
    return factor.values


def draws(samples: Samples) -> list[tuple[Any, ...]]:
    """Return the drawn values of all keys: ``count`` tuples with one value for each of ``samples.keys``."""
    widths = [2 if isinstance(each, Horizontal) else 1 for each in samples.keys]
    cube = unit_cube(samples.method, samples.count, sum(widths), np.random.default_rng(samples.seed))
    starts = np.cumsum([0, *widths])
    return [tuple(_value(each, row[starts[k] : starts[k + 1]]) for k, each in enumerate(samples.keys)) for row in cube]


def unit_cube(method: Literal["random", "latin_hypercube"], count: int, width: int, rng: np.random.Generator) -> Array:
    """Return (count, width) numbers in [0, 1): independent, or a Latin hypercube.

    A Latin hypercube (McKay, Beckman and Conover, Technometrics 1979) has in each column exactly one number in each of
    ``count`` equal parts of the interval.
    """
    cube = rng.random((count, width))
    if method == "latin_hypercube":
        parts = np.column_stack([rng.permutation(count) for _ in range(width)])
        cube = (parts + cube) / count
    return cube


def _value(distribution: Distribution, u: Array) -> Any:
    """Return the value whose cumulative probability is ``u``; a horizontal vector takes two, for direction and size."""
    x = float(u[0])
    if isinstance(distribution, Choice):
        return distribution.values[int(x * len(distribution.values))]
    if isinstance(distribution, Normal):
        return NormalDist(distribution.mean, distribution.std).inv_cdf(min(max(x, _EDGE), 1.0 - _EDGE))
    low, high = distribution.range
    if isinstance(distribution, LogUniform):
        return math.exp(math.log(low) + x * math.log(high / low))
    if isinstance(distribution, Uniform):
        return low + x * (high - low)
    return _horizontal(low + float(u[1]) * (high - low), 2.0 * math.pi * x)


def _horizontal(size: float, angle: float) -> tuple[float, float, float]:
    """Return the horizontal vector of a size and direction; rounded, so that an axis is hit exactly."""
    return round(size * math.cos(angle), 12), round(size * math.sin(angle), 12), 0.0
