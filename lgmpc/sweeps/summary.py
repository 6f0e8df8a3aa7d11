"""The summary of a sweep: shares that pass, boundaries, effects of factors, paired differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from lgmpc.runs.atomic import json_values
from lgmpc.sweeps.design import Point, Sweep
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.settings import Choice, Directions, Expectation
from lgmpc.sweeps.statistics import Estimate, mean_difference, median, share

__all__ = ["Boundaries", "Group", "Level", "Pairing", "Summary", "level_text", "summarize"]

MOST_GROUPS = 24
"""Largest number of groups by the levels of all factors; beyond it, points are grouped by base and variant."""

_BINS = 5
_NOT_COMPARED = ("_ms.", "real_time_factor", "deadline_misses")
"""Metrics of computing time, which are not comparable where several processes share a machine."""

Pair = tuple[Point, Row]


@dataclass(frozen=True)
class Boundaries:
    """Boundaries found by bisections.

    Attributes:
        median: median of all.
        low: the smallest.
        high: the largest.
        violations: values below a boundary that failed.
    """

    median: Estimate
    low: float
    high: float
    violations: int


@dataclass(frozen=True)
class Group:
    """Points that share base, variant and, if there are few, the levels of the factors.

    Attributes:
        labels: the shared base, variant and levels.
        endings: number of points by ending.
        passed: share that passed, of those with a verdict.
        boundaries: boundaries found by bisections.
        metrics: median of each kept metric.
    """

    labels: Mapping[str, str]
    endings: Mapping[str, int]
    passed: Estimate
    boundaries: Boundaries | None
    metrics: Mapping[str, Estimate]


@dataclass(frozen=True)
class Level:
    """Share that passes at one level of one factor, over all levels of the others, of one base and variant.

    Attributes:
        labels: base and variant, where there are several.
        key: key of the factor.
        level: value of the factor, or range of values.
        passed: share that passed.
    """

    labels: Mapping[str, str]
    key: str
    level: str
    passed: Estimate


@dataclass(frozen=True)
class Pairing:
    """A variant compared with the first one at the same points.

    Attributes:
        variant: name of the variant.
        against: name of the first.
        quantity: a metric, ``boundary`` or ``passed``.
        difference: mean over the pairs of the variant's minus the first's.
    """

    variant: str
    against: str
    quantity: str
    difference: Estimate


@dataclass(frozen=True)
class Summary:
    """The figures of a sweep.

    Attributes:
        name: name of the sweep.
        total: number of points.
        finished: number of finished points.
        passing: number of points that passed; of a bisection those whose boundary was found.
        groups: groups by base, variant and levels.
        levels: effect of each factor that has several levels, for each base and variant.
        pairings: paired comparisons of variants.
        broken: number of points without a verdict, by reason.
        expecting: whether the sweep's ``expect`` has a condition.
        complaints: what is missing and violated conditions of ``expect``, in words; empty if the sweep passed.
    """

    name: str
    total: int
    finished: int
    passing: int
    groups: tuple[Group, ...]
    levels: tuple[Level, ...]
    pairings: tuple[Pairing, ...]
    broken: Mapping[str, int]
    expecting: bool
    complaints: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every point is finished and has a verdict, and the sweep's ``expect`` is satisfied."""
        return not self.complaints

    @property
    def verdict(self) -> str:
        """``pass``, ``fail``, or ``done`` where some points did not pass and the sweep expects no share of them to."""
        if not self.passed:
            return "fail"
        return "pass" if self.expecting or self.passing == self.total else "done"

    @property
    def count(self) -> str:
        """Sentence on how many points passed."""
        return f"{self.passing} of {self.total} points passed"

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {"passed": self.passed, **json_values(asdict(self))}


def summarize(sweep: Sweep, rows: Mapping[str, Row]) -> Summary:
    """Summarize a sweep.

    Args:
        sweep: its document and points.
        rows: the finished points by their keys.
    """
    pairs = [(point, rows[point.key]) for point in sweep.points if point.key in rows]
    broken: dict[str, int] = {}
    for _, row in pairs:
        if not row.ending.computed:
            reason = f"{row.ending.value}: {'; '.join(row.reasons)}"
            broken[reason] = broken.get(reason, 0) + 1
    return Summary(
        name=sweep.settings.name,
        total=len({point.key for point in sweep.points}),
        finished=len({point.key for point, _ in pairs}),
        passing=len({point.key for point, row in pairs if row.passed}),
        groups=tuple(_group(labels, members) for labels, members in _grouped(sweep, pairs)),
        levels=tuple(_levels(sweep, pairs)) if sweep.settings.bisect is None else (),
        pairings=tuple(_pairings(sweep, pairs)),
        broken=broken,
        expecting=sweep.settings.expect != Expectation(),
        complaints=tuple(_complaints(sweep, pairs)),
    )


def _grouped(sweep: Sweep, pairs: Sequence[Pair]) -> list[tuple[dict[str, str], list[Pair]]]:
    """Group by base, variant and levels; directions of a bisection belong to one boundary."""
    round_about = [factor.key[0] for factor in sweep.settings.factors if isinstance(factor, Directions)]
    factors = [each.key[0] for each in sweep.settings.factors if each.key[0] not in round_about]
    for keys in (factors, []):
        groups: dict[str, tuple[dict[str, str], list[Pair]]] = {}
        for pair in pairs:
            labels = _labels(sweep, pair[0], keys)
            groups.setdefault(repr(labels), (labels, []))[1].append(pair)
        if len(groups) <= MOST_GROUPS:
            break
    return list(groups.values())


def _labels(sweep: Sweep, point: Point, keys: Iterable[str]) -> dict[str, str]:
    labels = {"base": point.base} if len(sweep.settings.base) > 1 else {}
    if point.variant:
        labels["variant"] = point.variant
    return labels | {key: level_text(point.levels[key]) for key in keys}


def _group(labels: dict[str, str], pairs: Sequence[Pair]) -> Group:
    rows = [row for _, row in pairs]
    computed = [row for row in rows if row.ending.computed]
    endings = {each.value: n for each in Ending if (n := sum(row.ending is each for row in rows))}
    names = dict.fromkeys(name for row in computed for name in row.metrics)
    found = [row.boundary for row in rows if row.boundary is not None]
    boundaries = None
    if found:
        boundaries = Boundaries(median(found), min(found), max(found), sum(len(row.violations) for row in rows))
    metrics = {name: _values(row.metrics.get(name) for row in computed) for name in names}
    return Group(
        labels,
        endings,
        share(sum(row.passed for row in computed), len(computed)),
        boundaries,
        {name: median(values) for name, values in metrics.items() if values},
    )


def _values(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None and math.isfinite(value)]


def _levels(sweep: Sweep, pairs: Sequence[Pair]) -> Iterable[Level]:
    """Yield the share that passes at each level of each factor, for each base and variant.

    Drawn numbers are in bins of equal count, the same for all.
    """
    draws = sweep.settings.samples.keys if sweep.settings.samples else ()
    drawn = {draw.key[0] for draw in draws if not isinstance(draw, Choice)}
    computed = [pair for pair in pairs if pair[1].ending.computed]
    for key in dict.fromkeys(key for point, _ in computed for key in point.levels):
        values = [_size(point.levels[key]) if key in drawn else level_text(point.levels[key]) for point, _ in computed]
        distinct = list(dict.fromkeys(values))
        if len(distinct) < 2:
            continue
        if key not in drawn or len(distinct) <= _BINS:
            bins: list[tuple[str, Callable[[Any], bool]]] = [(level_text(each), _equals(each)) for each in distinct]
        else:
            ordered = sorted(values)
            edges = [*(ordered[i * len(ordered) // _BINS] for i in range(_BINS)), ordered[-1]]
            bins = [
                (f"{low:.3g} to {high:.3g}", _between(low, high, last=high == edges[-1]))
                for low, high in zip(edges, edges[1:], strict=False)
            ]
        members: dict[str, tuple[dict[str, str], list[tuple[Any, Row]]]] = {}
        for value, (point, row) in zip(values, computed, strict=True):
            labels = _labels(sweep, point, ())
            members.setdefault(repr(labels), (labels, []))[1].append((value, row))
        for words, inside in bins:
            for labels, own in members.values():
                rows = [row for value, row in own if inside(value)]
                yield Level(labels, key, words, share(sum(row.passed for row in rows), len(rows)))


def _size(level: Any) -> Any:
    """Return a comparable level: a number or text unchanged, a drawn vector by its length."""
    if isinstance(level, (list, tuple)):
        numbers = all(isinstance(each, (int, float)) for each in level)
        return round(math.hypot(*level), 9) if numbers else repr(level)
    return level if isinstance(level, (int, float, str)) else repr(level)


def _equals(level: Any) -> Callable[[Any], bool]:
    return lambda value: bool(value == level)


def _between(low: Any, high: Any, *, last: bool) -> Callable[[Any], bool]:
    return lambda value: low <= value < high or (last and value == high)


def level_text(level: object) -> str:
    """Return a level as text: numbers short, also those of a vector."""
    if isinstance(level, (list, tuple)):
        return f"[{', '.join(level_text(each) for each in level)}]"
    return f"{level:.4g}" if isinstance(level, float) else str(level)


def _pairings(sweep: Sweep, pairs: Sequence[Pair]) -> Iterable[Pairing]:
    """Yield the paired differences of each variant to the first, over the points where both have a verdict."""
    names = list(sweep.settings.variants)
    if len(names) < 2 or not sweep.settings.paired:
        return
    by_place: dict[str, dict[str, Row]] = {}
    for point, row in pairs:
        if row.ending.computed:
            by_place.setdefault(repr((point.base, point.levels, point.draw)), {})[point.variant] = row
    for name in names[1:]:
        both = [(rows[names[0]], rows[name]) for rows in by_place.values() if {names[0], name} <= rows.keys()]
        for quantity in dict.fromkeys(each for first, _ in both for each in _quantities(first)):
            differences = _values(
                None if a is None or b is None else b - a
                for a, b in ((_quantities(x).get(quantity), _quantities(y).get(quantity)) for x, y in both)
            )
            if differences:
                yield Pairing(name, names[0], quantity, mean_difference(differences))


def _quantities(row: Row) -> dict[str, float | None]:
    if row.boundary is not None:
        return {"boundary": row.boundary}
    timeless = {name: value for name, value in row.metrics.items() if not any(each in name for each in _NOT_COMPARED)}
    return {"passed": float(row.passed), **timeless}


def _complaints(sweep: Sweep, pairs: Sequence[Pair]) -> Iterable[str]:
    rows = [row for _, row in pairs]
    expect = sweep.settings.expect
    missing = len({point.key for point in sweep.points}) - len({row.key for row in rows})
    if missing:
        yield f"{missing} points are not finished: add --resume"
    broken = sum(not row.ending.computed for row in rows)
    if broken:
        yield f"{broken} points have no verdict"
    computed = [row for row in rows if row.ending.computed]
    passed = sum(row.passed for row in computed) / len(computed) if computed else 0.0
    if expect.min_pass_fraction is not None and passed < expect.min_pass_fraction:
        yield f"{100 * passed:.3g} % passed, expected at least {100 * expect.min_pass_fraction:.3g} %"
    lowest = min((row.boundary for row in rows if row.boundary is not None), default=math.inf)
    if expect.min_boundary is not None and lowest < expect.min_boundary:
        yield f"the smallest boundary is {lowest:.3g}, expected at least {expect.min_boundary:g}"
