"""What running and solving show: progress on stderr, and the table of figures with their limits."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, TextIO, TypeVar

from rich.console import Console
from rich.logging import RichHandler
from rich.table import Table
from rich.text import Text

from lgmpc.runs.figures import figure_number, figure_words

__all__ = ["Display", "Row", "Silent", "figure_table", "warnings_on"]

Step = TypeVar("Step", contravariant=True)


class Display(Protocol[Step]):
    """Shows the progress of something."""

    def announce(self, message: str) -> None:
        """Show what is being prepared."""

    def advance(self, now: Step) -> None:
        """Show a step of it."""


class Silent:
    """Shows nothing."""

    def announce(self, message: str) -> None:
        """Do nothing."""

    def advance(self, now: object) -> None:
        """Do nothing."""


@contextmanager
def warnings_on(console: Console) -> Iterator[None]:
    """Show log records from WARNING on, and Python's warnings without the line of code they came from."""
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
        words: what was measured.
        unit: of the numbers; empty if they have none.
        value: ``None`` or NaN if it was not measured.
        limit: that it should keep, if any.
        highest: whether the limit is the highest value allowed, not the lowest.
    """

    words: str
    unit: str
    value: float | None
    limit: float | None = None
    highest: bool = True

    @classmethod
    def of(cls, figure: str, value: float | None, limit: float | None = None, *, highest: bool = True) -> Row:
        """Take words and unit from a figure's name: ``slip_m`` is shown as "slip", in mm."""
        words, unit, scale = figure_words(figure)
        shown = None if value is None else scale * value
        return cls(words, unit, shown, None if limit is None else scale * limit, highest)

    @property
    def kept(self) -> bool:
        """Whether the value is within its limit."""
        if self.value is None or self.limit is None:
            return False
        return self.value <= self.limit if self.highest else self.value >= self.limit

    def cells(self) -> tuple[str, str, str, Text]:
        """Return what the table shows: name, measured, allowed, verdict."""
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
