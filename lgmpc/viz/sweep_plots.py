"""Figures of many runs: boundaries around the circle, shares that pass at the levels of factors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lgmpc.viz.figure_files import PALETTE, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PassShare", "boundary_drawing", "share_drawing"]

_COLUMNS = 3
_BESIDE = 0.08
"""Distance between the marks of two variants at one level, in units of that between levels."""


@dataclass(frozen=True)
class PassShare:
    """A share with its confidence interval, 0 to 1, at one level of a factor; NaN where nothing was computed."""

    level: str
    value: float
    low: float
    high: float


def boundary_drawing(curves: Mapping[str, Sequence[tuple[float, float]]], quantity: str) -> Drawing:
    """Return the drawing of boundaries over their horizontal directions; x points up, as the robot walks.

    Args:
        curves: label -> (angle from the x axis, rad; boundary).
        quantity: quantity of the radius, with its unit.
    """

    def draw(figure: Figure) -> bool:
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


def share_drawing(factors: Mapping[str, Mapping[str, Sequence[PassShare]]]) -> Drawing:
    """Return the drawing of the shares that pass over the levels of each factor.

    Args:
        factors: key -> label of base and variant -> shares at its levels, in order.
    """

    def draw(figure: Figure) -> bool:
        rows = -(-len(factors) // _COLUMNS)
        figure.set_size_inches(4.0 * min(_COLUMNS, len(factors)), 3.0 * rows)
        labels = list(dict.fromkeys(label for groups in factors.values() for label in groups))
        for i, (key, groups) in enumerate(factors.items()):
            axes = figure.add_subplot(rows, min(_COLUMNS, len(factors)), i + 1)
            for label, shares in groups.items():
                values = 100.0 * np.array([[each.value, each.low, each.high] for each in shares])
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
            axes.set_xticks(range(len(shares)), [each.level for each in shares], rotation=25, ha="right", fontsize=8)
            axes.set_ylim(-3.0, 103.0)
            axes.set_title(key)
            if i % _COLUMNS == 0:
                axes.set_ylabel("passed / % (95 %)")
        if len(labels) > 1:
            figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return True

    return draw
