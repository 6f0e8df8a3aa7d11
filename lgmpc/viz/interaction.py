"""Annotations of a drawn figure for the script of a page: boxes and ranges of the axes, curves, movable parts.

The figure is complete without the script; annotated parts have names that become CSS classes in its SVG.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
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
    names: dict[str, int] = {}
    found = []
    for number, axes in enumerate(figure.axes):
        axes.set_gid(f"{_MARK}axes a{number}")
        curves = dict(_curves(axes, names))
        for artist in axes.get_children():
            moves = _moves(artist, axes)
            if moves:
                name = f"{_MARK}part {' '.join(moves)}"
                artist.set_gid(
                    f"{name} c{curves[artist]}" if artist in curves else name + _anchor(artist, axes, height)
                )
        legend = axes.get_legend()
        if legend is not None:
            for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
                if text.get_text() in names:
                    for part in (handle, text):
                        if part is not None:
                            part.set_gid(f"{_MARK}key c{names[text.get_text()]}")
        if axes.has_data():
            found.append(_described(axes, number, height, {k: _words(names, k) for k in sorted(set(curves.values()))}))
    return json.dumps(found, separators=(",", ":"))


def classes_from_names(svg: str) -> str:
    """Return the SVG with the names of :func:`mark_figure` and of ticks as classes, and without other ids of groups."""
    svg = re.sub(rf'<g id="{_MARK}([^"]*)"', r'<g class="\1"', svg)
    svg = re.sub(r'<g id="([xy]tick)_\d+"', r'<g class="\1"', svg)
    return re.sub(r'<g id="[^"]*"', "<g", svg)


def _curves(axes: Axes, names: dict[str, int]) -> Iterator[tuple[Artist, int]]:
    """Yield the lines through data with the numbers of their names; lines of one name share the number."""
    for line in axes.get_lines():
        if _moves(line, axes) == "xy" and len(np.asarray(line.get_xdata())) > 2:
            name = str(line.get_label())
            name = f"\0{axes.get_title(loc='left')}" if name.startswith("_") else name
            yield line, names.setdefault(name, len(names))


def _words(names: dict[str, int], number: int) -> str:
    """Return the name of a curve; empty for one that has none."""
    name = next(name for name, each in names.items() if each == number)
    return "" if name.startswith("\0") else name


def _moves(artist: Artist, axes: Axes) -> str:
    """Return the directions in which data place an artist: "", "x", "y" or "xy"; "" for parts of the axes."""
    from matplotlib.collections import Collection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.spines import Spine
    from matplotlib.text import Annotation

    if artist is axes.patch or isinstance(artist, Spine):
        return ""
    if isinstance(artist, Annotation):
        coordinates = artist.xycoords if isinstance(artist.xycoords, tuple) else (artist.xycoords,) * 2
        return "".join(axis for axis, each in zip("xy", coordinates, strict=True) if each == "data")
    if not isinstance(artist, (Line2D, Patch, Collection)):
        return ""
    both = artist.get_transform().contains_branch_seperately(axes.transData)
    return "".join(axis for axis, each in zip("xy", both, strict=True) if each)


def _anchor(artist: Artist, axes: Axes, height: float) -> str:
    from matplotlib.text import Annotation

    if not isinstance(artist, Annotation):
        return ""
    coordinates = artist.xycoords if isinstance(artist.xycoords, tuple) else (artist.xycoords,) * 2
    # Only the coordinates in which the artist moves are read.
    point = [float(value) if each == "data" else 0.0 for value, each in zip(artist.xy, coordinates, strict=True)]
    x, y = axes.transData.transform(point)
    return f" @{x:.1f},{height - y:.1f}"


def _described(axes: Axes, number: int, height: float, names: dict[int, str]) -> dict[str, Any]:
    box = axes.get_window_extent()
    kind = _kind(axes)
    zoom = "".join(
        axis
        for axis, each in (("x", axes.xaxis), ("y", axes.yaxis))
        if kind in ("time", "plane") and each.get_scale() == "linear" and (len(each.get_ticklocs()) or axis == "x")
    )
    described = {
        "axes": number,
        "kind": kind,
        "box": [round(value, 2) for value in (box.x0, height - box.y1, box.x1, height - box.y0)],
        "x": [float(value) for value in axes.get_xlim()],
        "y": [float(value) for value in axes.get_ylim()],
        "zoom": zoom,
        "unit": axes.get_ylabel(),
        "names": names,
    }
    if kind == "levels":
        texts = (each.get_text() for each in axes.get_xticklabels())
        described["levels"] = dict(zip((f"{at:g}" for at in axes.get_xticks()), texts, strict=True))
    return described


def _kind(axes: Axes) -> str:
    from matplotlib.ticker import FixedLocator

    if axes.name == "polar":
        return "polar"
    if any(each.get_xlabel() == _TIME for each in axes.get_shared_x_axes().get_siblings(axes)):
        return "time"
    return "levels" if isinstance(axes.xaxis.get_major_locator(), FixedLocator) else "plane"
