"""Confidence intervals of shares, medians, and paired differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Estimate", "mean_difference", "median", "share"]

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
    """Return the share of hits with Wilson's score interval."""
    if count == 0:
        return Estimate(math.nan, 0.0, 1.0, 0)
    from scipy.stats import binomtest  # imported here, because it takes half a second

    interval = binomtest(hits, count).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(hits / count, float(interval.low), float(interval.high), count)


def median(values: Sequence[float]) -> Estimate:
    """Return the median with its bootstrap interval."""
    return _bootstrap(values, np.median)


def mean_difference(differences: Sequence[float]) -> Estimate:
    """Return the mean of differences in pairs with its bootstrap interval."""
    return _bootstrap(differences, np.mean)


def _bootstrap(values: Sequence[float], statistic: Callable[..., Any]) -> Estimate:
    """Return a statistic with its percentile interval; equal values give equal intervals, resampling is seeded."""
    if len(values) < 2:
        only = float(values[0]) if values else math.nan
        return Estimate(only, only, only, len(values))
    from scipy.stats import bootstrap

    resampling = {"n_resamples": _RESAMPLES, "confidence_level": CONFIDENCE, "method": "percentile"}
    rng = np.random.default_rng(_SEED)
    interval = bootstrap((values,), statistic, random_state=rng, **resampling).confidence_interval
    return Estimate(float(statistic(values)), float(interval.low), float(interval.high), len(values))
