"""Confidence intervals of shares, medians, and paired differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from lgmpc.typing import Array

__all__ = ["Estimate", "bootstrap", "mean_difference", "median", "share"]

CONFIDENCE = 0.95
_RESAMPLES = 2000
_SEED = 20


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % confidence interval.

    Attributes:
        value: the estimate.
        low: lower end of the interval.
        high: upper end of the interval.
        count: number of observations.
    """

    value: float
    low: float
    high: float
    count: int

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def share(hits: int, count: int) -> Estimate:
    """Return the share of hits with Wilson's score interval (J. Am. Stat. Assoc. 1927)."""
    if count == 0:
        return Estimate(math.nan, 0.0, 1.0, 0)
    z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
    p, zz = hits / count, z * z / count
    centre = (p + 0.5 * zz) / (1.0 + zz)
    half = z / (1.0 + zz) * math.sqrt(p * (1.0 - p) / count + 0.25 * zz / count)
    return Estimate(p, max(0.0, centre - half), min(1.0, centre + half), count)


def median(values: Sequence[float]) -> Estimate:
    """Return the median with its bootstrap interval."""
    return bootstrap(values, lambda drawn: np.median(drawn, axis=-1))


def mean_difference(differences: Sequence[float]) -> Estimate:
    """Return the mean of differences in pairs with its bootstrap interval."""
    return bootstrap(differences, lambda drawn: np.mean(drawn, axis=-1))


def bootstrap(values: Sequence[float], statistic: Callable[[Array], Array]) -> Estimate:
    """Return a statistic with its percentile interval over resamples (Efron, Annals of Statistics 1979).

    Args:
        values: observations; equal ones give equal intervals, because the resampling is seeded.
        statistic: function of arrays (..., n), over their last axis.
    """
    data = np.asarray(values, dtype=float)
    if data.size == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    drawn = data[np.random.default_rng(_SEED).integers(data.size, size=(_RESAMPLES, data.size))]
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(statistic(drawn), [tail, 100.0 - tail])
    return Estimate(float(statistic(data)), float(low), float(high), data.size)
