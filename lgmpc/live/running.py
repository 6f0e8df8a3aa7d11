"""The two processes of a live run: the viewer's is started first, so that the page is there while the loop is built."""

from __future__ import annotations

import importlib.util
import multiprocessing
import re
import socket
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, run_session
from lgmpc.config.schema import Config
from lgmpc.config.session import ProgressReport, Session, stop_signals
from lgmpc.errors import InputError, LgmpcError, MissingDependencyError
from lgmpc.live.session import Link, LiveRun, ShownRun
from lgmpc.live.viewer import view
from lgmpc.live.wishes import Note, Opened
from lgmpc.world.settings import named_world

__all__ = ["Viewing", "live_config", "viewed_config"]

_OPENING_S = 20.0
_OWN = ("127.0.0.1", "localhost", "::1")
_TOKEN = re.compile(r"[A-Za-z0-9_-]*")


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
    def open(self, config: Config, notify: Callable[[str], None]) -> Iterator[Link]:
        """Serve the page of a config during the block.

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
        process = context.Process(
            target=view, args=(config, theirs, self.host, self._free_port(), self.token), daemon=True
        )
        process.start()
        theirs.close()
        link = Link(mine)
        try:
            if not mine.poll(_OPENING_S):
                raise LgmpcError(f"the viewer did not open its page within {_OPENING_S:g} s")
            try:
                opened = mine.recv()
            except EOFError:
                raise LgmpcError("the viewer ended before its page was open; its error is above") from None
            assert isinstance(opened, Opened)
            notify(f"page: {opened.url}")
            if self.browser:
                webbrowser.open(opened.url)
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


def live_config(
    config: Config,
    out: str | Path = "runs",
    *,
    viewing: Viewing | None = None,
    duration_s: float = 300.0,
    notify: Callable[[str], None] = print,
) -> Path | None:
    """Simulate ``config`` in real time, driven from a page, until Ctrl-C; return the folder of the saved run.

    Commands, pushes and changes of the config are left out: the page gives them.

    Args:
        config: the closed loop.
        out: folder of run folders.
        viewing: where the page is served.
        duration_s: longest simulated time of a run, all of which is kept in memory.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: what cannot be built, and as from :meth:`Viewing.open`.
    """
    nothing = {"commands": (), "pushes": (), "changes": ()}
    config = config.replace({**nothing, "duration_s": duration_s, "after_fall_s": None})
    saved: Path | None = None
    with stop_signals() as stop, (viewing or Viewing()).open(config, notify) as link:
        run = LiveRun(config, link, stop, Path(out), notify)
        while True:
            try:
                run.run()
            except KeyboardInterrupt:
                return run.saved or saved
            finally:
                run.close()
            saved, wish = run.saved or saved, run.after
            assert wish is not None
            try:
                following = config.replace({"world": named_world(wish.world)}) if wish.world else config
                run, config = LiveRun(following, link, stop, Path(out), notify), following
            except LgmpcError as error:
                run = LiveRun(config, link, stop, Path(out), notify)
                link.send(Note(str(error), error=True))


def viewed_config(
    config: Config,
    out: str | Path = "runs",
    *,
    viewing: Viewing | None = None,
    notify: Callable[[str], None],
    progress: ProgressReport,
) -> FinishedRun:
    """Run ``config`` as :func:`lgmpc.config.execution.run_config` does, in real time and shown on a page."""
    with (viewing or Viewing(port=0)).open(config, notify) as link:
        shown: list[ShownRun] = []

        def prepared(announce: Callable[[str], None]) -> Session:
            session = prepare(config, notify=announce)
            assert isinstance(session, ClosedLoopSession)
            shown.append(ShownRun(config, session, link))
            return session

        try:
            return run_session(config, prepared, out, notify=notify, progress=progress)
        finally:
            for each in shown:
                each.close()
