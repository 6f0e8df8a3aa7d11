"""Display in notebooks: short tables of objects, progress bars; and whether this process is a notebook's kernel."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from html import escape
from time import perf_counter
from typing import Any, TypeVar

__all__ = ["bar_html", "html_table", "in_notebook", "reports"]

T = TypeVar("T")

_PERIOD_S = 0.1
"""Time between two updates of a bar, s."""


def html_table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """Return a table of two columns, names and values, under a title.

    Args:
        title: description of the object.
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


def bar_html(fraction: float | None, words: str, *, running: bool) -> str:
    """Return a bar with words beside it; of an unknown fraction it is indeterminate, and left out at the end."""
    value = "" if fraction is None else f' value="{min(max(fraction, 0.0), 1.0):.3f}"'
    style = "width:16em;max-width:40%;vertical-align:middle;margin-right:0.8em"
    bar = f'<progress max="1"{value} style="{style}" aria-label="progress"></progress>'
    return f"<div>{bar if running or value else ''}<small>{escape(words)}</small></div>"


@contextmanager
def reports(
    notify: Callable[[str], None] | None,
    progress: Callable[[T], None] | None,
    read: Callable[[T], tuple[float | None, str]],
) -> Iterator[tuple[Callable[[str], None], Callable[[T], None]]]:
    """Yield the two callbacks of a run: the given ones or, where neither is given in a notebook, those of a bar.

    Args:
        notify: called with a description of the present preparation, if any.
        progress: called with the progress, if any.
        read: from a progress to the fraction that is done (``None`` if unknown) and words, for the bar.
    """
    if notify is not None or progress is not None or not in_notebook():
        yield notify or _ignore, progress or _ignore
        return
    from IPython.display import HTML, display

    # HTML that is replaced in place, so that no widgets are required; its final state remains in the saved notebook.
    fraction, words, drawn_at = None, "", 0.0
    handle: Any = None

    def draw(*, running: bool = True) -> None:
        nonlocal handle, drawn_at
        content = HTML(bar_html(fraction, words, running=running))  # type: ignore[no-untyped-call]
        if handle is None:
            handle = display(content, display_id=True)  # type: ignore[no-untyped-call]
        else:
            handle.update(content)
        drawn_at = perf_counter()

    def announce(message: str) -> None:
        nonlocal fraction, words
        fraction, words = None, message
        draw()

    def advance(now: T) -> None:
        nonlocal fraction, words
        fraction, words = read(now)
        if perf_counter() - drawn_at > _PERIOD_S:
            draw()

    try:
        yield announce, advance
    finally:
        if words:
            draw(running=False)


def _ignore(_: object) -> None:
    pass
