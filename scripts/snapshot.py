"""Pictures of a replay, taken by a headless Chromium."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lgmpc.errors import InputError
from lgmpc.viz.film import headless_chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser

__all__ = ["headless_chromium", "snapshots"]


def snapshots(
    browser: Browser, page: Path, times: Sequence[float], *, size: tuple[int, int] = (1280, 720), panels: bool = True
) -> list[bytes]:
    """Take pictures of a replay page.

    Args:
        browser: from :func:`headless_chromium`.
        page: a file of :func:`lgmpc.viz.write_page`.
        times: s since the start of the log.
        size: width and height, pixels.
        panels: with title, legend and time line, or the scene alone.

    Returns:
        A PNG for each time.

    Raises:
        InputError: if the page is not a replay or reports an error.
    """
    tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
    problems: list[str] = []
    tab.on("pageerror", lambda error: problems.append(str(error)))
    try:
        tab.goto(f"{page.resolve().as_uri()}#t=0")
        if not tab.evaluate("typeof lgmpc === 'object' && lgmpc.ready.then(() => true, () => false)"):
            raise InputError("page", page, f"a replay of lgmpc that starts ({'; '.join(problems) or 'this is none'})")
        if not panels:
            tab.evaluate("document.body.classList.add('clean')")
        pictures = []
        for time in times:
            tab.evaluate("time => lgmpc.seek(time)", time)
            # The second frame starts after the first one, with the new time, has been drawn.
            tab.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            pictures.append(tab.screenshot())
        return pictures
    finally:
        tab.close()
