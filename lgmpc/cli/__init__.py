"""The command line. Everything heavy is imported by the command that needs it, so that help appears at once."""

from __future__ import annotations

import sys

from lgmpc.cli.app import app
from lgmpc.cli.failures import EXIT_INTERRUPTED

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
