"""Pictures of a replay, taken by a headless Chromium."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lgmpc.chromium import find_chromium
from lgmpc.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

__all__ = ["headless_chromium", "snapshots"]

# WebGL in software: the same picture on any machine, also without display and graphics card.
_ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def headless_chromium() -> Iterator[Browser]:
    """Start a headless Chromium with WebGL, and end it with the block.

    Raises:
        MissingDependencyError: if playwright or a Chromium is not installed.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise MissingDependencyError("playwright", "a picture of a replay", "pip install playwright") from error
    executable = find_chromium()
    if executable is None:
        raise MissingDependencyError("chromium", "a picture of a replay", "apt-get install chromium")
    # Chromium's sandbox does not run as root; the page is our own.
    sandbox = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=[*_ARGUMENTS, *sandbox])
        try:
            yield browser
        finally:
            browser.close()


def snapshots(
    browser: Browser,
    page: Path,
    times: Sequence[float],
    *,
    size: tuple[int, int] = (1280, 720),
    panels: bool = True,
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
