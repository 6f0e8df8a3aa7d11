"""Progress on stderr: bars on terminals, lines elsewhere; warnings."""

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

Step = TypeVar("Step")


@dataclass(frozen=True)
class Display(Generic[Step]):
    """Displays progress.

    Attributes:
        announce: displays what is being prepared.
        advance: displays a progress report.
    """

    announce: Callable[[str], None]
    advance: Callable[[Step], None]


@contextmanager
def progress_display(
    console: Console,
    lines: Callable[[Step], Iterable[str]],
    bar: Callable[[Step], Mapping[str, Any]],
    *,
    quiet: bool,
    above: bool = False,
) -> Iterator[Display[Step]]:
    """Display progress: a bar on terminals, lines elsewhere.

    Args:
        console: to print to.
        lines: the lines of a report.
        bar: description, completed, total and state of a report, those that change.
        quiet: display nothing.
        above: print the lines on terminals too, above the bar.
    """

    def write(text: str) -> None:
        console.print(text, markup=False)

    def write_lines(now: Step) -> None:
        for line in lines(now):
            write(line)

    if quiet:
        yield Display(_ignore, _ignore)
        return
    if not console.is_terminal:
        yield Display(write, write_lines)
        return
    description, state = (TextColumn(text, markup=False) for text in ("{task.description}", "{task.fields[state]}"))
    with Progress(SpinnerColumn(), description, BarColumn(), state, console=console, transient=True) as shown:
        task = shown.add_task("preparing", total=None, state="")

        def advance(now: Step) -> None:
            if above:
                write_lines(now)
            shown.update(task, **bar(now))

        yield Display(lambda message: shown.update(task, description=message), advance)


def _ignore(_: object) -> None:
    pass


@contextmanager
def warnings_on(console: Console) -> Iterator[None]:
    """Print log records from WARNING on, and Python's warnings without their line of code."""
    handler = RichHandler(logging.WARNING, console, show_path=False, show_time=False)
    logger, before = logging.getLogger("lgmpc"), warnings.showwarning
    logger.addHandler(handler)
    warnings.showwarning = lambda message, *_, **__: logger.warning("%s", message)
    try:
        yield
    finally:
        warnings.showwarning = before
        logger.removeHandler(handler)
