"""The report of a sweep: tables, figure and points in one self-contained page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lgmpc.errors import RunFolderError
from lgmpc.sweeps.design import Sweep, load_sweep
from lgmpc.sweeps.figure import sweep_drawing
from lgmpc.sweeps.folder import DOCUMENT, ROWS, SUMMARY, Results
from lgmpc.sweeps.rows import Row, place
from lgmpc.sweeps.summary import Summary, summarize
from lgmpc.sweeps.tables import group_table, level_table, pairing_table, point_table, search_words
from lgmpc.viz.page import write_page
from lgmpc.viz.report import code, figures, folded, report_page, section, table, words

__all__ = ["load_results", "write_sweep_report"]


def load_results(folder: Path) -> tuple[Sweep, dict[str, Row]]:
    """Return the sweep of a folder and its finished points by their present keys.

    Keys depend on the versions of packages; results of other versions are matched by their place in the sweep.

    Raises:
        RunFolderError: if the folder has no finished point of the sweep.
        ConfigError: if its document or a base config cannot be read.
    """
    sweep = load_sweep(folder / DOCUMENT)
    by_place = {place(row): row for row in Results(folder / ROWS).rows().values()}
    rows = {point.key: by_place[place(point)] for point in sweep.points if place(point) in by_place}
    if not rows:
        raise RunFolderError(f"{folder} has no finished point: lgmpc sweep {folder / DOCUMENT} --out {folder} --resume")
    return sweep, rows


def write_sweep_report(folder: Path, html: Path | None = None) -> Path:
    """Write the report of a sweep's folder.

    Args:
        folder: the sweep's folder.
        html: the file; ``report.html`` in the folder unless given.

    Returns:
        The file.

    Raises:
        RunFolderError: if the folder has no finished point, or the page cannot be written.
        ConfigError: if its document or a base config cannot be read.
    """
    sweep, rows = load_results(folder)
    summary = summarize(sweep, rows)
    about = f"sweep of {', '.join(sweep.settings.base)} · {summary.count}"
    page = report_page(
        summary.name, summary.verdict, about, summary.complaints, _sections(folder, sweep, rows, summary)
    )
    return write_page(page, html or folder / "report.html")


def _sections(folder: Path, sweep: Sweep, rows: dict[str, Row], summary: Summary) -> Iterator[str]:
    metrics = sweep.settings.metrics
    found = [table(*group_table(summary, metrics))]
    if summary.levels:
        found.append(table(*level_table(summary)))
    if summary.pairings:
        found.append(table(*pairing_table(summary, metrics)))
    told = [search_words(sweep, rows), *(f"{count} x {reason}" for reason, count in summary.broken.items())]
    yield section("Results", *found, words(each for each in told if each))
    drawing = sweep_drawing(sweep, rows, summary)
    if drawing is not None:
        yield section("Figure", figures(dict([drawing])))
    kept = sorted(each.name for each in (folder / "logs").glob("*-*"))
    points = [folded(f"{len(rows)} points", table(*point_table(sweep, rows)))]
    if kept:
        commands = words(f"lgmpc explain {folder / 'logs' / name}" for name in kept)
        points.append(folded(f"{len(kept)} kept in logs/", commands))
    yield section("Points", *points)
    document = (folder / DOCUMENT).read_text(encoding="utf-8").rstrip()
    yield section("Config", folded(f"{DOCUMENT}, defaults included", code(document)))
    versions = _versions(folder)
    if versions:
        rows_of = [(name, str(version)) for name, version in versions.items()]
        yield section("Versions", folded("Packages", table(("", ""), rows_of)))


def _versions(folder: Path) -> dict[str, Any]:
    """Return the versions in the sweep's summary; empty if it was stopped before one was written."""
    try:
        content = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    found = content.get("versions", {}) if isinstance(content, dict) else {}
    return found if isinstance(found, dict) else {}
