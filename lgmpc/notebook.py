"""What a notebook displays of an object: a short HTML table; and whether this process is a notebook's kernel."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from html import escape

__all__ = ["html_table", "in_notebook"]


def html_table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """Return a table of two columns, names and values, under a title.

    Args:
        title: what the object is.
        rows: name and value of each line; values are shown by ``str``.
    """
    body = "".join(
        f'<tr><td style="text-align:left">{escape(name)}</td><td style="text-align:left">{escape(str(value))}</td></tr>'
        for name, value in rows
    )
    head = f'<tr><th colspan="2" style="text-align:left">{escape(title)}</th></tr>'
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook, whose outputs can be HTML."""
    # IPython is not imported for that: in a kernel it has been, and elsewhere it need not be installed.
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")
