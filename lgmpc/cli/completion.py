"""What the shell completes: names of shipped configs, runs and demonstrations.

Where none begins with what was typed, the shell completes file names, so these functions return no paths.
"""

from __future__ import annotations

from pathlib import Path

import typer

__all__ = ["complete_config", "complete_demo", "complete_run", "complete_sweep"]


def complete_config(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the shipped configs whose names begin with ``incomplete``."""
    from lgmpc.shipped import shipped_configs

    configs = shipped_configs().values()
    return [(config.name, config.summary) for config in configs if config.name.startswith(incomplete)]


def complete_sweep(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the shipped sweeps whose names begin with ``incomplete``."""
    from lgmpc.shipped import shipped_sweeps

    sweeps = shipped_sweeps().values()
    return [(sweep.name, sweep.summary) for sweep in sweeps if sweep.name.startswith(incomplete)]


def complete_run(context: typer.Context, incomplete: str) -> list[str]:
    """Return ``latest`` and the names of finished runs that begin with ``incomplete``, newest first."""
    from lgmpc.cli.runs import run_names

    names = ["latest", *reversed(run_names(Path(context.params.get("runs") or "runs")))]
    return [name for name in names if name.startswith(incomplete)]


def complete_demo(incomplete: str) -> list[tuple[str, str]]:
    """Return name and summary of the demonstrations whose names begin with ``incomplete``."""
    from lgmpc.demos.catalogue import SUMMARIES

    return [(name, summary) for name, summary in SUMMARIES.items() if name.startswith(incomplete)]
