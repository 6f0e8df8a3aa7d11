"""Progress of commands that take a while, on stderr."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO, TypeVar

from rich.console import Console
from rich.logging import RichHandler

__all__ = ["Display", "Silent", "warnings_on"]

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
