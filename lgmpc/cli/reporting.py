"""``lgmpc report``: a run or a sweep as one page."""

from __future__ import annotations

from pathlib import Path

from lgmpc.cli.runs import find_run
from lgmpc.cli.screen import out
from lgmpc.config.showing import report
from lgmpc.sweeps.comparison import is_sweep
from lgmpc.sweeps.report import write_sweep_report

__all__ = ["report_shown"]


def report_shown(text: str, runs: Path, html: Path | None) -> None:
    """Write the report of what ``text`` names: a sweep's folder, a run folder, a run's name or ``latest``."""
    folder = Path(text)
    file = write_sweep_report(folder, html) if is_sweep(folder) else report(find_run(text, runs), html)
    out().print(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser", markup=False)
