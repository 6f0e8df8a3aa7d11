"""Ctrl-C that stops a run where it can be stopped, and not in the middle of something."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

__all__ = ["stop_between"]

T = TypeVar("T")


@contextmanager
def stop_between(progress: Callable[[T], None]) -> Iterator[Callable[[T], None]]:
    """Turn the first Ctrl-C into a KeyboardInterrupt out of the next progress report; the second one acts at once."""
    pressed = False

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def report(now: T) -> None:
        progress(now)
        if pressed:
            raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGINT, on_interrupt)
    except ValueError:  # not in the main thread: Ctrl-C does not arrive here
        yield progress
        return
    try:
        yield report
    finally:
        signal.signal(signal.SIGINT, before)
