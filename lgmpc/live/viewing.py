"""The viewer's process, which draws pictures from the ring on a page and passes on what the page asks for.

It is started before anything else is loaded or built, so that the page is open meanwhile: here what takes time to
import is imported when the page is served.
"""

import hmac
import importlib.util
import ipaddress
import multiprocessing
import os
import re
import secrets
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from lgmpc.errors import InputError, LgmpcError, MissingDependencyError

if TYPE_CHECKING:
    import viser

_OPENING_S = 60.0
_HOST = "127.0.0.1"
_ORIGIN = r"https?://(localhost|127\.0\.0\.1|\[::1\]|{})(:\d+)?"
"""Pages that may connect; viser lets in those of any site that is open in the same browser. Programs have none."""


@dataclass
class Link:
    """The loop's end of the channel to a viewer.

    Attributes:
        pipe: wishes come, and messages go.
        lost: whether the viewer has ended.
    """

    pipe: Connection
    lost: bool = False

    def send(self, message: object) -> None:
        """Send a message, unless there is no viewer any more."""
        with suppress(OSError):
            self.pipe.send(message)

    def wishes(self) -> list[Any]:
        """Return what came since the last call; a viewer that has ended wishes the robot to stand still."""
        found: list[Any] = []
        try:
            while self.pipe.poll():
                found.append(self.pipe.recv())
        except (OSError, EOFError):
            if not self.lost:
                from lgmpc.live.wishes import STILL  # when a run is there, which has loaded it

                self.lost = True
                found.append(STILL)
        return found


@dataclass(frozen=True)
class Viewing:
    """Settings of the page's server.

    Attributes:
        port: to listen at; 0 for any free one.
        browser: whether to open a browser on this machine.
        host: address of this machine at which the page is served. At any but 127.0.0.1, who asks for it needs the token
            in the page's address, which is new in each run; nothing is encrypted.
    """

    port: int = 8080
    browser: bool = True
    host: str = _HOST

    @contextmanager
    def open(self, notify: Callable[[str], None], load: Callable[[], object] = lambda: None) -> Iterator[Link]:
        """Serve the page during the block.

        Args:
            notify: called with the page's address.
            load: called while the viewer starts, before the address is told; what it raises ends the viewer.

        Raises:
            MissingDependencyError: viser is not installed.
            InputError: the address cannot be listened at.
            LgmpcError: the viewer ended at once.
        """
        if importlib.util.find_spec("viser") is None:
            raise MissingDependencyError("viser", "lgmpc live", 'pip install "lgmpc[live]"')
        context = multiprocessing.get_context("spawn")
        mine, theirs = context.Pipe()
        process = context.Process(target=view, args=(theirs, self.host, self._free_port()), daemon=True)
        process.start()
        theirs.close()
        link = Link(mine)
        try:
            load()
            if not mine.poll(_OPENING_S):
                raise LgmpcError(f"the viewer did not open its page within {_OPENING_S:g} s")
            try:
                url = mine.recv()
            except EOFError:
                raise LgmpcError("the viewer ended before its page was open; its error is above") from None
            notify(f"page: {url}")
            if self.browser:
                from lgmpc.viz import open_page  # when the page is served

                open_page(url)
            yield link
        finally:
            mine.close()
            process.join(5.0)
            if process.is_alive():
                process.terminate()

    def _free_port(self) -> int:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                if ipaddress.ip_address(self.host).is_unspecified:
                    raise OSError(0, "no single address")
                probe.bind((self.host, self.port))
            except (OSError, ValueError) as error:
                words = f"{self.host}:{self.port} ({getattr(error, 'strerror', error)})"
                raise InputError("--port or --host", words, "a free port, 0 takes any; an IPv4 address here") from error
            return int(probe.getsockname()[1])


def view(pipe: Connection, host: str, port: int) -> None:
    """Serve the page until the loop's end of the pipe closes.

    Args:
        pipe: to the loop, which is sent the page's address first.
        host: address to listen at.
        port: to listen at.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is for the loop, which ends this process
    os.nice(5)  # where there are not enough cores, the loop comes first
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # viser prints its own addresses
    import viser
    from websockets.asyncio import server as sockets

    origins = [None, re.compile(_ORIGIN.format(re.escape(host)))]
    token = "" if host == _HOST else secrets.token_urlsafe(16)
    begin = sockets.serve

    def serve(*args: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        ask = partial(_admit, token, process_request) if token else process_request
        return begin(*args, process_request=ask, origins=origins, **options)

    vars(sockets)["serve"] = serve  # of this process: viser has no setting for origins or what a request needs
    server = viser.ViserServer(host, port, verbose=False)
    server.request_share_url = lambda *_, **__: None  # viser's tunnel would publish the page
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    pipe.send(f"http://{host}:{port}" + (f"/?token={token}" if token else ""))
    try:
        with suppress(EOFError, OSError):
            _serve(server, pipe)
    finally:
        server.stop()


def _admit(token: str, answer: Callable[..., Any], connection: Any, request: Any) -> Any:
    """Refuse a request without the token; one that has it in its address gets it as a cookie for all that follow."""
    asked = request.path.partition("?token=")[2]
    cookies = "; ".join(request.headers.get_all("Cookie")).split("; ")
    held = (each.removesuffix("=lgmpc") for each in cookies)  # named by the token: runs at other ports have others
    if not any(hmac.compare_digest(each.encode(), token.encode()) for each in (asked, *held)):
        return connection.respond(403, "The address of the page ends with the token that lgmpc live has printed.\n")
    response = answer(connection, request)
    if asked and response is not None:
        response.headers["Set-Cookie"] = f"{token}=lgmpc; HttpOnly; SameSite=Strict"
    return response


def _serve(server: "viser.ViserServer", pipe: Connection) -> None:
    """Show one run after the other.

    Raises:
        EOFError: the loop's end of the pipe has been closed.
    """
    from lgmpc.live.history import PictureHistory
    from lgmpc.live.page import Page
    from lgmpc.live.ring import PICTURE_S
    from lgmpc.live.wishes import Note, Started, Tune

    page, history = None, None
    try:
        while True:
            begun = time.perf_counter()
            while pipe.poll(None if history is None else 0.0):
                message = pipe.recv()
                if isinstance(message, Started):
                    page = Page(message, server, pipe) if page is None else page
                    if history is not None:
                        history.close()
                        history = None
                    with suppress(FileNotFoundError):  # a run that is over already
                        history = PictureHistory(page.robot, message)
                        page.begin(message, history)
                elif page is not None and isinstance(message, Tune):
                    page.tuned(message)
                elif page is not None and isinstance(message, Note):
                    page.tell(message)
            if page is not None:
                page.watch()
            if page is not None and history is not None and (history.update() or (page.stale and history.rows)):
                page.draw(history)
            spent = time.perf_counter() - begun
            time.sleep(max(PICTURE_S - spent, spent))  # at most half a core is taken from the loop's machine
    finally:
        if history is not None:
            history.close()
