"""The command line, in this process and as the process that a user starts."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lgmpc.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
STAND = ROOT / "configs" / "solo12_stand.yaml"
BALANCE = ROOT / "configs" / "solo12_balance.yaml"

LAUNCH = """
import fcntl, os, runpy, signal, termios
signal.signal(signal.SIGINT, signal.default_int_handler)  # as at a prompt, whatever the tests were started by
signal.signal(signal.SIGTERM, signal.SIG_DFL)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
if os.isatty(0):
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
runpy.run_module("lgmpc", run_name="__main__", alter_sys=True)
"""
"""``python -m lgmpc`` with the signals and the controlling terminal of a shell's foreground job."""

Invoke = Callable[..., tuple[int, str]]
Start = Callable[..., "subprocess.Popen[str]"]
Result = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def invoke(monkeypatch: pytest.MonkeyPatch) -> Invoke:
    """Run a command in this process; return its exit code and everything it printed."""
    monkeypatch.setenv("COLUMNS", "400")

    def run(*arguments: object) -> tuple[int, str]:
        result = CliRunner().invoke(app, [str(argument) for argument in arguments])
        return result.exit_code, result.output

    return run


@pytest.fixture
def start(tmp_path: Path) -> Start:
    """Start a command as its own process, in an empty folder; at a terminal, if its file descriptor is given."""

    def run(*arguments: object, terminal: int | None = None, **variables: str) -> "subprocess.Popen[str]":
        environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "state"), "OMP_NUM_THREADS": "1", **variables}
        return subprocess.Popen(
            [sys.executable, "-c", LAUNCH, *(str(argument) for argument in arguments)],
            cwd=tmp_path,
            env=environment,
            stdin=subprocess.DEVNULL if terminal is None else terminal,
            stdout=subprocess.PIPE if terminal is None else terminal,
            stderr=subprocess.PIPE if terminal is None else terminal,
            start_new_session=terminal is not None,
            encoding="utf-8",
        )

    return run


@pytest.fixture
def result(start: Start) -> Result:
    """Run a command as its own process to its end."""

    def run(*arguments: object, **variables: str) -> "subprocess.CompletedProcess[str]":
        with start(*arguments, **variables) as process:
            out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    return run
