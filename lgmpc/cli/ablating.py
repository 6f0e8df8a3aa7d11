"""``lgmpc ablate``: the effect of removing each part of a controller."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.text import Text

from lgmpc.cli.screen import out, plain_table
from lgmpc.cli.sweeping import swept
from lgmpc.errors import Interrupted
from lgmpc.runs import atomic_write
from lgmpc.runs.atomic import json_values
from lgmpc.runs.figures import figure_words
from lgmpc.sweeps.ablation import COMPLETE, Worth, ablation_sweep, worths
from lgmpc.sweeps.comparison import Quantity

__all__ = ["ablate_shown"]

_TABLE = "ablation.json"
_CHANGES = 3
_OF_LIMIT, _OF_ITSELF = 0.02, 0.2
"""Smallest worsening displayed, as a share of the gate's limit; of the complete value where there is no limit."""


def ablate_shown(
    config: Path,
    keys: Sequence[str],
    overrides: Sequence[str],
    folder: Path | None,
    *,
    seeds: int,
    workers: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run the ablation, print its table, and return the exit code: 0 if all that was run has a verdict."""
    sweep, parts = ablation_sweep(config, keys, overrides, seeds=seeds)
    finished = swept(sweep, folder, workers=workers, resume=resume, quiet=quiet)
    if finished.signal is not None:
        out().print(Text("INTERRUPTED  the same command with --resume continues", "bold yellow"))
        return Interrupted(finished.signal).exit_code
    found = worths(sweep, finished.rows, parts)
    folder, summary = finished.folder, finished.summary
    complete = next(group for group in summary.groups if group.labels.get("variant") == COMPLETE)
    content = {"complete": json_values(asdict(complete.passed)), "parts": [each.content() for each in found]}
    with atomic_write(folder / _TABLE) as stream:
        stream.write((json.dumps(content, indent=2) + "\n").encode())
    if as_json:
        print(json.dumps({"folder": str(folder), **content}, indent=2))
    else:
        _show(out(), found, complete.passed.value)
        for reason, count in summary.broken.items():
            out().print(Text(f"{count} x {reason}", "yellow"))
        if not quiet:
            out().print(Text(f"saved in {folder} ({_TABLE}, results.jsonl)", "dim"))
    return 1 if summary.broken else 0


def _show(console: Console, found: Sequence[Worth], complete: float) -> None:
    table = plain_table("without", "description", "passed", "what gets worse (complete, without it, limit)")
    table.add_row("nothing", "the complete controller", f"{100.0 * complete:.3g} %", "", style="bold")
    for each in found:
        passed = "-" if math.isnan(each.passed.value) else f"{100.0 * each.passed.value:.3g} %"
        worse = list(filter(_matters, each.changes))[:_CHANGES]
        words = "; ".join(map(_words, worse)) or "nothing significant"
        style = "red" if each.lost > 0.0 else ""
        table.add_row(Text(each.part.name), each.part.words, Text(passed, style), Text(words))
    console.print(table)


def _matters(change: Quantity) -> bool:
    return (change.worsening or 0.0) >= (_OF_ITSELF if change.limit is None else _OF_LIMIT)


def _words(change: Quantity) -> str:
    name, unit, scale = figure_words(change.name.rpartition(".")[2])
    limit = "" if change.limit is None else f", limit {scale * change.limit:.3g}"
    return (
        f"{name} {scale * (change.first or 0.0):.3g} became {scale * (change.second or 0.0):.3g} {unit}".rstrip()
        + limit
    )
