"""The viewer's process: it reads pictures from the ring, draws them on a page, and passes on what the page asks for."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections import deque
from multiprocessing.connection import Connection

import numpy as np

from lgmpc.config.build import build_recorder
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import Config, GroundTruth
from lgmpc.live.door import open_door
from lgmpc.live.ring import RingReader
from lgmpc.live.session import EXTRAS, PICTURE_S
from lgmpc.live.wishes import Ended, Note, Opened, Started, Tuned
from lgmpc.robot import Robot
from lgmpc.runs import RunLog
from lgmpc.simulation.loop import Rates
from lgmpc.typing import Array
from lgmpc.world import make_world

__all__ = ["History", "view"]

_KEPT_S = 30.0
"""Length of what can be looked at again, s of the clock."""


class History:
    """The last pictures of a run, as a log.

    Args:
        robot: the robot.
        started: the run.

    Attributes:
        world: its ground.
        rows: the pictures, oldest first.
    """

    def __init__(self, robot: Robot, started: Started) -> None:
        config = started.config
        self.world = make_world(config.world, config.plant.friction, config.seed)
        rates = Rates.of(1.0 / config.plant.rate_hz, config.wbc.rate_hz, 2.0 / config.wbc.rate_hz)
        self._recorder = build_recorder(
            config, robot, rates, effort_limit=robot.effort_limit, mass=robot.mass, friction=config.plant.friction,
            estimated=not isinstance(config.estimator, GroundTruth), world=self.world,
        )  # fmt: skip
        self._sizes = [part.size for part in self._recorder.rows]
        self._reader = RingReader(started.ring, sum(self._sizes) + EXTRAS)
        self.rows: deque[Array] = deque(maxlen=round(_KEPT_S / PICTURE_S))

    def update(self) -> bool:
        """Take what is new; return whether anything is."""
        found = False
        for row in self._reader.fresh():
            if self.rows and row[0] <= self.rows[-1][0]:  # shown again in a pause
                self.rows.pop()
            self.rows.append(row)
            found = True
        return found

    def log(self, last: int, count: int) -> RunLog:
        """Return the log of ``count`` pictures up to number ``last``."""
        begin = max(last + 1 - count, 0)
        table = np.array([self.rows[i] for i in range(begin, last + 1)])
        width = self._sizes[0]
        updates = table[:, width : width + self._sizes[1]]
        updates = updates[updates.any(axis=1)]  # zeros before the first one
        fresh = np.unique(updates[:, 0], return_index=True)[1]
        self._recorder.load(table[:, :width], updates[fresh])
        return self._recorder.log()

    def extras(self, at: int) -> Array:
        """Return the numbers of a picture that are in no log; see :data:`~lgmpc.live.session.EXTRAS`."""
        return self.rows[at][-EXTRAS:]

    def close(self) -> None:
        """Detach from the ring."""
        self._reader.close()


def view(config: Config, pipe: Connection, host: str, port: int, token: str = "") -> None:
    """Serve the page until the loop's end of the pipe closes; the body of the viewer's process.

    Args:
        config: the closed loop, whose world may change.
        pipe: to the loop.
        host: address of this machine to listen at.
        port: to listen at.
        token: that the page's address has to contain, if any.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal is for the loop, which ends this process
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())  # viser prints its own addresses
    from lgmpc.live.page import Page

    page = Page(config, build_robot(config), pipe, *(("127.0.0.1", 0) if token else (host, port)))
    if token:
        open_door(host, port, page.port, token)
    pipe.send(Opened(f"http://{host}:{port}{f'/?token={token}' if token else ''}"))
    history: History | None = None
    try:
        while True:
            begun = time.perf_counter()
            while pipe.poll():
                message = pipe.recv()
                if isinstance(message, Started):
                    if history is not None:
                        history.close()
                    history = History(page.robot, message)
                    page.begin(message, history)
                elif isinstance(message, Tuned):
                    page.tuned(message)
                elif isinstance(message, (Note, Ended)):
                    page.tell(message)
            if history is not None and history.update():
                page.draw(history)
            spent = time.perf_counter() - begun
            time.sleep(max(PICTURE_S - spent, spent))  # at most half a core is taken from the loop's machine
    except (EOFError, OSError):
        pass
    finally:
        if history is not None:
            history.close()
        page.close()
