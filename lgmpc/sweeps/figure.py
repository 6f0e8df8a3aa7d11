"""The figure of a sweep: a polar map of boundaries, or the shares that pass at the levels of its factors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.rows import Row
from lgmpc.sweeps.settings import Directions
from lgmpc.sweeps.summary import Summary
from lgmpc.viz.figure_files import Drawing, draw_figures
from lgmpc.viz.sweep_plots import PassShare, boundary_drawing, share_drawing

__all__ = ["draw_sweep", "sweep_drawing"]


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
