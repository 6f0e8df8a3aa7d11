"""The tables of a sweep's summary, as text: for the terminal and for reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lgmpc.runs.figures import figure_words
from lgmpc.runs.tables import Table
from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.rows import Estimate, Row
from lgmpc.sweeps.summary import Group, Summary, level_text

__all__ = ["group_table", "level_table", "point_table", "search_words", "summary_tables"]

_MOST_METRICS = 4
_USUAL = ("survived_s", "max_tilt_deg")
"""Metrics in the tables of a sweep that names none."""


def summary_tables(summary: Summary, metrics: tuple[str, ...] | None) -> list[Table]:
    """Return the tables of groups, of levels and of pairs, those that have rows."""
    found = [group_table(summary, metrics), level_table(summary), _pairing_table(summary, metrics)]
    return [each for each in found if each.rows]


def group_table(summary: Summary, metrics: tuple[str, ...] | None) -> Table:
    """Return a row for each group: the share that passed and the medians of metrics, or the boundaries."""
    labels = list(dict.fromkeys(label for group in summary.groups for label in group.labels))
    bounded = any(group.boundaries for group in summary.groups)
    shown = () if bounded else (metrics or _USUAL)[:_MOST_METRICS]
    columns = ["boundary: median", "lowest", "highest"] if bounded else ["passed", *map(_heading, shown)]
    rows = []
    for group in summary.groups:
        cells = [*(group.labels.get(label, "") for label in labels), str(sum(group.endings.values()))]
        rows.append((*cells, *(_boundaries(group) if bounded else _medians(group, shown))))
    return Table((*labels, "points", *columns), tuple(rows))


def level_table(summary: Summary) -> Table:
    """Return the share that passes at each level of each factor, for each base and variant."""
    labels = tuple(dict.fromkeys(label for each in summary.levels for label in each.labels))
    rows = tuple(
        (each.key, each.level, *each.labels.values(), str(each.passed.count), _percent(each.passed))
        for each in summary.levels
    )
    return Table(("factor", "level", *labels, "points", "passed"), rows)


def _pairing_table(summary: Summary, metrics: tuple[str, ...] | None) -> Table:
    """Return the paired differences of each variant to the first one."""
    shown = ("passed", "boundary", *(metrics or _USUAL))
    rows = tuple(
        (each.variant, each.against, each.quantity, str(each.difference), str(each.difference.count))
        for each in summary.pairings
        if each.quantity in shown
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


def search_words(sweep: Sweep, rows: Mapping[str, Row]) -> str:
    """Return a sentence on the assumption of the sweep's bisection and its probes; empty without a bisection."""
    search = sweep.settings.bisect
    if search is None:
        return ""
    violations = sum(len(row.violations) for row in rows.values())
    checked = f"{violations} probes below a boundary fail" if search.probes else "not checked (bisect.probes)"
    return f"bisection of {search.key} assumes that a run that passes at a value passes at every smaller one: {checked}"


def _boundaries(group: Group) -> tuple[str, ...]:
    found = group.boundaries
    return ("-", "-", "-") if found is None else (str(found.median), f"{found.low:.3g}", f"{found.high:.3g}")


def _medians(group: Group, shown: tuple[str, ...]) -> Iterator[str]:
    yield _percent(group.passed)
    for name in shown:
        scale = figure_words(name)[2]
        yield f"{scale * group.metrics[name].value:.3g}" if name in group.metrics else "-"


def _heading(metric: str) -> str:
    words, unit, _ = figure_words(metric.rpartition(".")[2])
    return f"median {words} / {unit}" if unit else f"median {words}"


def _percent(passed: Estimate) -> str:
    if not passed.count:
        return "-"
    return f"{100 * passed.value:.3g} % [{100 * passed.low:.3g}, {100 * passed.high:.3g}]"
