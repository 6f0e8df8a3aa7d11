"""The figure of an explanation: the events before a failure on a time line, above the quantities that caused them."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from lgmpc.runs.events import EventKind, EventLine, event_lines
from lgmpc.runs.forensics import Explanation
from lgmpc.typing import BoolArray
from lgmpc.viz.figure_files import EXTRA, INK, LIMIT, PUSH, SOFT, X, Y, Z, legend_above
from lgmpc.viz.plots import draw_contact_rows
from lgmpc.viz.series import extremes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_explanation"]

_COLORS = {
    EventKind.CAUSE: PUSH,
    EventKind.LIMIT: Y,
    EventKind.CONTACT: X,
    EventKind.BALANCE: EXTRA,
    EventKind.SOLVER: INK,
    EventKind.TIMING: INK,
    EventKind.ESTIMATE: Z,
    EventKind.MODE: SOFT,
}
_BEFORE_S, _AFTER_S = 0.1, 0.25
_LETTERS = 140
"""Largest length of an event's description, as wide as the figure."""
_HIGHEST_SHARE = 1.5


def draw_explanation(figure: Figure, explanation: Explanation) -> bool:
    """Draw events, share of the limits used, capture point, attitude and contacts over the same time."""
    log = explanation.log
    lines = event_lines(explanation.events)
    begin, end = _window(explanation)
    shown = (log.time >= begin) & (log.time <= end)
    rows = max(len(lines), 2)
    heights = [0.26 * rows, 1.5, 1.1, 1.3, 0.3 * max(len(log.contact_frames), 2)]
    figure.set_size_inches(9.6, sum(heights) + 1.6)
    timeline, used, capture, attitude, contacts = figure.subplots(5, 1, sharex=True, height_ratios=heights)
    _draw_events(timeline, lines, explanation)
    _draw_quantities(used, capture, attitude, explanation, shown)
    draw_contact_rows(contacts, log)
    contacts.set(title="Contact measured (grey), and its state for the controller", xlabel="time, s")
    contacts.set_xlim(begin, end)
    for axes in (timeline, used, capture, attitude, contacts):
        for event in explanation.events:
            if event.name == "push":
                axes.axvspan(event.start_s, event.end_s, color=PUSH, alpha=0.12, lw=0.0, zorder=0)
        if explanation.failed_s is not None:
            axes.axvline(explanation.failed_s, color=LIMIT, lw=1.4, ls="--")
    return True


def _window(explanation: Explanation) -> tuple[float, float]:
    """Return start and end of the part of the run to draw, s: all of it without a time of failure."""
    first, last = float(explanation.log.time[0]), float(explanation.log.time[-1])
    if explanation.failed_s is None:
        return first, last
    begin = min([explanation.failed_s - 0.5, *(each.start_s for each in explanation.events if each.start_s > 0.0)])
    return max(first, begin - _BEFORE_S), min(last, explanation.failed_s + _AFTER_S)


def _draw_events(axes: Axes, lines: Sequence[EventLine], explanation: Explanation) -> None:
    begin, end = _window(explanation)
    for row, line in enumerate(lines):
        spans = [(max(each.start_s, begin), min(each.end_s, end)) for each in line.events]
        bars = [(start, max(stop - start, 0.004 * (end - begin))) for start, stop in spans]
        axes.broken_barh(bars, (row - 0.31, 0.62), color=_COLORS[line.kind], alpha=0.55, lw=0.0)
        words = shorten(f"{line.start_s:.3f}  {line.words}", _LETTERS, placeholder=" ...")
        axes.annotate(words, (0.006, row), xycoords=("axes fraction", "data"), va="center", fontsize=7.6, color=INK)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.set_title("Events" if lines else "No events")
    if explanation.failed_s is not None:
        axes.annotate(
            explanation.failure,
            (explanation.failed_s, 1.0),
            (-3, 3),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=8.5,
            color=LIMIT,
        )


def _draw_quantities(used: Axes, capture: Axes, base: Axes, explanation: Explanation, shown: BoolArray) -> None:
    """Draw the share of limits used, the margin of the capture point, and tilt and height of the base."""
    time, height = explanation.log.time[shown], base.twinx()
    height.spines["right"].set_visible(True)
    height.grid(visible=False)
    shares = {"torque": Y, "joint speed": X, "joint position": EXTRA, "friction": Z}
    values = {"tilt": (base, X), "base height": (height, Z)}
    for quantity in explanation.quantities:
        if quantity.name in shares:
            share = np.where(np.isfinite(quantity.used[shown]), quantity.used[shown], -np.inf).max(axis=1)
            worst = np.where(np.isfinite(share), np.minimum(share, _HIGHEST_SHARE), np.nan)
            used.plot(time, 100.0 * worst, color=shares[quantity.name], lw=1.1, label=quantity.name)
        elif quantity.name == "capture point":
            margin = quantity.margins[shown, 0]
            at = extremes(margin)
            capture.plot(time, margin, color=X)
            capture.fill_between(time[at], np.minimum(margin[at], 0.0), 0.0, color=LIMIT, alpha=0.3, lw=0.0)
        elif quantity.name in values:
            axes, color = values[quantity.name]
            axes.plot(time, quantity.values[shown, 0], color=color, label=quantity.name)
            axes.plot(time, quantity.limits[shown, 0], color=color, lw=0.9, ls="--", label="limit")
    used.axhline(100.0, color=LIMIT, ls="--", lw=1.0)
    used.set(title="Limit used, worst joint or foot", ylabel="%", ylim=(0.0, None))
    capture.axhline(0.0, color=LIMIT, ls="--", lw=1.0)
    capture.set(title="Capture point inside the support", ylabel="mm")
    base.set(title="Base", ylim=(0.0, None))
    base.set_ylabel("tilt, deg", color=X)
    height.set_ylabel("height, mm", color=Z)
    legend_above(used)
