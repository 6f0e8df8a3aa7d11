"""Common parts of the figures of closed-loop runs: the time axis, and the pushes on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lgmpc.runs import RunLog, push_intervals
from lgmpc.runs.log import MODES
from lgmpc.viz.style import EXTRA, LIMIT, PUSH, SOFT, X, Y, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["finish", "friction_words", "label_modes", "label_pushes"]

_MODE_COLORS = {"lie": SOFT, "rise": Z, "locomote": X, "recover": Y, "sit": EXTRA, "damp": LIMIT}
"""Colours of the modes; standing has none."""

_NARROWEST = 0.035
"""Share of the time axis above which an interval of a mode is labelled."""

_LABEL_BAND = 0.16
"""Fraction of an axes' height reserved for the pushes' labels."""


def finish(log: RunLog, *all_axes: Axes, span: float = 0.0) -> None:
    """Shade the pushes, fit the time axis, and extend the vertical one to ``span`` at least."""
    for axes in all_axes:
        for push in push_intervals(log):
            axes.axvspan(push.start, push.end, color=PUSH, alpha=0.15, lw=0.0, zorder=0)
        axes.set_xlim(float(log.time[0]), float(log.time[-1]))
        low, high = axes.get_ylim()
        if high - low < span:
            axes.set_ylim(0.5 * (low + high - span), 0.5 * (low + high + span))


def label_pushes(log: RunLog, *all_axes: Axes) -> None:
    """Label each push with its impulse in a band above the curves and limits, unless there are too many."""
    pushes = push_intervals(log)
    for axes in all_axes if 0 < len(pushes) <= 8 else ():
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + _LABEL_BAND / (1.0 - _LABEL_BAND) * (high - low))
        for push in pushes:
            text = f"{np.linalg.norm(push.impulse):.2g} N.s"
            where = (0.5 * (push.start + push.end), 0.98)
            axes.annotate(
                text, where, xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8, color=PUSH
            )


def friction_words(log: RunLog) -> str:
    """Return the friction coefficients of the floor in the order of their times: ``0.6``, ``0.6, then 0.3``."""
    floor = log.friction_over_time
    changed = np.flatnonzero(np.diff(floor, prepend=np.nan))
    return ", then ".join(f"{each:g}" for each in (floor[changed] if len(floor) else [log.friction]))


def label_modes(log: RunLog, axes: Axes) -> None:
    """Draw a band of the modes along the lower edge, unless the robot only stood."""
    if log.mode is None or log.ticks < 2 or bool((log.mode == MODES.index("stand")).all()):
        return
    edges = np.concatenate(([0], np.flatnonzero(np.diff(log.mode)) + 1, [log.ticks])).tolist()
    times = np.append(log.time, log.time[-1] + np.median(np.diff(log.time)))
    for a, b in zip(edges, edges[1:], strict=False):
        name = dict(enumerate(MODES)).get(int(log.mode[a]), "")
        if name in _MODE_COLORS:
            axes.axvspan(times[a], times[b], 0.0, 0.09, color=_MODE_COLORS[name], alpha=0.35, lw=0.0, zorder=0)
        if times[b] - times[a] > _NARROWEST * (times[-1] - times[0]):
            where = (0.5 * (times[a] + times[b]), 0.045)
            axes.annotate(name, where, xycoords=("data", "axes fraction"), ha="center", va="center", fontsize=7)
