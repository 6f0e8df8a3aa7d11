"""The page of a live run, with the run in a process of its own: in a notebook or from a script."""

import atexit
import os
import signal
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from lgmpc.config import Config, load_config
from lgmpc.errors import LgmpcError
from lgmpc.live.viewing import Viewing
from lgmpc.runs import Run, load_run


class LivePage:
    """The page of a run in real time, which a notebook displays.

    Args:
        config: the closed loop.
        out: folder of run folders.
        height: of the page in a notebook, px.

    Attributes:
        url: address of the page.

    Raises:
        LgmpcError: the page did not open, or the run did not begin; the error is above.
    """

    def __init__(self, config: Config, out: str | Path = "runs", height: int = 600) -> None:
        self._height = height
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_live, args=(theirs, config, out))
        self._process.start()
        theirs.close()
        atexit.register(self.close)
        try:
            self.url: str = self._pipe.recv()
            while not self._pipe.recv().startswith("simulating"):
                pass
        except EOFError:
            raise LgmpcError("the live run ended early; its error is above") from None

    def close(self) -> Run | None:
        """End and save the run, and return it; None if nothing was recorded, or it has been returned before."""
        atexit.unregister(self.close)
        if self._pipe.closed:
            return None
        if self._process.is_alive():
            assert self._process.pid is not None
            os.kill(self._process.pid, signal.SIGINT)
        saved = ""
        try:
            while True:
                saved = self._pipe.recv()  # after what is told of other runs: the folder
        except EOFError:
            self._pipe.close()
        self._process.join()
        run = load_run(saved) if saved and self._process.exitcode == 0 else None
        assert run is None or isinstance(run, Run)
        return run

    def _repr_html_(self) -> str:
        """Return the page as a frame, which may read gamepads."""
        style = f"width:100%;height:{self._height}px;border:0;border-radius:6px"
        return f'<div><iframe src="{self.url}" style="{style}" allow="gamepad" title="live run"></iframe></div>'


def drive(config: str | Path | Config, out: str | Path = "runs") -> LivePage:
    """Simulate a config in real time on a page that drives it, as ``lgmpc live`` does; a notebook displays the page.

    Args:
        config: a config, its file, or the name of one that comes with lgmpc.
        out: folder of run folders.

    Returns:
        The page; outside a notebook open its ``url``. Its ``close`` ends the run, and returns it.
    """
    return LivePage(config if isinstance(config, Config) else load_config(config), out)


def _live(pipe: Connection, config: Config, out: str | Path) -> None:
    """Simulate until SIGINT; send the page's address, what is done, and at the end the saved folder, if any."""
    with Viewing(port=0, browser=False).open(lambda message: pipe.send(message.removeprefix("page: "))) as link:
        from lgmpc.live.session import live_config  # while the viewer starts

        pipe.send(str(live_config(config, link, out, notify=pipe.send) or ""))
