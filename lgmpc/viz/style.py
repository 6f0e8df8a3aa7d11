"""The style of figures: colours and common settings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from lgmpc.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lgmpc.viz.picture import Picture

__all__ = ["EXTRA", "INK", "LIMIT", "PALETTE", "PUSH", "SOFT", "THEMED", "X", "Y", "Z", "figure_maker"]

X, Y, Z = "#0072B2", "#E69F00", "#009E73"  # Okabe and Ito's palette, distinguishable by colour-blind readers
LIMIT, PUSH, EXTRA = "#D55E00", "#D55E00", "#CC79A7"
INK, SOFT = "#1d2733", "#5b6877"
PALETTE = (X, Y, Z, LIMIT, EXTRA, "#56B4E9")
"""Colours of further curves, in order."""

THEMED = {INK: "ink", SOFT: "soft", "#b9c2cc": "line", "#e6eaee": "grid"}
"""Colours that a page replaces by CSS variables, and the names of these."""

_VECTOR: dict[Any, Any] = {"svg.fonttype": "none", "path.simplify_threshold": 0.1, "figure.dpi": 72}

_STYLE: dict[Any, Any] = {
    "figure.dpi": 130,
    "figure.facecolor": "white",
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": "#b9c2cc",
    "axes.labelcolor": INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,  # stairs are patches, over which the grid would be drawn
    "grid.color": "#e6eaee",
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


@contextmanager
def figure_maker(purpose: str, *, vector: bool = False) -> Iterator[Callable[[], Picture]]:
    """Yield a function that creates empty figures, without a display and in the common style.

    Args:
        purpose: purpose of the figures, for the error message.
        vector: whether they are saved as vectors, with text as text.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    try:
        import matplotlib

        from lgmpc.viz.picture import Picture
    except ImportError as error:
        raise MissingDependencyError("matplotlib", purpose, "pip install matplotlib") from error

    with matplotlib.rc_context(_STYLE | _VECTOR if vector else _STYLE):
        yield Picture
