"""The summary of a sweep (shares that pass, boundaries, effects of factors, paired differences) and its tables."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lgmpc.runs.atomic import json_values
from lgmpc.runs.figures import figure_words
from lgmpc.runs.tables import Table
from lgmpc.sweeps.design import Point, Sweep
from lgmpc.sweeps.rows import Ending, Estimate, Row, mean_difference, median, paired, place, share
from lgmpc.sweeps.settings import Choice, Directions, Expectation

MOST_GROUPS = 24
"""Largest number of groups by the levels of all factors; beyond it, points are grouped by base and variant."""

_BINS = 5
_NOT_COMPARED = ("_ms.", "real_time_factor", "deadline_misses")
"""Metrics of computing time, which are not comparable where several processes share a machine."""

Pair = tuple[Point, Row]


@dataclass(frozen=True)
class Group:
    """Points that share base, variant and levels.

    Attributes:
        labels: the shared base, variant and levels; of the effect of one factor its key as "factor", and "level".
        endings: number of points by ending.
        passed: share that passed, of those with a verdict.
        boundary: median of the boundaries found by bisections; ``None`` if none was.
        lowest: the smallest boundary.
        highest: the largest boundary.
        metrics: median of each kept metric.
    """

    labels: Mapping[str, str]
    endings: Mapping[str, int]
    passed: Estimate
    boundary: Estimate | None
    lowest: float | None
    highest: float | None
    metrics: Mapping[str, Estimate]


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
        levels: groups by the level of one factor, for each that has several, over all levels of the others.
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
    levels: tuple[Group, ...]
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
    metrics = {name: _values(row.metrics.get(name) for row in computed) for name in names}
    return Group(
        labels,
        endings,
        share(sum(row.passed for row in computed), len(computed)),
        median(found) if found else None,
        min(found, default=None),
        max(found, default=None),
        {name: median(values) for name, values in metrics.items() if values},
    )


def _values(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None and math.isfinite(value)]


def _levels(sweep: Sweep, pairs: Sequence[Pair]) -> Iterable[Group]:
    """Yield the points at each level of each factor, for each base and variant.

    Drawn numbers are in bins of equal count, the same for all.
    """
    draws = sweep.settings.samples.keys if sweep.settings.samples else ()
    drawn = {draw.key[0] for draw in draws if not isinstance(draw, Choice)}
    computed = [pair for pair in pairs if pair[1].ending.computed]
    labels = [_labels(sweep, point, ()) for point, _ in computed]
    for key in dict.fromkeys(key for point, _ in computed for key in point.levels):
        levels = [point.levels[key] for point, _ in computed]
        words = _bins(levels) if key in drawn else [level_text(each) for each in levels]
        if len(set(words)) < 2:
            continue
        ordered = [word for _, word in sorted(zip(map(_size, levels), words, strict=True))] if key in drawn else words
        for word in dict.fromkeys(ordered):
            for label in {repr(each): each for each in labels}.values():
                places = zip(words, labels, computed, strict=True)
                members = [pair for other, own, pair in places if (other, own) == (word, label)]
                yield _group({"factor": key, "level": word, **label}, members)


def _bins(levels: Sequence[Any]) -> list[str]:
    """Return the range of each drawn number; of few, the number itself."""
    sizes = np.array([_size(each) for each in levels])
    ordered = np.sort(sizes)
    if len(np.unique(ordered)) <= _BINS:
        return [level_text(float(each)) for each in sizes]
    edges = [*(ordered[i * len(ordered) // _BINS] for i in range(_BINS)), ordered[-1]]
    inside = np.searchsorted(edges[1:-1], sizes, side="right")
    return [f"{edges[i]:.3g} to {edges[i + 1]:.3g}" for i in inside]


def _size(level: Any) -> float:
    """Return a drawn number, or the length of a drawn vector."""
    return math.hypot(*level) if isinstance(level, (list, tuple)) else float(level)


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
            by_place.setdefault(place(point, variant=False), {})[point.variant] = row
    for name in names[1:]:
        both = [(rows[names[0]], rows[name]) for rows in by_place.values() if {names[0], name} <= rows.keys()]
        for quantity, values in paired(both).items():
            if not any(each in quantity for each in _NOT_COMPARED):
                yield Pairing(name, names[0], quantity, mean_difference([b - a for a, b in values]))


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


_MOST_METRICS = 4
_USUAL = ("survived_s", "max_tilt_deg")
"""Metrics in the tables of a sweep that names none."""


def summary_tables(summary: Summary, metrics: tuple[str, ...] | None) -> list[Table]:
    """Return the tables of groups, of levels and of pairs, those that have rows."""
    shown = metrics or _USUAL
    found = [group_table(summary.groups, shown), group_table(summary.levels, ()), _pairing_table(summary, shown)]
    return [each for each in found if each.rows]


def group_table(groups: Sequence[Group], metrics: Sequence[str]) -> Table:
    """Return a row for each group: the share that passed and the medians of metrics, or the boundaries."""
    labels = list(dict.fromkeys(label for group in groups for label in group.labels))
    bounded = any(group.boundary for group in groups)
    shown = () if bounded else metrics[:_MOST_METRICS]
    columns = ["boundary: median", "lowest", "highest"] if bounded else ["passed", *map(_heading, shown)]
    rows = []
    for group in groups:
        cells = [*(group.labels.get(label, "") for label in labels), str(sum(group.endings.values()))]
        rows.append((*cells, *(_boundaries(group) if bounded else _medians(group, shown))))
    return Table((*labels, "points", *columns), tuple(rows))


def _pairing_table(summary: Summary, metrics: Sequence[str]) -> Table:
    """Return the paired differences of each variant to the first one."""
    rows = tuple(
        (each.variant, each.against, each.quantity, str(each.difference), str(each.difference.count))
        for each in summary.pairings
        if each.quantity in ("passed", "boundary", *metrics)
    )
    return Table(("variant", "against", "quantity", "mean difference in pairs", "pairs"), rows)


def point_table(sweep: Sweep, rows: Mapping[str, Row]) -> Table:
    """Return a row for each finished point: its place in the sweep, its ending and the reasons."""
    keys = list(dict.fromkeys(key for point in sweep.points for key in point.levels))
    found = [(point, rows[point.key]) for point in sweep.points if point.key in rows]
    cells = tuple(
        (
            row.key[:12],
            point.base,
            point.variant,
            *(level_text(point.levels.get(key, "")) for key in keys),
            row.ending.value,
            "" if row.boundary is None else f"{row.boundary:.4g}",
            "; ".join(row.reasons),
        )
        for point, row in found
    )
    return Table(("point", "base", "variant", *keys, "ended", "boundary", "reasons"), cells)


def _boundaries(group: Group) -> tuple[str, ...]:
    if group.boundary is None:
        return "-", "-", "-"
    return str(group.boundary), f"{group.lowest:.3g}", f"{group.highest:.3g}"


def _medians(group: Group, shown: Sequence[str]) -> Iterator[str]:
    yield _percent(group.passed)
    for name in shown:
        scale = figure_words(name)[2]
        yield f"{scale * group.metrics[name].value:.3g}" if name in group.metrics else "-"


def _heading(metric: str) -> str:
    words, unit, _ = figure_words(metric)
    return f"median {words} / {unit}" if unit else f"median {words}"


def _percent(passed: Estimate) -> str:
    if not passed.count:
        return "-"
    return f"{100 * passed.value:.3g} % [{100 * passed.low:.3g}, {100 * passed.high:.3g}]"
