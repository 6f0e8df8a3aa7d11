"""The figure of a sweep, and its report: tables, figure and points in one self-contained page."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.errors import RunFolderError
from lgmpc.sweeps.design import Sweep, load_sweep
from lgmpc.sweeps.folder import DOCUMENT, ROWS, read_rows
from lgmpc.sweeps.rows import Row, place
from lgmpc.sweeps.settings import Directions
from lgmpc.sweeps.summary import Group, Summary, point_table, summarize, summary_tables
from lgmpc.viz.figure_files import PALETTE, Drawing, draw_figures
from lgmpc.viz.page import write_page
from lgmpc.viz.report import code, figures, folded, report_page, section, table, words

_COLUMNS = 3
_BESIDE = 0.08
"""Distance between the marks of two variants at one level, in units of that between levels."""


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
            names += [
                f"{key} {value}"
                for key, value in others.items()
                if len({repr(each.levels[key]) for each in sweep.points}) > 1
            ]
            x, y, _ = point.levels[around.key[0]]
            curves.setdefault(", ".join(names), []).append((math.atan2(y, x), row.boundary))
        return ("boundaries", boundary_drawing(curves, f"largest {settings.bisect.key}")) if curves else None
    return ("shares", _share_drawing(summary.levels)) if summary.levels else None


def boundary_drawing(curves: Mapping[str, Sequence[tuple[float, float]]], quantity: str) -> Drawing:
    """Return the drawing of boundaries over their horizontal directions; x points up, as the robot walks.

    Args:
        curves: label -> (angle from the x axis, rad; boundary).
        quantity: quantity of the radius, with its unit.
    """

    def draw(figure: Any) -> bool:
        figure.set_size_inches(6.4, 6.4)
        axes: Any = figure.add_subplot(projection="polar")
        axes.set_theta_zero_location("N")
        for i, (label, curve) in enumerate(curves.items()):
            angles, values = np.array(sorted(curve)).T
            colour = PALETTE[i % len(PALETTE)]
            around = [*range(len(angles)), 0] if len(angles) > 2 else range(len(angles))
            axes.plot(angles[around], values[around], "o-", ms=4, color=colour, label=label)
        axes.set_ylim(bottom=0.0)
        axes.set_xticks(np.radians(range(0, 360, 45)))
        axes.set_xticklabels(["ahead", "", "left", "", "behind", "", "right", ""])
        axes.set_title(quantity, loc="center", pad=24)
        if any(curves):
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2)
        return any(len(curve) > 0 for curve in curves.values())

    return draw


def _share_drawing(levels: Sequence[Group]) -> Drawing:
    """Return the drawing of the shares that pass over the levels of each factor, a curve for each base and variant."""
    factors: dict[str, dict[str, list[Group]]] = {}
    for each in levels:
        key, _, *names = each.labels.values()
        factors.setdefault(key, {}).setdefault(", ".join(names), []).append(each)

    def draw(figure: Any) -> bool:
        rows = -(-len(factors) // _COLUMNS)
        figure.set_size_inches(4.0 * min(_COLUMNS, len(factors)), 3.0 * rows)
        labels = list(dict.fromkeys(label for groups in factors.values() for label in groups))
        for i, (key, groups) in enumerate(factors.items()):
            axes = figure.add_subplot(rows, min(_COLUMNS, len(factors)), i + 1)
            for label, shares in groups.items():
                values = 100.0 * np.array([[each.passed.value, each.passed.low, each.passed.high] for each in shares])
                spread = np.abs(values[:, 1:].T - values[:, 0])
                number = labels.index(label)
                beside = _BESIDE * (number - 0.5 * (len(labels) - 1))  # intervals do not hide each other
                places = np.arange(len(shares)) + beside
                style: dict[str, Any] = {
                    "fmt": "o-",
                    "ms": 4,
                    "elinewidth": 0.8,
                    "capsize": 3,
                    "color": PALETTE[number % len(PALETTE)],
                }
                axes.errorbar(places, values[:, 0], spread, label=label, **style)
            axes.set_xticks(
                range(len(shares)), [each.labels["level"] for each in shares], rotation=25, ha="right", fontsize=8
            )
            axes.set_ylim(-3.0, 103.0)
            axes.set_title(key)
            if i % _COLUMNS == 0:
                axes.set_ylabel("passed / % (95 %)")
        if len(labels) > 1:
            figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return True

    return draw


def _sections(folder: Path, sweep: Sweep, rows: dict[str, Row], summary: Summary) -> Iterator[str]:
    found = [table(*each) for each in summary_tables(summary, sweep.settings.metrics)]
    yield section("Results", *found, words(f"{count} x {reason}" for reason, count in summary.broken.items()))
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
