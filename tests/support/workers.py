"""Tasks of worker processes. A process that imports this module imports nothing else of the tests or of lgmpc."""

import os
import signal
import time


def nothing() -> None:
    """Prepare a process for nothing."""


def act(task: str) -> str:
    """Raise, hang, die, or return the task and the process that it was done in."""
    if task == "raise":
        raise ValueError("no such luck")
    if task == "hang":
        time.sleep(600.0)
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    return f"{task} in {os.getpid()}"
