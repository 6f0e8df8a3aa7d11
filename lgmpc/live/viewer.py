"""The body of the viewer's process: it draws pictures from the ring on a page, and passes on what the page asks for.

What takes time to import is imported when the page is already served.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

__all__ = ["view"]


def view(pipe: Connection, host: str, port: int, token: str = "") -> None:
    """Serve the page until the loop's end of the pipe closes.

    Args:
        pipe: to the loop, which is sent the page's address first.
        host: address of this machine to listen at.
        port: to listen at.
        token: that the page's address has to contain, if any.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is for the loop, which ends this process
    os.nice(5)  # where there are not enough cores, the loop comes first
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # viser prints its own addresses
    import viser

    server = viser.ViserServer(*(("127.0.0.1", 0) if token else (host, port)), verbose=False)
    server.request_share_url = lambda *_, **__: None  # viser's tunnel would publish the page
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    if token:
        from lgmpc.live.door import open_door

        open_door(host, port, server.get_port(), token)
    pipe.send(f"http://{host}:{port}{f'/?token={token}' if token else ''}")
    try:
        _serve(server, pipe)
    except (EOFError, OSError):
        pass
    finally:
        server.stop()


def _serve(server: viser.ViserServer, pipe: Connection) -> None:
    """Show one run after the other.

    Raises:
        EOFError: the loop's end of the pipe has been closed.
    """
    from lgmpc.live.history import History
    from lgmpc.live.page import Page
    from lgmpc.live.session import PICTURE_S
    from lgmpc.live.wishes import Note, Started, Tune

    page, history = None, None
    try:
        while True:
            begun = time.perf_counter()
            while pipe.poll(None if history is None else 0.0):
                message = pipe.recv()
                if isinstance(message, Started):
                    page = Page(message.config, server, pipe) if page is None else page
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
            if page is not None and history is not None and (history.update() or (page.stale and history.rows)):
                page.draw(history)
            spent = time.perf_counter() - begun
            time.sleep(max(PICTURE_S - spent, spent))  # at most half a core is taken from the loop's machine
    finally:
        if history is not None:
            history.close()
