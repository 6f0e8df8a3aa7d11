"""``lgmpc explain``: the events before a failure, and the smallest margins."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lgmpc.cli.screen import out, plain_table, show_verdict
from lgmpc.config.showing import SolveExplanation, explain
from lgmpc.runs import Verdict
from lgmpc.runs.events import EventKind, EventLine, event_lines
from lgmpc.runs.figures import figure_number
from lgmpc.runs.forensics import Explanation
from lgmpc.runs.limited import Nearest

__all__ = ["explain_shown"]

_STYLES = {EventKind.CAUSE: "bold", EventKind.MODE: "dim", EventKind.BALANCE: "red", EventKind.SOLVER: "red"}
_NEAREST = 8


def explain_shown(folder: Path, into: Path | None, *, as_json: bool) -> None:
    """Explain a run and print it."""
    explanation, figure = explain(folder, into)
    if as_json:
        print(json.dumps({"folder": str(folder), "figure": str(figure), **explanation.content()}, indent=2))
        return
    _show(out(), explanation)
    out().print(f"wrote {figure}", markup=False)
    if isinstance(explanation, Explanation) and explanation.replay_from_s is not None:
        argument = shlex.quote(f"{folder}@{explanation.replay_from_s:g}")
        words = f"next: lgmpc run --from {argument} --set KEY=VALUE    (changed from the first event on)"
        out().print(Text(words, "dim"))


def _show(console: Console, explanation: Explanation | SolveExplanation) -> None:
    show_verdict(console, Verdict(explanation.outcome), explanation.name)
    for sentence in explanation.summary:
        console.print(Text(f"  - {sentence}"))
    if isinstance(explanation, Explanation):
        if explanation.events:
            console.print(_chain(event_lines(explanation.events), explanation.failed_s, explanation.failure))
        if explanation.earlier:
            counts = (f"{count} x {name}" for name, count in explanation.earlier.items())
            console.print(Text(f"earlier: {', '.join(counts)}", "dim"))
    if explanation.nearest:
        console.print(_margins(explanation.nearest[:_NEAREST]))


def _chain(lines: Sequence[EventLine], failed_s: float | None, failure: str) -> Table:
    """Return the table of events, with the failure among them."""
    rows = [
        (each.start_s, f"{1e3 * each.lasting_s:.0f}", each.kind.value, each.words, _STYLES.get(each.kind, ""), "")
        for each in lines
    ]
    if failed_s is not None:
        before = sum(each.start_s <= failed_s for each in lines)
        rows.insert(before, (failed_s, "", "FAILURE", failure, "bold red", "bold red"))
    table = plain_table("at / s", "lasts / ms", "what", "")
    for start_s, lasts, kind, words, *styles in rows:
        table.add_row(f"{start_s:.3f}", lasts, Text(kind, styles[0]), Text(words, styles[1]))
    return table


def _margins(nearest: Sequence[Nearest]) -> Table:
    table = plain_table("nearest to its limit", "where", "at / s", "value", "limit", "margin")
    for each in nearest:
        name = f"{each.name} / {each.unit}" if each.unit else each.name
        when = "" if each.time_s is None else f"{each.time_s:.3f}"
        figures = (figure_number(value) for value in (each.value, each.limit, each.margin))
        style = "red" if each.broken else ""
        table.add_row(name, each.subject, when, *figures, style=style)
    return table
