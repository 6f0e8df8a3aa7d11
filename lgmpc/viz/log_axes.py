"""What the figures of closed-loop runs share: the time axis, and the pushes on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lgmpc.runs import RunLog, push_intervals
from lgmpc.viz.style import PUSH

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["finish", "label_pushes"]

_LABEL_BAND = 0.16
"""Share of an axes' height that the pushes' labels have to themselves."""


def finish(log: RunLog, *all_axes: Axes, span: float = 0.0) -> None:
    """Shade the pushes, fit the time axis, and show at least ``span`` of the vertical one: no magnified rounding."""
    for axes in all_axes:
        for push in push_intervals(log):
            axes.axvspan(push.start, push.end, color=PUSH, alpha=0.15, lw=0.0, zorder=0)
        axes.set_xlim(float(log.time[0]), float(log.time[-1]))
        low, high = axes.get_ylim()
        if high - low < span:
            axes.set_ylim(0.5 * (low + high - span), 0.5 * (low + high + span))


def label_pushes(log: RunLog, *all_axes: Axes) -> None:
    """Write each push's impulse in a band above the curves and limits, unless they are too many to read."""
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
