"""Tasks of worker processes. A process that imports this module imports nothing else of the tests or of lgmpc."""

import os
import signal
import time


def nothing() -> None:
    """Prepare a process for nothing."""


class Demanding(Exception):
    def __init__(self, first: str, second: str) -> None:
        super().__init__(first + second)


def act(task: str) -> str:
    """Raise, hang, die, return something that cannot be pickled, or the task and the process that it was done in."""
    if task == "raise":
        raise ValueError("no such luck")
    if task == "hang":
        time.sleep(600.0)
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "terminate":
        os.kill(os.getpid(), signal.SIGTERM)
    if task == "unpicklable":
        return lambda: None  # type: ignore[return-value]
    if task == "error that does not unpickle":
        raise Demanding("first", "second")
    return f"{task} in {os.getpid()}"
