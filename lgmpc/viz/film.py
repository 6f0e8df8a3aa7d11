"""Films of replays: a headless Chromium draws the page's scene, picture after picture, and ffmpeg encodes them."""

import base64
import importlib.util
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from lgmpc.chromium import find_chromium
from lgmpc.errors import InputError, MissingDependencyError, RunFolderError, required
from lgmpc.runs.atomic import reason_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

FILM_KINDS = {
    ".mp4": ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart"),
    ".gif": ("-filter_complex", "[0:v]scale=iw/2:-1,split[a][b];[a]palettegen[p];[b][p]paletteuse"),
}
"""Suffixes of films, and how ffmpeg encodes them."""

# WebGL in software: the same picture on any machine, also without display and graphics card.
_ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_BATCH = 8
"""Pictures of one call of the page: some megabytes."""

# The scene's canvas is read in the script that has drawn it: a screenshot would draw all of the page once more. Shadows
# of half the replay's resolution take a sixth less time.
_DRAW = files("lgmpc.viz").joinpath("assets", "film.js").read_text("utf-8")


@contextmanager
def headless_chromium() -> "Iterator[Browser]":
    """Start a headless Chromium with WebGL, and end it with the block.

    Raises:
        MissingDependencyError: if playwright or a Chromium is not installed.
    """
    playwright_api = required("playwright.sync_api", "a picture of a replay", "video")
    executable = find_chromium()
    if executable is None:
        raise MissingDependencyError("chromium", "a picture of a replay", "apt-get install chromium")
    # Chromium's sandbox does not run as root; the page is our own.
    sandbox = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with playwright_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=[*_ARGUMENTS, *sandbox])
        try:
            yield browser
        finally:
            browser.close()


def find_ffmpeg() -> str:
    """Return the ffmpeg on the path, else that of the package imageio-ffmpeg.

    Raises:
        MissingDependencyError: there is neither.
    """
    found = shutil.which("ffmpeg")
    if found is None and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise MissingDependencyError("ffmpeg", "a film", 'apt-get install ffmpeg, or pip install "lgmpc[video]"')
    return found or str(required("imageio_ffmpeg", "a film", "video").get_ffmpeg_exe())


def write_film(
    page: str, file: Path, duration_s: float, *, rate_hz: float = 25.0, size: tuple[int, int] = (1280, 720)
) -> None:
    """Write a film of a replay, in real time.

    Args:
        page: HTML of a replay.
        file: the film, whose suffix is one of :data:`FILM_KINDS`; its size is halved for .gif.
        duration_s: of the replay, s.
        rate_hz: pictures a second.
        size: width and height, even numbers of pixels.

    Raises:
        InputError: another suffix.
        MissingDependencyError: there is no ffmpeg, no playwright or no Chromium.
        RunFolderError: the file cannot be written.
    """
    if file.suffix not in FILM_KINDS:
        raise InputError("video", file.name, f"a file that ends in {' or '.join(FILM_KINDS)}")
    ffmpeg = find_ffmpeg()
    times = [k / rate_hz for k in range(int(duration_s * rate_hz) + 1)]
    try:
        with tempfile.TemporaryDirectory(prefix=".film.", dir=file.parent) as folder:
            source, draft = Path(folder, "page.html"), Path(folder, f"film{file.suffix}")
            source.write_text(page, encoding="utf-8")
            reading = ("-f", "image2pipe", "-c:v", "mjpeg", "-framerate", f"{rate_hz:g}", "-i", "-")
            command = [ffmpeg, "-loglevel", "error", *reading, *FILM_KINDS[file.suffix], str(draft)]
            with headless_chromium() as browser:
                encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
                assert encoder.stdin is not None
                with suppress(BrokenPipeError):  # it has ended; its words say why
                    for picture in _pictures(browser, source, times, size):
                        encoder.stdin.write(picture)
                _, words = encoder.communicate()
            if encoder.returncode:
                raise RunFolderError(f"cannot write {file}: ffmpeg: {words.decode(errors='replace').strip()}")
            draft.replace(file)
    except OSError as error:
        raise RunFolderError(f"cannot write {file}: {reason_of(error)}") from error


def _pictures(browser: "Browser", page: Path, times: Sequence[float], size: tuple[int, int]) -> Iterator[bytes]:
    """Yield a JPEG for each time."""
    tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
    tab.goto(f"{page.resolve().as_uri()}#t=0")
    tab.evaluate("lgmpc.ready")
    for first in range(0, len(times), _BATCH):
        for picture in tab.evaluate(_DRAW, list(times[first : first + _BATCH])):
            yield base64.b64decode(picture)
    tab.close()
