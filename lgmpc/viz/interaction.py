"""Annotations of a drawn figure for the script of a page: boxes and ranges of the axes, curves, movable parts.

The figure is complete without the script; annotated parts have names that become CSS classes in its SVG.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["classes_from_names", "mark_figure"]

_MARK = "lgmpc "
_TIME = "time, s"


def mark_figure(figure: Figure) -> str:
    """Name the parts of a figure, and describe its axes.

    Args:
        figure: complete, at 72 dots per inch: its pixels are the units of the SVG.

    Returns:
        JSON, a list of one object for each axes that has data: ``box`` (left, top, right, bottom), ranges ``x`` and
        ``y``, ``kind`` (``time``, ``plane``, ``levels`` or ``polar``), ``zoom`` (which ranges can be changed),
        ``unit``, ``levels``, and ``names`` of the curves by their number.

        Names of the parts: ``axes <number>``; ``part`` with ``x`` and ``y`` where they move with the data,
        ``c<number>`` of a curve and ``@<x>,<y>``, the anchor of a text; ``key c<number>`` of an entry of the legend.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine(None)  # saving would repeat the layout, with slightly different results
    height = figure.bbox.height
    numbers: dict[str, int] = {}  # of curves by name; unnamed ones have their axes' title, behind a zero
    found = []
    for number, axes in enumerate(figure.axes):
        axes.set_gid(f"{_MARK}axes a{number}")
        curves: dict[Artist, str] = {}
        for artist in axes.get_children():
            moves, anchor = _moves(artist, axes)
            if not moves:
                continue
            if artist in axes.lines and moves == "xy" and len(np.asarray(artist.get_xdata())) > 2:  # type: ignore[attr-defined]
                name = str(artist.get_label())
                curves[artist] = f"\0{axes.get_title(loc='left')}" if name.startswith("_") else name
                anchor = f" c{numbers.setdefault(curves[artist], len(numbers))}"
            elif anchor is not None:
                x, y = axes.transData.transform(anchor)
                anchor = f" @{x:.1f},{height - y:.1f}"
            artist.set_gid(f"{_MARK}part {' '.join(moves)}{anchor or ''}")
        legend = axes.get_legend()
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True) if legend else ():
            for part in (handle, text) if text.get_text() in numbers else ():
                if part is not None:
                    part.set_gid(f"{_MARK}key c{numbers[text.get_text()]}")
        if axes.has_data():
            names = {numbers[name]: "" if name.startswith("\0") else name for name in curves.values()}
            found.append({"axes": number} | _described(axes, height, dict(sorted(names.items()))))
    return json.dumps(found, separators=(",", ":"))


def classes_from_names(svg: str) -> str:
    """Return the SVG with the names of :func:`mark_figure` and of ticks as classes, and without other ids of groups."""
    svg = re.sub(rf'<g id="{_MARK}([^"]*)"', r'<g class="\1"', svg)
    svg = re.sub(r'<g id="([xy]tick)_\d+"', r'<g class="\1"', svg)
    return re.sub(r'<g id="[^"]*"', "<g", svg)


def _moves(artist: Artist, axes: Axes) -> tuple[str, Any]:
    """Return the directions in which data place an artist, "" for parts of the axes, and the anchor of a text."""
    from matplotlib.collections import Collection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.spines import Spine
    from matplotlib.text import Annotation

    anchor = None
    if isinstance(artist, Annotation):
        coordinates = artist.xycoords if isinstance(artist.xycoords, tuple) else (artist.xycoords,) * 2
        both: Sequence[bool] = [each == "data" for each in coordinates]
        anchor = [float(value) if each else 0.0 for value, each in zip(artist.xy, both, strict=True)]
    elif artist is axes.patch or isinstance(artist, Spine) or not isinstance(artist, (Line2D, Patch, Collection)):
        return "", None
    else:
        both = artist.get_transform().contains_branch_seperately(axes.transData)
    return "".join(axis for axis, each in zip("xy", both, strict=True) if each), anchor


def _described(axes: Axes, height: float, names: Mapping[int, str]) -> dict[str, Any]:
    from matplotlib.ticker import FixedLocator

    box, kind = axes.get_window_extent(), "plane"
    described: dict[str, Any] = {}
    if axes.name == "polar":
        kind = "polar"
    elif any(each.get_xlabel() == _TIME for each in axes.get_shared_x_axes().get_siblings(axes)):
        kind = "time"
    elif isinstance(axes.xaxis.get_major_locator(), FixedLocator):
        kind = "levels"
        texts = (each.get_text() for each in axes.get_xticklabels())
        described["levels"] = dict(zip((f"{at:g}" for at in axes.get_xticks()), texts, strict=True))
    zoomed = (("x", axes.xaxis), ("y", axes.yaxis)) if kind in ("time", "plane") else ()
    linear = (
        axis for axis, each in zoomed if each.get_scale() == "linear" and (axis == "x" or len(each.get_ticklocs()))
    )
    return described | {
        "kind": kind,
        "box": [round(value, 2) for value in (box.x0, height - box.y1, box.x1, height - box.y0)],
        "x": [float(value) for value in axes.get_xlim()],
        "y": [float(value) for value in axes.get_ylim()],
        "zoom": "".join(linear),
        "unit": axes.get_ylabel(),
        "names": names,
    }
