"""Error messages and exit codes for exceptions."""

from __future__ import annotations

import errno
import functools
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import ParamSpec

import typer

from lgmpc import __version__
from lgmpc.cli.screen import show_crash, show_error, show_interrupted, silence
from lgmpc.errors import Interrupted, LgmpcError, shortened

__all__ = ["EXIT_CRASH", "EXIT_HANGUP", "EXIT_INTERRUPTED", "guarded"]

EXIT_CRASH = 70
"""Exit code after an error of lgmpc itself (EX_SOFTWARE of sysexits.h)."""
EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C (128 + SIGINT)."""

EXIT_HANGUP = 129
"""Exit code after the terminal closed (128 + SIGHUP)."""

_OF_FILES = frozenset(
    getattr(errno, name)
    for name in ("EACCES", "EDQUOT", "EFBIG", "EISDIR", "ELOOP", "ENAMETOOLONG", "ENOSPC", "ENOTDIR", "EPERM", "EROFS")
)
"""Numbers of errors of files and folders that the user named, not of lgmpc."""

P = ParamSpec("P")


def guarded(command: Callable[P, None]) -> Callable[P, None]:
    """Run ``command`` and convert every exception to a message and an exit code.

    The message of an :class:`LgmpcError` is printed, with its exit code; a signal gives 128 + its number, 130 for
    Ctrl-C; a closed terminal is no error; a file that cannot be used and a full disk are errors of the input. The
    traceback of any other exception is saved to a file, which the message names, and the exit code is 70.
    """

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except LgmpcError as error:
            show_error(error)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as error:
            show_interrupted()
            raise typer.Exit(error.exit_code if isinstance(error, Interrupted) else EXIT_INTERRUPTED) from error
        except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
            silence(sys.stdout)
        except typer.Exit:
            raise
        except Exception as error:
            if _terminal_is_gone():
                silence(sys.stdout)
                silence(sys.stderr)
                raise typer.Exit(EXIT_HANGUP) from error
            if _came_of_ctrl_c(error):
                show_interrupted()
                raise typer.Exit(EXIT_INTERRUPTED) from error
            if isinstance(error, OSError) and error.errno in _OF_FILES:
                file = shortened(str(error.filename or "the output"))
                show_error(LgmpcError(f"{file} cannot be used: {str(error.strerror).lower()}"))
                if error.errno == errno.ENOSPC:
                    silence(sys.stdout)
                raise typer.Exit(LgmpcError.exit_code) from error
            show_crash(error, _save_traceback())
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
    for folder in _log_folders():
        path = folder / f"crash-{stamp}-{os.getpid()}.txt"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError:
            continue
        return path
    return None


def _log_folders() -> tuple[Path, ...]:
    from platformdirs import user_log_path

    return user_log_path("lgmpc", appauthor=False), Path(tempfile.gettempdir())
