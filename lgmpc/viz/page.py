"""Pages: one self-contained HTML text with viewer, scene, animation and time line; as file, by a server, in notebooks.

A page works from ``file://`` without a network. :mod:`lgmpc.viz.scene` defines the encoding of its arrays.
"""

from __future__ import annotations

import base64
import contextlib
import html
import importlib.util
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.runs import atomic_write
from lgmpc.runs.atomic import reason_of
from lgmpc.typing import Array
from lgmpc.viz.scene import Scene

__all__ = [
    "PageServer",
    "Readout",
    "embed_page",
    "filled",
    "frame_of",
    "has_desktop",
    "page_of",
    "serve_page",
    "time_line",
    "write_page",
]

_READOUT_COLORS = ("#0072b2", "#8a5a9e")
"""Colours of the first and the second curve on the time line."""

_FRAME_HEIGHT = 480  # px, in notebooks

CONNECTIONS = 16
"""Largest number of open connections of a server; a browser opens up to six."""

IDLE_S = 5.0
"""Time without data after which a server closes a connection, s."""


@dataclass(frozen=True)
class Readout:
    """A quantity on the time line.

    Attributes:
        label: short name.
        unit: text after the number, with a leading space if required.
        values: (n,) one for each picture, not negative.
        digits: after the decimal point.
    """

    label: str
    unit: str
    values: Array
    digits: int = 2


def time_line(times: Array, readouts: tuple[Readout, ...], states: Sequence[str] = ()) -> dict[str, object]:
    """Return the data of the page's time line: at most two quantities over the pictures' times (n,), s.

    Args:
        times: (n,) times of the pictures, s.
        readouts: the quantities.
        states: (n,) name of the robot's mode, displayed beside them; empty for none.
    """
    curves = [
        {
            "label": readout.label,
            "unit": readout.unit,
            "digits": readout.digits,
            "color": color,
            "values": np.round(np.nan_to_num(readout.values), readout.digits + 1).tolist(),
        }
        for readout, color in zip(readouts, _READOUT_COLORS, strict=False)
    ]
    return {"time": np.round(times, 4).tolist(), "curves": curves, "states": list(states)}


def page_of(title: str, scene: Scene, content: Mapping[str, object]) -> str:
    """Return the page's HTML.

    Args:
        title: title of the window.
        scene: the scene.
        content: of the panels: name, created, verdict, reasons, facts, legend, pushes, start, series (see
            :func:`time_line`), fog, camera.

    Raises:
        MissingDependencyError: if meshcat is not installed.
    """
    viewer = _viewer_folder()
    assets = resources.files("lgmpc.viz") / "assets"
    parts = {
        "title": html.escape(title),
        "licences": _licences(viewer),
        "style": (assets / "replay.css").read_text(encoding="utf-8"),
        # This sequence would end the script element.
        "viewer": (viewer / "dist" / "main.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script"),
        "payload": base64.b64encode(scene.pack(content)).decode("ascii"),
        "script": (assets / "replay.js").read_text(encoding="utf-8"),
    }
    return filled((assets / "replay.html").read_text(encoding="utf-8"), parts)


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Return the template with each ``@@name@@`` replaced by the part of that name."""
    page, *rest = template.split("@@")
    for name, text in zip(rest[::2], rest[1::2], strict=True):
        page += parts[name] + text
    return page


def write_page(page: str, file: Path | str) -> Path:
    """Write a page to a file, atomically, and return the file's path.

    Raises:
        RunFolderError: if the file cannot be written.
    """
    path = Path(file)
    with atomic_write(path) as stream:
        stream.write(page.encode("utf-8"))
    return path


def frame_of(page: str, height: int = _FRAME_HEIGHT) -> str:
    """Return the HTML of a frame that contains a page.

    Args:
        page: the page's HTML.
        height: px; the frame is as wide as the notebook.
    """
    style = f"width:100%;height:{height}px;border:0;border-radius:6px"
    frame = f'<iframe srcdoc="{html.escape(page)}" style="{style}" loading="lazy" title="replay"></iframe>'
    return f"<div>{frame}</div>"  # IPython warns about HTML that begins with a frame


def embed_page(page: str, height: int = _FRAME_HEIGHT) -> None:
    """Display a page as an output of the notebook's cell; arguments as in :func:`frame_of`."""
    from IPython.display import HTML, display

    display(HTML(frame_of(page, height)))  # type: ignore[no-untyped-call]


def has_desktop() -> bool:
    """Return whether a browser window can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def serve_page(
    page: str, what: str, *, port: int = 0, open_browser: bool = False, notify: Callable[[str], None] = print
) -> None:
    """Serve a page on 127.0.0.1 until Ctrl-C.

    Args:
        page: the page.
        what: name of the run in the message.
        port: TCP port; 0 = any free one.
        open_browser: open the page in the default browser.
        notify: called with a line that contains the address.

    Raises:
        InputError: if the port is taken.
    """
    with PageServer(page, port) as server, contextlib.suppress(KeyboardInterrupt):
        notify(f"Replay of {what}: {server.url}  (Ctrl-C ends it)")
        if open_browser:
            webbrowser.open(server.url)
        threading.Event().wait()


class PageServer:
    """Context manager that serves one page to this machine.

    Requests whose ``Host`` is another name than this machine's are refused: a page of another site whose name resolves
    to 127.0.0.1 could otherwise read the answer. At most :data:`CONNECTIONS` are open, each for
    :data:`IDLE_S` without data.

    Args:
        page: the page.
        port: TCP port; 0 = any free one.

    Raises:
        InputError: if the port is taken.
    """

    def __init__(self, page: str, port: int = 0) -> None:
        content = page.encode("utf-8")

        class Handler(BaseHTTPRequestHandler):
            timeout = IDLE_S

            def do_GET(self) -> None:  # the name that the standard library requires
                bound = self.connection.getsockname()[1]
                known = [f"{name}:{bound}" for name in ("127.0.0.1", "localhost", "[::1]")]
                status, body = 200, content
                if self.headers.get("Host", "").lower() not in known:
                    status, body = 403, f"unknown Host; this page is at http://{known[0]}/".encode()
                elif self.path not in ("/", "/index.html"):
                    status, body = 404, b"not found"
                self.send_response(status)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                with contextlib.suppress(ConnectionError):
                    self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Print nothing."""

        try:
            self._server = _BoundedServer(("127.0.0.1", port), Handler)
        except (OSError, OverflowError) as error:
            reason = reason_of(error) if isinstance(error, OSError) else "out of range"
            raise InputError("port", port, f"a free TCP port ({reason}); 0 takes any") from error
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def __enter__(self) -> PageServer:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _BoundedServer(ThreadingHTTPServer):
    """A server with a thread for each of at most :data:`CONNECTIONS` connections; further ones are closed."""

    request_queue_size = 4 * CONNECTIONS  # a shorter queue makes clients wait for seconds before they are refused

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self._free = threading.BoundedSemaphore(CONNECTIONS)
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a request in a thread, if one is free."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer a request."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()


def _viewer_folder() -> Path:
    # Located, not imported: meshcat's Python package imports sockets and notebooks that a page does not need.
    spec = importlib.util.find_spec("meshcat")
    if spec is None or not spec.submodule_search_locations:
        raise MissingDependencyError("meshcat", "the replay", "pip install meshcat")
    return Path(spec.submodule_search_locations[0]) / "viewer"


def _licences(viewer: Path) -> str:
    files = (viewer / "LICENSE", viewer / "dist" / "main.min.js.LICENSE.txt")
    texts = [file.read_text(encoding="utf-8") for file in files if file.is_file()]
    return "\n".join(texts).replace("--", "- -")
