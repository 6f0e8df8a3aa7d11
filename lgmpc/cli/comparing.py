"""``lgmpc compare``: two runs or sweeps side by side."""

from __future__ import annotations

import json
import math
from pathlib import Path

from rich.console import Console
from rich.text import Text

from lgmpc.cli.screen import out, plain_table
from lgmpc.runs import find_run
from lgmpc.sweeps.comparison import Comparison, Quantity, compare_folders, is_sweep

__all__ = ["compare_shown"]


def compare_shown(
    first: str, second: str, runs: Path, *, margin: float, metrics: tuple[str, ...], as_json: bool, quiet: bool
) -> int:
    """Compare two runs or sweeps, print the tables, and return the exit code."""
    folders = [Path(text) if is_sweep(Path(text)) else find_run(text, runs) for text in (first, second)]
    found = compare_folders(*folders, margin=margin, metrics=metrics)
    if as_json:
        print(json.dumps(found.content(), indent=2, allow_nan=False))
    else:
        _show(out(), found, quiet=quiet)
    return 1 if found.worse else 0


def _show(console: Console, found: Comparison, *, quiet: bool) -> None:
    if not quiet:
        console.print(Text(f"A  {found.first}\nB  {found.second}", "dim"))
        if found.differences:
            table = plain_table("key", "A", "B")
            for each in found.differences:
                table.add_row(each.key, _value(each.first), _value(each.second))
            console.print(table)
        else:
            console.print("the configs are the same", style="dim")
        table = plain_table("quantity", "A", "B", "B - A", "")
        for quantity in found.quantities:
            table.add_row(*_cells(quantity))
        console.print(table)
    word, style = ("WORSE", "bold red") if found.worse else ("NOT WORSE", "bold green")
    console.print(Text.assemble((word, style), f"  B, beyond a margin of {100.0 * found.margin:g} %"))
    for reason in found.reasons:
        console.print(Text(f"  - {reason}"))


def _cells(quantity: Quantity) -> tuple[str, str, str, str, Text]:
    change = "-"
    if quantity.difference is not None:
        change = str(quantity.difference)
    elif quantity.first is not None and quantity.second is not None:
        change = f"{quantity.second - quantity.first:+.3g}"
    mark = Text()
    if quantity.worse:
        mark = Text("worse", "bold red")
    elif quantity.worsening is not None:
        mark = Text("ok", "green")
    return quantity.name, _value(quantity.first), _value(quantity.second), change, mark


def _value(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.4g}"
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
