"""The command line. Each command imports what it requires, so that help is printed at once."""

import codecs
import io
import os
import sys


def main() -> None:
    """Run the command line and exit with its code."""
    # All matrices are small: a multi-threaded BLAS is slower, with irregular timings.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    codecs.register_error("lgmpc.path", _bytes_or_escape)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="lgmpc.path")
    try:
        from lgmpc.cli.app import app  # here, so that Ctrl-C during the import is handled too

        app(prog_name="lgmpc")
    except KeyboardInterrupt:
        sys.exit(130)


def _bytes_or_escape(error: UnicodeError) -> tuple[str | bytes, int]:
    """Encode a path by its bytes on disk for any locale, and other text with escapes."""
    try:
        return codecs.lookup_error("surrogateescape")(error)
    except UnicodeError:
        return codecs.backslashreplace_errors(error)
