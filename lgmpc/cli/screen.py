"""Output of the command line. Results go to stdout; progress, notes and errors to stderr."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from lgmpc.errors import ConfigError, LgmpcError, ModelError, RunFolderError

if TYPE_CHECKING:
    from lgmpc.runs import RunResult, SolveResult, Verdict

__all__ = [
    "err",
    "out",
    "print_result",
    "show_crash",
    "show_error",
    "show_interrupted",
    "show_next",
    "show_verdict",
]

MOST_PROBLEMS = 10
"""How many problems of one config are shown: a screen's worth."""

MOST_LINES = 20
"""How many lines of 80 characters all problems of one config may take together: a screen's worth too."""

ISSUES_URL = "the project's issue tracker"


def out() -> Console:
    """Return the console for results (made anew, so that tests and pipes see the current stdout)."""
    return Console(highlight=False, soft_wrap=True)


def err() -> Console:
    """Return the console for progress, notes and errors."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def show_error(error: LgmpcError) -> None:
    """Print what the user did wrong and, where it helps, what to do next."""
    console = err()
    head, problems = _parts(error)
    console.print(Text.assemble(("error: ", "bold red"), head))
    length = 80 * (MOST_LINES // max(1, min(len(problems), MOST_PROBLEMS))) - 4
    for problem in problems[:MOST_PROBLEMS]:
        console.print(Text(f"  - {_shorten(problem, length)}"))
    if len(problems) > MOST_PROBLEMS:
        console.print(f"  ... and {len(problems) - MOST_PROBLEMS} more")
    if isinstance(error, RunFolderError) and "does not exist" in str(error):
        console.print("hint: `latest` means the newest run in runs/", style="dim")


def _parts(error: LgmpcError) -> tuple[str, list[str]]:
    """Return a headline and, if there are several problems, all of them."""
    if isinstance(error, ModelError):
        return f"robot '{error.robot}' cannot be used", list(error.problems)
    if isinstance(error, ConfigError) and len(error.problems) > 1:
        return f"{len(error.problems)} problems in the config", [str(problem) for problem in error.problems]
    return str(error), []


def _shorten(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 4] + " ..."


def show_interrupted() -> None:
    """Print that nothing was saved."""
    err().print("\nstopped; nothing was saved")


def show_crash(error: Exception, report: Path | None) -> None:
    """Print an error of lgmpc itself, and where its details are."""
    console = err()
    summary = " ".join(str(error).split())
    console.print(Text.assemble(("internal error: ", "bold red"), f"{type(error).__name__}: {summary[:300]}"))
    if report is not None:
        console.print(Text(f"This is a mistake in lgmpc, not yours. The details are in {report}"))
        console.print(f"Please send that file to {ISSUES_URL}; `lgmpc doctor` shows whether the installation is sound.")


def show_verdict(console: Console, verdict: Verdict, name: str) -> None:
    """Print whether a run passed, and if not, why."""
    style = {"pass": "bold green", "fail": "bold red", "interrupted": "bold yellow"}[verdict.outcome.value]
    console.print(Text.assemble((verdict.outcome.value.upper(), style), f"  {name}"))
    for reason in verdict.reasons:
        console.print(Text(f"  - {reason}"))


def print_result(path: Path, result: RunResult | SolveResult) -> None:
    """Print what ``run.json`` holds, and the folder that it is in, as JSON."""
    print(json.dumps({"folder": str(path), **json.loads(result.to_json())}, indent=2))


def show_next(console: Console, path: Path) -> None:
    """Print where a run is, and the commands that show it."""
    console.print(Text(f"saved in {path}"))
    argument = shlex.quote(str(path))
    console.print(Text(f"next: lgmpc play {argument}    (replay in the browser)"), style="dim")
    console.print(Text(f"      lgmpc plot {argument}    (figures)"), style="dim")
