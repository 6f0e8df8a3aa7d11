"""The record of a finished point, one line of JSON, and estimates from many of them with confidence intervals."""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from lgmpc.errors import RunFolderError
from lgmpc.settings.messages import show_value
from lgmpc.sweeps.design import Point


class Ending(str, Enum):
    """The ending of a point."""

    PASS = "pass"
    """It passed its gate, or its boundary was found."""
    FAIL = "fail"
    """It failed its gate."""
    UNBRACKETED = "unbracketed"
    """Both ends of its bisection have the same verdict."""
    RAISED = "raised"
    """It raised an error."""
    HUNG = "hung"
    """It exceeded the sweep's time limit."""
    DIED = "died"
    """Its process ended: killed, out of memory, or crashed in native code."""

    @property
    def computed(self) -> bool:
        """Whether there is a verdict."""
        return self in (Ending.PASS, Ending.FAIL)


@dataclass(frozen=True)
class Row:
    """A finished point.

    Attributes:
        key: key of the point.
        ending: its ending.
        reasons: reasons why it did not pass.
        metrics: the kept metrics by name; ``None`` where there was nothing to measure.
        boundary: result of its bisection; ``None`` if there was none or it found no boundary.
        trials: values that the bisection tried, and whether each passed.
        simulated_s: simulated time, s.
        elapsed_s: computing time in its process, s.
        log: name of its run folder among the sweep's logs, which may have been removed for that of a failure; empty if
            it was not kept.
        base: as in :class:`lgmpc.sweeps.design.Point`, and so are the next three.
        variant: name of the variant.
        levels: value of each factor and draw.
        draw: number of the draw.
    """

    key: str
    ending: Ending
    reasons: tuple[str, ...] = ()
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    boundary: float | None = None
    trials: tuple[tuple[float, bool], ...] = ()
    simulated_s: float = 0.0
    elapsed_s: float = 0.0
    log: str = ""
    base: str = ""
    variant: str = ""
    levels: Mapping[str, Any] = field(default_factory=dict)
    draw: int | None = None

    @property
    def passed(self) -> bool:
        """Whether the run passed."""
        return self.ending is Ending.PASS

    @property
    def quantities(self) -> Mapping[str, float | None]:
        """Its figures by name: ``boundary``, or ``passed`` and the metrics."""
        return {"passed": float(self.passed), **self.metrics} if self.boundary is None else {"boundary": self.boundary}

    def to_json(self) -> str:
        """Return the row as one line of JSON, with null for NaN and infinity."""
        return _ROW.dump_json(self).decode()

    @classmethod
    def from_json(cls, line: bytes, source: str) -> "Row":
        """Read a line; ``source`` names it in errors.

        Raises:
            RunFolderError: if it is not a row.
        """
        try:
            return _ROW.validate_json(line, strict=True)
        except ValidationError as error:
            first = error.errors()[0]
            words = ".".join(map(str, first["loc"])) + (": " if first["loc"] else "") + first["msg"]
            got = "" if first["type"] in ("missing", "json_invalid") else f", got {show_value(first['input'])}"
            raise RunFolderError(f"{source} is not a row of a sweep: {words}{got}") from error


_ROW = TypeAdapter(Row)


def place(item: "Point | Row", *, variant: bool = True) -> str:
    """Return base, variant (unless left out), levels and draw as text, the same of a point and of its row."""
    parts = [item.base, item.variant if variant else "", dict(item.levels), item.draw]
    return json.dumps(parts, sort_keys=True)


def paired(pairs: Iterable[tuple[Row, Row]]) -> dict[str, list[tuple[float, float]]]:
    """Return the values of each quantity in the pairs of rows that both have it as a finite number, by its name."""
    found: dict[str, list[tuple[float, float]]] = {}
    for first, second in pairs:
        for name, x in first.quantities.items():
            y = second.quantities.get(name)
            if x is not None and y is not None and math.isfinite(x) and math.isfinite(y):
                found.setdefault(name, []).append((x, y))
    return found


_CONFIDENCE = 0.95
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

    interval = binomtest(hits, count).proportion_ci(_CONFIDENCE, method="wilson")
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

    resampling = {"n_resamples": _RESAMPLES, "confidence_level": _CONFIDENCE, "method": "percentile"}
    rng = np.random.default_rng(_SEED)
    interval = bootstrap((values,), statistic, random_state=rng, **resampling).confidence_interval
    return Estimate(float(statistic(values)), float(interval.low), float(interval.high), len(values))
