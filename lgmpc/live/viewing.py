"""The viewer's process, which draws pictures from the ring on a page and passes on what the page asks for.

It is started before anything else is loaded or built, so that the page is open meanwhile: here what takes time to
import is imported when the page is served.
"""

import importlib.util
import multiprocessing
import os
import re
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
"""viser has no access control: other machines come through ssh."""
_ORIGINS = [None, re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")]
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
    """

    port: int = 8080
    browser: bool = True

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
        process = context.Process(target=view, args=(theirs, self._free_port()), daemon=True)
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
                probe.bind((_HOST, self.port))
            except OSError as error:
                words = f"{_HOST}:{self.port} ({error.strerror})"
                raise InputError("--port", words, "a free one; 0 takes any") from error
            return int(probe.getsockname()[1])


def view(pipe: Connection, port: int) -> None:
    """Serve the page until the loop's end of the pipe closes.

    Args:
        pipe: to the loop, which is sent the page's address first.
        port: to listen at.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is for the loop, which ends this process
    os.nice(5)  # where there are not enough cores, the loop comes first
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # viser prints its own addresses
    import viser
    from websockets.asyncio import server as sockets

    vars(sockets)["serve"] = partial(sockets.serve, origins=_ORIGINS)
    server = viser.ViserServer(_HOST, port, verbose=False)
    server.request_share_url = lambda *_, **__: None  # viser's tunnel would publish the page
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    pipe.send(f"http://{_HOST}:{port}")
    try:
        with suppress(EOFError, OSError):
            _serve(server, pipe)
    finally:
        server.stop()


def _serve(server: "viser.ViserServer", pipe: Connection) -> None:
    """Show one run after the other.

    Raises:
        EOFError: the loop's end of the pipe has been closed.
    """
    from lgmpc.live.history import History
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
                        history = History(page.robot, message)
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
