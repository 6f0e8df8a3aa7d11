"""Tables of text, which the terminal and pages display: figures with limits, margins, events, checks."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from lgmpc.runs.events import Event, EventKind, event_lines
from lgmpc.runs.figures import figure_number, figure_of, figure_words
from lgmpc.runs.limited import Nearest

_MARKS = {EventKind.CAUSE: "strong", EventKind.MODE: "weak"}


class Table(NamedTuple):
    """Headings and rows of cells.

    Attributes:
        headings: of the columns.
        rows: cells as text.
        marks: of the rows: "good", "bad", "strong" or "weak"; empty for none.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    marks: Sequence[str] = ()


def limits_table(
    limited: Iterable[tuple[str, float | None, float]], others: Iterable[tuple[str, float | None]] = ()
) -> Table:
    """Return the table of figures with their limits, and of others without.

    Args:
        limited: key of each limit (``max_<figure>`` or ``min_<figure>``), measured value, limit.
        others: name of each figure, which ends in its unit, and value.
    """
    rows, marks = [], []
    for key, value, limit in limited:
        name, unit, scale = figure_words(figure_of(key), value, limit)
        highest = key.startswith("max_")
        value = math.nan if value is None else value
        kept = value <= limit if highest else value >= limit
        shown = figure_number(scale * value, unit, scale * limit)
        allowed = f"{'<=' if highest else '>='} {scale * limit:g}"
        mark = "not measured" if math.isnan(value) else "ok" if kept else "broken"
        rows.append((_heading(name, unit), shown, allowed, mark))
        marks.append("good" if kept else "bad")
    for figure, value in others:
        name, unit, scale = figure_words(figure, value)
        rows.append((_heading(name, unit), "-" if value is None else figure_number(scale * value, unit), "", ""))
        marks.append("")
    return Table(("figure", "measured", "allowed", ""), rows, marks)


def figures_table(figures: Mapping[str, float | None]) -> Table:
    """Return the table of figures by their names, which end in the unit; those of groups as ``group.name``."""
    rows = []
    for figure, value in figures.items():
        name, unit, scale = figure_words(figure, value)
        rows.append((name, "-" if value is None else figure_number(scale * value, unit), unit))
    return Table(("figure", "measured", "unit"), rows)


def margins_table(margins: Sequence[Nearest], quantity: str = "nearest to its limit") -> Table:
    """Return the table of margins, marked where the run failed because of them; ``quantity`` is the first heading."""
    rows = []
    for each in margins:
        when = "" if each.time_s is None else f"{each.time_s:.3f}"
        numbers = map(figure_number, (each.value, each.limit, each.margin))
        rows.append((_heading(each.name, each.unit), each.subject, when, *numbers))
    headings = (quantity, "where", "at / s", "value", "limit", "margin")
    return Table(headings, rows, ["bad" if each.broken else "" for each in margins])


def events_table(events: Sequence[Event], failed_s: float | None = None, failure: str = "") -> Table:
    """Return the table of a run's events in order, with its failure among them."""
    lines = [
        (each.start_s, f"{1e3 * each.lasting_s:.0f}", each.kind.value, each.words, _MARKS.get(each.kind, ""))
        for each in event_lines(events)
    ]
    if failed_s is not None:
        before = sum(start_s <= failed_s for start_s, *_ in lines)
        lines.insert(before, (failed_s, "", "FAILURE", failure, "bad"))
    rows = [(f"{start_s:.3f}", *cells) for start_s, *cells, _ in lines]
    return Table(("at / s", "lasts / ms", "what", ""), rows, [mark for *_, mark in lines])


def _heading(name: str, unit: str) -> str:
    return f"{name} / {unit}" if unit else name
