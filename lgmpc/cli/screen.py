"""Output of the command line. Results go to stdout; progress, notes and errors to stderr."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from lgmpc.errors import ConfigError, LgmpcError, ModelError, legible, shortened

if TYPE_CHECKING:
    from lgmpc.runs import RunResult, SolveResult, Verdict

__all__ = [
    "err",
    "out",
    "plain_table",
    "print_result",
    "show_crash",
    "show_error",
    "show_interrupted",
    "show_next",
    "show_page",
    "show_verdict",
    "silence",
]

MOST_PROBLEMS = 10
"""Largest number of printed problems of one config."""

MOST_LINES = 20
"""Largest number of lines of 80 characters of all printed problems of one config."""

ISSUES_URL = "the project's issue tracker"


def silence(stream: TextIO) -> None:
    """Discard further output to ``stream``, including that at the exit of Python."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _Console(Console):
    """A console that prints control characters of texts, such as names in a config, as escapes."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Yield the segments of ``renderable``."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else legible(text), style, control)


class _ResultsConsole(_Console):
    """A console whose reader, such as ``head``, may close the pipe: the command and its exit code stay the same."""

    def on_broken_pipe(self) -> None:
        """Discard what follows; rich would exit with code 1, a broken gate's."""
        self.quiet = True
        silence(sys.stdout)


def out() -> Console:
    """Return the console for results (a new one, which writes to the current stdout)."""
    return _ResultsConsole(highlight=False, soft_wrap=True)


def err() -> Console:
    """Return the console for progress, notes and errors."""
    return _Console(stderr=True, highlight=False, soft_wrap=True)


def plain_table(*headings: str) -> Table:
    """Return an empty table without lines, whose columns wrap their text."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def show_error(error: LgmpcError) -> None:
    """Print an error of the user's input."""
    console = err()
    head, problems = _parts(error)
    console.print(Text.assemble(("error: ", "bold red"), head))
    length = 80 * (MOST_LINES // max(1, min(len(problems), MOST_PROBLEMS))) - 4
    for problem in problems[:MOST_PROBLEMS]:
        console.print(Text(f"  - {shortened(problem, length)}"))
    if len(problems) > MOST_PROBLEMS:
        console.print(f"  ... and {len(problems) - MOST_PROBLEMS} more")


def _parts(error: LgmpcError) -> tuple[str, list[str]]:
    """Return a headline and, if there are several problems, all of them."""
    if isinstance(error, ModelError):
        return f"robot '{shortened(error.robot)}' cannot be used", list(error.problems)
    if isinstance(error, ConfigError) and len(error.problems) > 1:
        return f"{len(error.problems)} problems in the config", [str(problem) for problem in error.problems]
    return str(error), []


def show_interrupted() -> None:
    """Print that the command was stopped and nothing was saved."""
    err().print("\nstopped; nothing was saved")


def show_crash(error: Exception, report: Path | None) -> None:
    """Print an error of lgmpc itself, and the file with its details."""
    console = err()
    summary = " ".join(str(error).split())
    console.print(Text.assemble(("internal error: ", "bold red"), f"{type(error).__name__}: {summary[:300]}"))
    if report is not None:
        console.print(Text(f"This is an error in lgmpc, not in your input. The details are in {report}"))
        console.print(f"Please send that file to {ISSUES_URL}; `lgmpc doctor` checks the installation.")


def show_verdict(console: Console, verdict: Verdict, name: str) -> None:
    """Print a verdict with its reasons."""
    style = {"pass": "bold green", "fail": "bold red", "interrupted": "bold yellow"}[verdict.outcome.value]
    console.print(Text.assemble((verdict.outcome.value.upper(), style), f"  {name}"))
    for reason in verdict.reasons:
        console.print(Text(f"  - {reason}"))


def show_page(file: Path) -> None:
    """Print that a page was written."""
    out().print(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser", markup=False)


def print_result(path: Path, result: RunResult | SolveResult) -> None:
    """Print the content of ``run.json``, and its folder, as JSON."""
    print(json.dumps({"folder": str(path), **json.loads(result.to_json())}, indent=2))


def show_next(console: Console, path: Path, *others: tuple[str, str]) -> None:
    """Print a run's folder and the commands that display it: play, plot, and others with their purposes."""
    console.print(Text(f"saved in {path}"))
    argument = shlex.quote(str(path))
    commands = (("play", "replay in the browser"), ("plot", "figures"), *others)
    for lead, (command, purpose) in zip(("next:", "", ""), commands, strict=False):
        console.print(Text(f"{lead:5} lgmpc {command} {argument}    ({purpose})"), style="dim")
