"""The viewer's process: where it serves its page, and the loop's end of the channel to it.

It is started before anything else is loaded or built, so that the page is open meanwhile.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from lgmpc.errors import InputError, LgmpcError, MissingDependencyError
from lgmpc.live.viewer import view

__all__ = ["Link", "Viewing"]

_OPENING_S = 60.0
_OWN = ("127.0.0.1", "localhost", "::1")
_TOKEN = re.compile(r"[A-Za-z0-9_-]*")


@dataclass(frozen=True)
class Link:
    """The loop's end of the channel to a viewer.

    Attributes:
        pipe: wishes come, and messages go.
    """

    pipe: Connection

    def send(self, message: object) -> None:
        """Send a message, unless there is no viewer any more."""
        try:
            self.pipe.send(message)
        except OSError:
            pass

    def wishes(self) -> list[Any]:
        """Return what came since the last call."""
        found = []
        try:
            while self.pipe.poll():
                found.append(self.pipe.recv())
        except (OSError, EOFError):
            pass
        return found


@dataclass(frozen=True)
class Viewing:
    """Where the page is served.

    Attributes:
        host: address of this machine to listen at.
        port: to listen at; 0 for any free one.
        token: secret that the page's address contains; required of any other address than this machine's own.
        browser: whether to open a browser on this machine.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str = ""
    browser: bool = True

    @contextmanager
    def open(self, notify: Callable[[str], None]) -> Iterator[Link]:
        """Serve the page during the block.

        Raises:
            MissingDependencyError: viser is not installed.
            InputError: the address cannot be listened at.
            LgmpcError: the viewer ended at once.
        """
        if importlib.util.find_spec("viser") is None:
            raise MissingDependencyError("viser", "lgmpc live", 'pip install "lgmpc[live]"')
        if self.host not in _OWN and not self.token:
            raise InputError("--token", "none", f"a secret, because {self.host} may be reached from other machines")
        if not _TOKEN.fullmatch(self.token):
            raise InputError("--token", repr(self.token), "letters, digits, - and _")
        context = multiprocessing.get_context("spawn")
        mine, theirs = context.Pipe()
        process = context.Process(target=view, args=(theirs, self.host, self._free_port(), self.token), daemon=True)
        process.start()
        theirs.close()
        link = Link(mine)
        try:
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
                probe.bind((self.host, self.port))
            except OSError as error:
                words = f"{self.host}:{self.port} ({error.strerror})"
                raise InputError("--port", words, "a free one; 0 takes any") from error
            return int(probe.getsockname()[1])
