"""The last pictures of a run, read from the ring as a log of the recorder's channels."""

from bisect import bisect_right
from collections import deque

import numpy as np

from lgmpc.config.build import build_recorder
from lgmpc.config.schema import GroundTruth
from lgmpc.live.ring import EXTRAS, PICTURE_S, RingReader
from lgmpc.live.wishes import Started
from lgmpc.robot import Robot
from lgmpc.runs import RunLog
from lgmpc.simulation.loop import control_ticks
from lgmpc.typing import Array
from lgmpc.world import World, make_world

_KEPT_S = 30.0
"""Length of what can be looked at again, s of the clock."""


class PictureHistory:
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
        # What is at the end of a link knows of no simulated world.
        self.world = World() if started.deployed else make_world(config.world, config.plant.friction, config.seed)
        ticks = control_ticks(1.0 / config.plant.rate_hz, config.wbc.rate_hz, 2.0 / config.wbc.rate_hz)
        estimated = not (started.deployed or isinstance(config.estimator, GroundTruth))
        self._recorder = build_recorder(config, robot, ticks, estimated=estimated, world=self.world)
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

    def at(self, back: float) -> int:
        """Return the number of the picture ``back`` (s, negative) before the last one."""
        times = [row[0] for row in self.rows]
        return max(bisect_right(times, times[-1] + back + 1e-9) - 1, 0)

    def log(self, last: int, count: int, every: int = 1) -> RunLog:
        """Return the log of ``count`` pictures up to number ``last``, or of one of ``every`` so many."""
        begin = max(last + 1 - count, 0)
        table = np.array([self.rows[i] for i in range(last, begin - 1, -every)][::-1])
        width = self._sizes[0]
        updates = table[:, width : width + self._sizes[1]]
        updates = updates[updates.any(axis=1)]  # zeros before the first one
        fresh = np.unique(updates[:, 0], return_index=True)[1]
        self._recorder.load(table[:, :width], updates[fresh])
        return self._recorder.log()

    def extras(self, at: int) -> Array:
        """Return the numbers of a picture that are in no log; see :data:`~lgmpc.live.ring.EXTRAS`."""
        return self.rows[at][-EXTRAS:]

    def close(self) -> None:
        """Detach from the ring."""
        self._reader.close()
