"""Pages inside notebooks."""

from __future__ import annotations

from html import escape

__all__ = ["embed_page", "frame_of"]

_HEIGHT = 480  # px


def frame_of(page: str, height: int = _HEIGHT) -> str:
    """Return the HTML of a frame that contains a page.

    Args:
        page: the page's HTML.
        height: px; the frame is as wide as the notebook.
    """
    style = f"width:100%;height:{height}px;border:0;border-radius:6px"
    frame = f'<iframe srcdoc="{escape(page)}" style="{style}" loading="lazy" title="replay"></iframe>'
    return f"<div>{frame}</div>"  # IPython warns of HTML that begins with a frame


def embed_page(page: str, height: int = _HEIGHT) -> None:
    """Display a page as an output of the notebook's cell; arguments as in :func:`frame_of`."""
    from IPython.display import HTML, display

    display(HTML(frame_of(page, height)))  # type: ignore[no-untyped-call]
