"""Runs that a page drives, one after the other, and runs of a config that a page shows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, run_session
from lgmpc.config.schema import Config
from lgmpc.config.session import ProgressReport, Session, ignore, stop_signals
from lgmpc.errors import LgmpcError
from lgmpc.live.session import LiveRun, ShownRun
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note
from lgmpc.world.settings import named_world

__all__ = ["live_config", "viewed_config"]


def live_config(
    config: Config,
    link: Link,
    out: str | Path = "runs",
    *,
    duration_s: float = 300.0,
    notify: Callable[[str], None] = print,
) -> Path | None:
    """Simulate ``config`` in real time, driven from a page, until Ctrl-C; return the folder of the last saved run.

    Commands, pushes and changes of the config are left out: the page gives them.

    Args:
        config: the closed loop.
        link: to the page, from :meth:`lgmpc.live.viewing.Viewing.open`.
        out: folder of run folders.
        duration_s: longest simulated time of a run, all of which is kept in memory.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: what cannot be built.
    """
    nothing = {"commands": (), "pushes": (), "changes": ()}
    config = config.replace({**nothing, "duration_s": duration_s, "after_fall_s": None})
    saved: Path | None = None
    with stop_signals() as stop:
        run = LiveRun(config, link, stop, Path(out), notify)
        while True:
            notify("simulating in real time; Ctrl-C saves the run")
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
    link: Link,
    out: str | Path = "runs",
    *,
    notify: Callable[[str], None] = ignore,
    progress: ProgressReport = ignore,
) -> FinishedRun:
    """Run ``config`` as :func:`lgmpc.config.execution.run_config` does, in real time and shown on a page."""
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
