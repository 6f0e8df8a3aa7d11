"""A figure that a notebook displays. Imported when the first one is drawn, because matplotlib takes its time."""

from __future__ import annotations

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["Picture"]


class Picture(Figure):
    """A figure of matplotlib without a display, which a notebook shows whether or not pyplot is in use there."""

    def __init__(self) -> None:
        super().__init__(layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        """Return the content of a PNG file."""
        stream = io.BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()
