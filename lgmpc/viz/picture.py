"""A figure that a notebook displays. Imported when the first one is drawn, because importing matplotlib is slow."""

from __future__ import annotations

import io
from typing import IO

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["Picture"]


class Picture(Figure):
    """A figure of matplotlib without a display, shown by a notebook with or without pyplot."""

    def __init__(self) -> None:
        super().__init__(layout="constrained")
        self._agg = FigureCanvasAgg(self)

    def write_png(self, stream: IO[bytes]) -> None:
        """Write the content of a PNG file. It is drawn once; ``savefig`` draws twice when the layout is constrained."""
        self._agg.print_png(stream)  # type: ignore[no-untyped-call]

    def _repr_png_(self) -> bytes:
        """Return the content of a PNG file."""
        stream = io.BytesIO()
        self.write_png(stream)
        return stream.getvalue()
