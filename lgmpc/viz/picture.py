"""A figure that a notebook displays. Imported when the first one is drawn, because importing matplotlib is slow."""

from __future__ import annotations

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["Picture"]


class Picture(Figure):
    """A figure of matplotlib without a display, shown by a notebook with or without pyplot."""

    def __init__(self) -> None:
        super().__init__(layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        """Return the content of a PNG file."""
        stream = io.BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()
