"""``lgmpc sweep``: progress of many runs, and the tables of their summary."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lgmpc.cli.display import counting_display, duration_words
from lgmpc.cli.screen import err, out, plain_table
from lgmpc.errors import Interrupted
from lgmpc.runs import atomic_write, versions
from lgmpc.sweeps import FinishedSweep, Sweep, SweepProgress, run_sweep
from lgmpc.sweeps.folder import SUMMARY
from lgmpc.sweeps.report import draw_sweep
from lgmpc.sweeps.summary import Summary
from lgmpc.sweeps.tables import TextTable, group_table, level_table, pairing_table, search_words

__all__ = ["sweep_shown", "swept"]

_MOST_REASONS = 5


def sweep_shown(
    sweep: Sweep,
    folder: Path | None,
    *,
    workers: int | None,
    dask: str | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run a sweep, showing its progress, print its tables, and return the exit code."""
    finished = swept(sweep, folder, workers=workers, dask=dask, resume=resume, quiet=quiet)
    folder, summary = finished.folder, finished.summary
    content = summary.content() | {"versions": dict(versions())}
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    with atomic_write(folder / SUMMARY) as stream:
        stream.write(text.encode())
    figure = draw_sweep(sweep, finished.rows, summary, folder)
    if as_json:
        print(json.dumps({"folder": str(folder), **content}, indent=2))
    else:
        _show(out(), finished, summary, figure, quiet=quiet)
    if finished.signal is not None:
        return Interrupted(finished.signal).exit_code
    return 0 if summary.passed else 1


def swept(
    sweep: Sweep,
    folder: Path | None,
    *,
    workers: int | None,
    resume: bool,
    quiet: bool,
    dask: str | None = None,
) -> FinishedSweep:
    """Run a sweep, showing its progress."""
    total = len({point.key for point in sweep.points})
    with counting_display(err(), total, "points", _state, every=max(1, total // 10), quiet=quiet) as display:
        compute = partial(run_sweep, sweep, folder, workers=workers, dask=dask, resume=resume)
        return compute(notify=display.announce, progress=display.advance)


def _show(console: Console, finished: FinishedSweep, summary: Summary, figure: Path | None, *, quiet: bool) -> None:
    if not quiet:
        metrics = finished.sweep.settings.metrics
        console.print(_table(group_table(summary, metrics)))
        if summary.levels:
            console.print(_table(level_table(summary)))
        if summary.pairings:
            console.print(_table(pairing_table(summary, metrics)))
        search = search_words(finished.sweep, finished.rows)
        if search:
            console.print(Text(search, "dim"))
        for reason, count in list(summary.broken.items())[:_MOST_REASONS]:
            console.print(Text(f"{count} x {reason}", "yellow"))
    if finished.signal is not None:
        words = f"  {summary.name}: the same command with --resume continues"
        console.print(Text.assemble(("INTERRUPTED", "bold yellow"), words))
        return
    style = {"pass": "bold green", "fail": "bold red", "done": "bold"}[summary.verdict]
    console.print(Text.assemble((summary.verdict.upper(), style), f"  {summary.name}: {summary.count}"))
    for complaint in summary.complaints:
        console.print(Text(f"  - {complaint}"))
    if not quiet:
        speed = finished.progress.speed
        rate = "" if speed is None else f"; {speed:.2f} simulated seconds per second and core"
        files = ", ".join(["results.jsonl", SUMMARY, *([figure.name] if figure else [])])
        console.print(Text(f"saved in {finished.folder} ({files}){rate}"), style="dim")


def _table(table: TextTable) -> Table:
    shown = plain_table(*table.headings)
    for row in table.rows:
        shown.add_row(*row)
    return shown


def _state(now: SweepProgress) -> str:
    failed = f"  {now.failed} not passed" if now.failed else ""
    rest = "" if now.remaining_s is None else f"  about {duration_words(now.remaining_s)} left"
    speed = "" if now.speed is None else f"  {now.speed:.2f} simulated s per s and core"
    return f"{failed}{rest}{speed}"
