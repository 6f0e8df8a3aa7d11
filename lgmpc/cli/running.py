"""``lgmpc run`` while it runs: a bar over simulated time."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, SpinnerColumn, TaskID, TextColumn
from rich.progress import Progress as Bar

from lgmpc.cli.screen import err, show_finished
from lgmpc.config import Config
from lgmpc.config.build import build_gate
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.session import Progress

__all__ = ["run_shown"]


def run_shown(config: Config, folder: Path, *, as_json: bool) -> int:
    """Run ``config`` with a progress bar, print the verdict, and return the exit code."""
    console = err()
    bar = Bar(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} / {task.total:g} s{task.fields[state]}"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    with bar, _warnings_on(console):
        task = bar.add_task("preparing", total=config.duration_s, state="")
        finished = run_config(
            config,
            folder,
            notify=lambda message: _tell(bar, task, message),
            progress=lambda now: _move(bar, task, now),
        )
    if as_json:
        _print_json(finished)
    else:
        show_finished(finished, build_gate(config))
    return finished.session.verdict.exit_code


def _tell(bar: Bar, task: TaskID, message: str) -> None:
    if bar.disable:
        bar.console.print(message, markup=False)
    else:
        bar.update(task, description=message)


def _move(bar: Bar, task: TaskID, now: Progress) -> None:
    state = f"  tilt {now.tilt_deg:.2f} deg  {now.real_time_factor:.1f} x real time"
    bar.update(task, description="simulating", completed=now.time_s, state=state)


@contextmanager
def _warnings_on(console: Console) -> Iterator[None]:
    """Show log records from WARNING on above the bar."""
    handler = RichHandler(logging.WARNING, console, show_path=False, show_time=False)
    logger = logging.getLogger("lgmpc")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _print_json(finished: FinishedRun) -> None:
    content = json.loads(finished.result.to_json())
    print(json.dumps({"folder": str(finished.folder.path), **content}, indent=2))
