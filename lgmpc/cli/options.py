"""Arguments and options that several commands have, what the shell completes for them, and the texts of the help.

Where no name begins with what was typed, the shell completes file names, so these functions return no paths.
"""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import typer

_FOLDER = files("lgmpc.cli")
OVERVIEW = _FOLDER.joinpath("overview.txt").read_text("utf-8")
"""The first text of the help, of which a paragraph is one line: the terminal breaks it."""


def examples(command: str) -> str:
    """Return the text after the options of a command: one paragraph for each line, so that none are joined."""
    texts = _FOLDER.joinpath("examples.txt").read_text("utf-8").split("\n\n")  # one for each command, its name first
    paragraphs = {name: lines for name, *lines in map(str.splitlines, texts)}
    return "\n\n".join(["[bold]Examples[/bold]", *(f"  {line}" for line in paragraphs[command])])


def option(help: str, *names: str, metavar: str | None = None, complete: Callable[..., Any] | None = None) -> Any:
    """Return an option whose help displays no default."""
    return typer.Option(*names, metavar=metavar, help=help, show_default=False, autocompletion=complete)


def argument(help: str, *, metavar: str | None = None, complete: Callable[..., Any] | None = None) -> Any:
    """Return an argument whose help displays no default."""
    return typer.Argument(metavar=metavar, help=help, show_default=False, autocompletion=complete)


def complete_config(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the shipped configs whose names begin with ``incomplete``."""
    from lgmpc.shipped import shipped_configs

    return [(name, each.summary) for name, each in shipped_configs().items() if name.startswith(incomplete)]


def complete_sweep(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the shipped sweeps whose names begin with ``incomplete``."""
    from lgmpc.shipped import shipped_sweeps

    return [(name, each.summary) for name, each in shipped_sweeps().items() if name.startswith(incomplete)]


def complete_run(context: typer.Context, incomplete: str) -> list[str]:
    """Return ``latest`` and the names of finished runs that begin with ``incomplete``, newest first."""
    folder = Path(context.params.get("runs") or "runs")
    names = ["latest", *sorted((file.parent.name for file in folder.glob("*/run.json")), reverse=True)]
    return [name for name in names if name.startswith(incomplete)]


def complete_demo(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the demonstrations whose names begin with ``incomplete``."""
    from lgmpc.demos import SUMMARIES

    return [(name, summary) for name, summary in SUMMARIES.items() if name.startswith(incomplete)]


ConfigFile = Annotated[
    Path,
    argument(
        "A YAML file, or the name of a shipped config (`lgmpc configs` lists them).",
        metavar="CONFIG",
        complete=complete_config,
    ),
]
Overrides = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value, such as mpc.rate_hz=50. Values are YAML; list items are numbered from 0. More changes "
        "may follow, or the option again.",
        show_default=False,
    ),
]
MoreOverrides = Annotated[
    list[str], typer.Argument(metavar="KEY=VALUE", help="More changes.", hidden=True, show_default=False)
]
OutFolder = Annotated[Path, typer.Option("--out", help="Folder in which the run folder is created.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show only the verdict, and no progress.")]
RunName = Annotated[str, argument("A run folder, or `latest`.", metavar="RUN", complete=complete_run)]
RunsFolder = Annotated[Path, typer.Option("--runs", help="Folder of run folders, for `latest` and names.")]
