"""The figure of a sweep, and its report: tables, figure and points in one self-contained page."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lgmpc.errors import RunFolderError
from lgmpc.sweeps.design import Sweep, load_sweep
from lgmpc.sweeps.folder import DOCUMENT, ROWS, SUMMARY, read_rows
from lgmpc.sweeps.rows import Row, place
from lgmpc.sweeps.settings import Directions
from lgmpc.sweeps.summary import Summary, summarize
from lgmpc.sweeps.tables import point_table, search_words, summary_tables
from lgmpc.viz.figure_files import Drawing, draw_figures
from lgmpc.viz.page import write_page
from lgmpc.viz.report import code, figures, folded, report_page, section, table, words
from lgmpc.viz.sweep_plots import PassShare, boundary_drawing, share_drawing

__all__ = ["draw_sweep", "load_results", "sweep_drawing", "write_sweep_report"]


def load_results(folder: Path) -> tuple[Sweep, dict[str, Row]]:
    """Return the sweep of a folder and its finished points by their present keys.

    Keys depend on the versions of packages; results of other versions are matched by their place in the sweep.

    Raises:
        RunFolderError: if the folder has no finished point of the sweep.
        ConfigError: if its document or a base config cannot be read.
    """
    sweep = load_sweep(folder / DOCUMENT)
    by_place = {place(row): row for row in read_rows(folder / ROWS).values()}
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


def draw_sweep(sweep: Sweep, rows: Mapping[str, Row], summary: Summary, folder: Path) -> Path | None:
    """Write the figure of a sweep as a PNG file.

    Args:
        sweep: its document and points.
        rows: the finished points by their keys.
        summary: summary of the points.
        folder: folder of the file.

    Returns:
        The file; ``None`` if there is nothing to draw: no boundary in any direction, no factor of several levels.
    """
    drawing = sweep_drawing(sweep, rows, summary)
    if drawing is None:
        return None
    title = f"{summary.name} · {summary.finished} of {summary.total} points"
    (file,) = draw_figures(dict([drawing]), title).save(folder)
    return file


def sweep_drawing(sweep: Sweep, rows: Mapping[str, Row], summary: Summary) -> tuple[str, Drawing] | None:
    """Return name and drawing of a sweep's figure; ``None`` if there is nothing to draw; see :func:`draw_sweep`."""
    settings = sweep.settings
    around = next((factor for factor in settings.factors if isinstance(factor, Directions)), None)
    if settings.bisect is not None and around is not None:
        curves: dict[str, list[tuple[float, float]]] = {}
        for point in sweep.points:
            row = rows.get(point.key)
            if row is None or row.boundary is None:
                continue
            others = {key: value for key, value in point.levels.items() if key != around.key[0]}
            names = [point.base] if len(settings.base) > 1 else []
            names += [point.variant] if point.variant else []
            names += [f"{key} {value}" for key, value in others.items() if len(_levels(sweep, key)) > 1]
            x, y, _ = point.levels[around.key[0]]
            curves.setdefault(", ".join(names), []).append((math.atan2(y, x), row.boundary))
        return ("boundaries", boundary_drawing(curves, f"largest {settings.bisect.key}")) if curves else None
    factors: dict[str, dict[str, list[PassShare]]] = {}
    for level in summary.levels:
        shares = factors.setdefault(level.key, {}).setdefault(", ".join(level.labels.values()), [])
        shares.append(PassShare(level.level, level.passed.value, level.passed.low, level.passed.high))
    return ("shares", share_drawing(factors)) if factors else None


def _levels(sweep: Sweep, key: str) -> set[str]:
    return {repr(point.levels[key]) for point in sweep.points}


def _sections(folder: Path, sweep: Sweep, rows: dict[str, Row], summary: Summary) -> Iterator[str]:
    found = [table(*each) for each in summary_tables(summary, sweep.settings.metrics)]
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
