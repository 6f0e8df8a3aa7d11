"""``lgmpc sweep`` and ``compare``: progress of many runs, and the tables of their results."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.text import Text

from lgmpc.cli.display import Display, progress_display
from lgmpc.cli.screen import err, out, show_table
from lgmpc.errors import InputError, Interrupted
from lgmpc.runs import atomic_write, find_run, versions
from lgmpc.runs.tables import Table
from lgmpc.sweeps import FinishedSweep, Sweep, SweepProgress, run_sweep
from lgmpc.sweeps.comparison import Comparison, Quantity, compare_folders, is_sweep
from lgmpc.sweeps.dataset import write_dataset
from lgmpc.sweeps.folder import SUMMARY
from lgmpc.sweeps.report import draw_sweep
from lgmpc.sweeps.summary import Summary, summary_tables

_MOST_REASONS = 5


def part_of(sweep: Sweep, text: str) -> Sweep:
    """Return a part ``K/N`` of a sweep."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise InputError("--part", text, "K/N, such as 2/16")
    return sweep.part(int(number), int(count))


def sweep_shown(
    sweep: Sweep,
    folder: Path | None,
    workers: int | None,
    dataset: Path | None,
    *,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run a sweep, showing its progress, print its tables, write its dataset, and return the exit code."""
    total = len({point.key for point in sweep.points})
    with _points_display(total, quiet=quiet) as display:
        notify, progress = display.announce, display.advance
        finished = run_sweep(sweep, folder, workers=workers, resume=resume, notify=notify, progress=progress)
    summary = finished.summary
    content = summary.content() | {"versions": dict(versions())}
    with atomic_write(finished.folder / SUMMARY) as file:
        file.write((json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
    figure = draw_sweep(sweep, finished.rows, summary, finished.folder)
    if as_json:
        print(json.dumps({"folder": str(finished.folder), **content}, indent=2))
    else:
        _show_sweep(out(), finished, summary, figure, quiet=quiet)
    if dataset is not None:
        episodes, frames = write_dataset(finished.folder, dataset)
        err().print(f"wrote {dataset}: {episodes} episodes, {frames} frames", markup=False)
    if finished.signal is not None:
        return Interrupted(finished.signal).exit_code
    return 0 if summary.passed else 1


@contextmanager
def _points_display(total: int, *, quiet: bool) -> Iterator[Display[SweepProgress]]:
    """Show the finished points and the time that the others will take: a bar on terminals, some ten lines elsewhere."""
    done, first, clock = 0, math.inf, 0.0  # finished points: now, and when the computation began

    def state(now: SweepProgress) -> str:
        nonlocal done
        done = now.done
        text = f"  {now.failed} not passed" if now.failed else ""
        text += "" if now.speed is None else f"  {now.speed:.2f} simulated s per s and core"
        if not total > done > first:
            return text
        left = (perf_counter() - clock) * (total - done) / (done - first)
        return f"{text}  about {timedelta(seconds=round(left))} left"

    def lines(now: SweepProgress) -> Iterator[str]:
        text = state(now)
        if now.done % max(1, total // 10) == 0:
            yield f"{now.done} of {total} points{text}"

    def bar(now: SweepProgress) -> Mapping[str, Any]:
        return {"completed": now.done, "total": total, "state": f"{now.done} / {total}{state(now)}"}

    def announce(message: str) -> None:
        nonlocal first, clock
        first, clock = done, perf_counter()  # preparations do not count
        display.announce(message)

    with progress_display(err(), lines, bar, quiet=quiet) as display:
        yield Display(announce, display.advance)


def _show_sweep(
    console: Console, finished: FinishedSweep, summary: Summary, figure: Path | None, *, quiet: bool
) -> None:
    if not quiet:
        for table in summary_tables(summary, finished.sweep.settings.metrics):
            show_table(table)
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


def compare_shown(
    first: str, second: str, runs: Path, *, margin: float, metrics: tuple[str, ...], as_json: bool, quiet: bool
) -> int:
    """Compare two runs or sweeps, print the tables, and return the exit code."""
    folders = [Path(text) if is_sweep(Path(text)) else find_run(text, runs) for text in (first, second)]
    found = compare_folders(*folders, margin=margin, metrics=metrics)
    if as_json:
        print(json.dumps(found.content(), indent=2, allow_nan=False))
    else:
        _show_comparison(out(), found, quiet=quiet)
    return 1 if found.worse else 0


def _show_comparison(console: Console, found: Comparison, *, quiet: bool) -> None:
    if not quiet:
        console.print(Text(f"A  {found.first}\nB  {found.second}", "dim"))
        if found.differences:
            rows = [(each.key, _value(each.first), _value(each.second)) for each in found.differences]
            show_table(Table(("key", "A", "B"), rows))
        else:
            console.print("the configs are the same", style="dim")
        if found.log is not None:
            words = f"differ first {found.log}" if found.log else "are equal, bit for bit"
            console.print(Text(f"the logs {words}", "dim"))
        marks = ["bad" if each.worse else "" if each.worsening is None else "good" for each in found.quantities]
        show_table(Table(("quantity", "A", "B", "B - A", ""), [*map(_cells, found.quantities)], marks))
    word, style = ("WORSE", "bold red") if found.worse else ("NOT WORSE", "bold green")
    console.print(Text.assemble((word, style), f"  B, beyond a margin of {100.0 * found.margin:g} %"))
    for reason in found.reasons:
        console.print(Text(f"  - {reason}"))


def _cells(quantity: Quantity) -> tuple[str, ...]:
    first, second, change = quantity.first, quantity.second, "-"
    if quantity.difference is not None:
        change = str(quantity.difference)
    elif first is not None and second is not None:
        change = f"{second - first:+.3g}"
    judged = "worse" if quantity.worse else "" if quantity.worsening is None else "ok"
    return quantity.name, _value(first), _value(second), change, judged


def _value(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.4g}"
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
