"""The command line. Everything heavy is imported by the command that needs it, so that help appears at once."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code."""
    # Every matrix here is small: a BLAS that wakes all cores for each of them is slower and jitters.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    try:
        from lgmpc.cli.app import app  # in here, so that Ctrl-C while it loads ends quietly too

        app()
    except KeyboardInterrupt:
        sys.exit(130)
