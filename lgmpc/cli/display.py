"""Progress on stderr, and the table of figures with their limits, of runs and solves."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, Protocol, TextIO, TypeVar

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from lgmpc.runs.figures import figure_number, figure_words

__all__ = [
    "Counted",
    "Display",
    "Row",
    "Silent",
    "counting_display",
    "duration_words",
    "figure_table",
    "progress_bar",
    "warnings_on",
]

Step = TypeVar("Step", contravariant=True)


class Display(Protocol[Step]):
    """Displays progress."""

    def announce(self, message: str) -> None:
        """Display what is being prepared."""

    def advance(self, now: Step) -> None:
        """Display a progress report."""


class Silent:
    """Displays nothing."""

    def announce(self, message: str) -> None:
        """Do nothing."""

    def advance(self, now: object) -> None:
        """Do nothing."""


class Counted(Protocol):
    """Progress through a known number of steps."""

    @property
    def done(self) -> int:
        """Steps that are finished."""

    @property
    def total(self) -> int:
        """All steps."""


CountedStep = TypeVar("CountedStep", bound=Counted)


class _Lines(Generic[CountedStep]):
    """For pipes and files: a line for each ``every`` steps."""

    def __init__(self, console: Console, steps: str, every: int, state: Callable[[CountedStep], str]) -> None:
        self._console, self._steps, self._every, self._state = console, steps, every, state
        self._next = 0

    def announce(self, message: str) -> None:
        self._console.print(message, markup=False)

    def advance(self, now: CountedStep) -> None:
        if now.done >= self._next:
            self._next = now.done + self._every
            self._console.print(f"{now.done} of {now.total} {self._steps}{self._state(now)}", markup=False)


class _Moving(Generic[CountedStep]):
    """For terminals: a bar over the steps."""

    def __init__(self, bar: Bar, total: int, state: Callable[[CountedStep], str]) -> None:
        self._bar, self._state = bar, state
        self._task = bar.add_task("preparing", total=total, state="")

    def announce(self, message: str) -> None:
        self._bar.update(self._task, description=message)

    def advance(self, now: CountedStep) -> None:
        self._bar.update(self._task, completed=now.done, state=self._state(now))


@contextmanager
def counting_display(
    console: Console, total: int, steps: str, state: Callable[[CountedStep], str], *, every: int = 1, quiet: bool
) -> Iterator[Display[CountedStep]]:
    """Display progress through ``total`` steps: a bar on terminals, lines elsewhere.

    Args:
        console: to print to.
        total: number of steps.
        steps: noun of the steps, in the plural.
        state: text on the state of a report, printed after its count.
        every: steps between two lines.
        quiet: display nothing.
    """
    if quiet:
        yield Silent()
    elif not console.is_terminal:
        yield _Lines(console, steps, every, state)
    else:
        with progress_bar(console, "{task.completed} / {task.total}{task.fields[state]}") as bar:
            yield _Moving(bar, total, state)


def duration_words(seconds: float) -> str:
    """Return a duration in hours and minutes, or in minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


def progress_bar(console: Console, text: str) -> Bar:
    """Return a line with spinner, the task's description, bar, and ``text``, a template of the task's fields."""
    description, state = (TextColumn(template, markup=False) for template in ("{task.description}", text))
    return Bar(SpinnerColumn(), description, BarColumn(), state, console=console, transient=True)


@contextmanager
def warnings_on(console: Console) -> Iterator[None]:
    """Print log records from WARNING on, and Python's warnings without their line of code."""
    handler = RichHandler(logging.WARNING, console, show_path=False, show_time=False)
    logger = logging.getLogger("lgmpc")

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        logger.warning("%s", message)

    logger.addHandler(handler)
    before, warnings.showwarning = warnings.showwarning, show
    try:
        yield
    finally:
        warnings.showwarning = before
        logger.removeHandler(handler)


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        words: name of the quantity.
        unit: of the values; empty if they have none.
        value: ``None`` or NaN if it was not measured.
        limit: of the value, if any.
        highest: whether the limit is the highest value allowed, not the lowest.
    """

    words: str
    unit: str
    value: float | None
    limit: float | None = None
    highest: bool = True

    @classmethod
    def of(cls, figure: str, value: float | None, limit: float | None = None, *, highest: bool = True) -> Row:
        """Return the row of a figure, whose name determines words and unit: ``slip_m`` is "slip", in mm."""
        words, unit, scale = figure_words(figure, value, limit)
        shown = None if value is None else scale * value
        return cls(words, unit, shown, None if limit is None else scale * limit, highest)

    @property
    def kept(self) -> bool:
        """Whether the value is within its limit."""
        if self.value is None or self.limit is None:
            return False
        return self.value <= self.limit if self.highest else self.value >= self.limit

    def cells(self) -> tuple[str, str, str, Text]:
        """Return the cells: name, measured, allowed, verdict."""
        name = f"{self.words} / {self.unit}" if self.unit else self.words
        shown = "-" if self.value is None else figure_number(self.value, self.unit, self.limit)
        if self.limit is None:
            return name, shown, "", Text()
        mark = Text("ok", "green") if self.kept else Text("broken", "bold red")
        return name, shown, f"{'<=' if self.highest else '>='} {self.limit:g}", mark


def figure_table(rows: Iterable[Row]) -> Table:
    """Return the table."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for heading in ("figure", "measured", "allowed", ""):
        table.add_column(heading, justify="right" if heading in ("measured", "allowed") else "left")
    for row in rows:
        table.add_row(*row.cells())
    return table
