"""Output of the command line, error messages and exit codes.

Results go to stdout; progress, notes and errors to stderr.
"""

import errno
import functools
import json
import os
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TextIO

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table as RichTable
from rich.text import Text

from lgmpc import __version__
from lgmpc.errors import Interrupted, LgmpcError, legible, shortened

if TYPE_CHECKING:
    from lgmpc.runs import RunResult, SolveResult, Verdict
    from lgmpc.runs.tables import Table

_STYLES = {"": "", "good": "", "bad": "red", "strong": "bold", "weak": "dim"}
_NUMBER = re.compile(r"([<>]=? )?-?[0-9.]*(e[+-][0-9]+)?( %)?")

ISSUES_URL = "the project's issue tracker"


def _silence(stream: TextIO) -> None:
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
        _silence(sys.stdout)


def out() -> Console:
    """Return the console for results (a new one, which writes to the current stdout)."""
    return _ResultsConsole(highlight=False, soft_wrap=True)


def err() -> Console:
    """Return the console for progress, notes and errors."""
    return _Console(stderr=True, highlight=False, soft_wrap=True)


def show_table(table: "Table") -> None:
    """Print a table without lines: columns of numbers to the right, rows in the style of their marks."""
    shown = RichTable(box=None, padding=(0, 2, 0, 0), header_style="dim", show_header=any(table.headings))
    for heading, *cells in zip(table.headings, *table.rows, strict=True):
        right = any(cells) and all(map(_NUMBER.fullmatch, cells))
        shown.add_column(Text(heading), overflow="fold", justify="right" if right else "left", no_wrap=right)
    for row, mark in zip(table.rows, table.marks or [""] * len(table.rows), strict=True):
        last = Text(row[-1], "green" if mark == "good" else "")
        shown.add_row(*map(Text, row[:-1]), last, style=_STYLES[mark])
    out().print(shown)


def _show_error(error: LgmpcError) -> None:
    """Print an error of the user's input."""
    err().print(Text.assemble(("error: ", "bold red"), str(error)))


def _show_interrupted() -> None:
    """Print that the command was stopped and nothing was saved."""
    err().print("\nstopped; nothing was saved")


def _show_crash(error: Exception, report: Path | None) -> None:
    """Print an error of lgmpc itself, and the file with its details."""
    console = err()
    summary = " ".join(str(error).split())
    console.print(Text.assemble(("internal error: ", "bold red"), f"{type(error).__name__}: {summary[:300]}"))
    if report is not None:
        console.print(Text(f"This is an error in lgmpc, not in your input. The details are in {report}"))
        console.print(f"Please send that file to {ISSUES_URL}; `lgmpc doctor` checks the installation.")


def show_verdict(console: Console, verdict: "Verdict", name: str) -> None:
    """Print a verdict with its reasons."""
    style = {"pass": "bold green", "fail": "bold red", "interrupted": "bold yellow"}[verdict.outcome.value]
    console.print(Text.assemble((verdict.outcome.value.upper(), style), f"  {name}"))
    for reason in verdict.reasons:
        console.print(Text(f"  - {reason}"))


def show_page(file: Path) -> None:
    """Print that a page was written."""
    out().print(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser", markup=False)


def print_result(path: Path, result: "RunResult | SolveResult") -> None:
    """Print the content of ``run.json``, and its folder, as JSON."""
    print(json.dumps({"folder": str(path), **json.loads(result.to_json())}, indent=2))


def show_next(console: Console, path: Path, *others: tuple[str, str]) -> None:
    """Print a run's folder and the commands that display it: play, plot, and others with their purposes."""
    console.print(Text(f"saved in {path}"))
    argument = shlex.quote(str(path))
    commands = (("play", "replay in the browser"), ("plot", "figures"), *others)
    for lead, (command, purpose) in zip(("next:", "", ""), commands, strict=False):
        console.print(Text(f"{lead:5} lgmpc {command} {argument}    ({purpose})"), style="dim")


EXIT_CRASH, EXIT_INTERRUPTED, EXIT_HANGUP = 70, 130, 129
"""Exit codes after an error of lgmpc itself (EX_SOFTWARE of sysexits.h), Ctrl-C, and the end of the terminal."""

_OF_FILES = frozenset(
    getattr(errno, name)
    for name in ("EACCES", "EDQUOT", "EFBIG", "EISDIR", "ELOOP", "ENAMETOOLONG", "ENOSPC", "ENOTDIR", "EPERM", "EROFS")
)
"""Numbers of errors of files and folders that the user named, not of lgmpc."""

P = ParamSpec("P")


def guarded(command: Callable[P, int | None]) -> Callable[P, None]:
    """Run ``command``, exit with the code that it returns, and convert every exception to a message and an exit code.

    The message of an :class:`LgmpcError` is printed, with its exit code; a signal gives 128 + its number, 130 for
    Ctrl-C; a closed terminal is no error; a file that cannot be used and a full disk are errors of the input. The
    traceback of any other exception is saved to a file, which the message names, and the exit code is 70.
    """

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            code = command(*args, **kwargs)
            if code is not None:
                raise typer.Exit(code)
        except LgmpcError as error:
            _show_error(error)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as error:
            _show_interrupted()
            raise typer.Exit(error.exit_code if isinstance(error, Interrupted) else EXIT_INTERRUPTED) from error
        except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
            _silence(sys.stdout)
        except typer.Exit:
            raise
        except Exception as error:
            if _terminal_is_gone():
                _silence(sys.stdout)
                _silence(sys.stderr)
                raise typer.Exit(EXIT_HANGUP) from error
            if _came_of_ctrl_c(error):
                _show_interrupted()
                raise typer.Exit(EXIT_INTERRUPTED) from error
            if isinstance(error, OSError) and error.errno in _OF_FILES:
                file = shortened(str(error.filename or "the output"))
                _show_error(LgmpcError(f"{file} cannot be used: {str(error.strerror).lower()}"))
                if error.errno == errno.ENOSPC:
                    _silence(sys.stdout)
                raise typer.Exit(LgmpcError.exit_code) from error
            _show_crash(error, _save_traceback())
            raise typer.Exit(EXIT_CRASH) from error

    return run


def _came_of_ctrl_c(error: BaseException | None) -> bool:
    """Return whether a KeyboardInterrupt caused ``error``: Ctrl-C while a C++ module loads raises ImportError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _terminal_is_gone() -> bool:
    """Return whether stderr is a closed terminal, to which Linux rejects even an empty write."""
    try:
        os.write(sys.stderr.fileno(), b"")
    except OSError as error:
        return error.errno == errno.EIO
    return False


def _save_traceback() -> Path | None:
    """Write the traceback of the current exception and return its file; ``None`` if no folder can be written."""
    stamp = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    text = f"lgmpc {__version__}, Python {sys.version}\n{sys.argv}\n\n{traceback.format_exc()}"
    from platformdirs import user_log_path

    for folder in (user_log_path("lgmpc", appauthor=False), Path(tempfile.gettempdir())):
        path = folder / f"crash-{stamp}-{os.getpid()}.txt"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError:
            continue
        return path
    return None
