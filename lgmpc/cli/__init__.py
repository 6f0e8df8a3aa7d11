"""The command line. Everything heavy is imported by the command that needs it, so that help appears at once."""

from __future__ import annotations

import codecs
import io
import os
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code."""
    # Every matrix here is small: a BLAS that starts threads for each of them is slower and jitters.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    codecs.register_error("lgmpc.path", _bytes_or_escape)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="lgmpc.path")
    try:
        from lgmpc.cli.app import app  # in here, so that Ctrl-C while it loads ends quietly too

        app(prog_name="lgmpc")
    except KeyboardInterrupt:
        sys.exit(130)


def _bytes_or_escape(error: UnicodeError) -> tuple[str | bytes, int]:
    """Print a path in the bytes it has on disk, whatever the locale's encoding, and other text with escapes."""
    try:
        return codecs.lookup_error("surrogateescape")(error)
    except UnicodeError:
        return codecs.backslashreplace_errors(error)
