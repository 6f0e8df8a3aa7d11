"""Display in notebooks: short tables of objects, progress bars; and whether this process is a notebook's kernel."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from html import escape
from time import perf_counter
from typing import Any, TypeVar

__all__ = ["ProgressBar", "bar_html", "html_table", "in_notebook", "reports"]

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


class ProgressBar:
    """Progress in the output of a notebook's cell: HTML that is replaced in place, so that no widgets are required.

    Used as a context manager; its final state remains in the saved notebook.
    """

    def __init__(self) -> None:
        self._fraction: float | None = None
        self._words = ""
        self._handle: Any = None
        self._drawn_at = 0.0

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        if self._words:
            self._draw(running=False)

    def announce(self, message: str) -> None:
        """Display a description of the present preparation."""
        self._fraction, self._words = None, message
        self._draw()

    def advance(self, fraction: float | None, words: str) -> None:
        """Display a fraction of the whole, ``None`` where that is unknown, and words beside it."""
        self._fraction, self._words = fraction, words
        if perf_counter() - self._drawn_at > _PERIOD_S:
            self._draw()

    def _draw(self, *, running: bool = True) -> None:
        from IPython.display import HTML, display

        content = HTML(bar_html(self._fraction, self._words, running=running))  # type: ignore[no-untyped-call]
        if self._handle is None:
            self._handle = display(content, display_id=True)  # type: ignore[no-untyped-call]
        else:
            self._handle.update(content)
        self._drawn_at = perf_counter()


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
    if notify is None and progress is None and in_notebook():
        with ProgressBar() as bar:
            yield bar.announce, lambda now: bar.advance(*read(now))
    else:
        yield notify or _ignore, progress or _ignore


def _ignore(_: object) -> None:
    pass
