"""Pictures of a run in a ring of shared memory, and the wishes of who looks at them.

Pictures are written at most sixty times a second, and wishes are looked for in a pipe every few milliseconds. The run
waits for nothing: without a viewer, or after its end, it goes on as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any, Protocol

import numpy as np

from lgmpc.config.schema import Config
from lgmpc.control.legged import LeggedController
from lgmpc.errors import InputError, LgmpcError
from lgmpc.live.ring import RingWriter
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Started
from lgmpc.locomotion.command import CommandEntry, MotionCommand
from lgmpc.runs import Recorder
from lgmpc.simulation.loop import Tick

__all__ = ["EXTRAS", "PICTURE_S", "WISHES_S", "PageCommands", "Shown", "Watched"]

PICTURE_S = 1.0 / 60.0
"""Least time between two pictures, s."""
WISHES_S = 5e-3
"""Time between two looks for wishes, s."""

EXTRAS = 8
"""Numbers of a picture besides the rows of the recorder: simulated over elapsed time, whether time stands still, the
number of the gait, and the ground as the controller believes it to be: slope (2) and a point (3)."""


class PageCommands:
    """A :class:`~lgmpc.locomotion.command.CommandSource` of what the page asks for.

    Args:
        gaits: names of those that exist.
        plans: whether the controller has an MPC.

    Attributes:
        entries: all changes so far, as a config's ``commands``.
    """

    def __init__(self, gaits: Sequence[str], *, plans: bool) -> None:
        self._gaits, self._plans = tuple(gaits), plans
        gait = "trot" if "trot" in gaits else gaits[-1]
        self._command = MotionCommand(gait=gait)
        self.entries = [CommandEntry(at_s=0.0, gait=gait)]
        self._asked: list[CommandEntry] = []

    def ask(self, entry: CommandEntry) -> None:
        """Let a change act from the next tick on.

        Raises:
            InputError: a gait that does not exist, or a controller that can only stand.
        """
        if entry.gait is not None and entry.gait not in self._gaits:
            raise InputError("gait", entry.gait, "the name of a gait", self._gaits, word=entry.gait)
        if not self._plans:
            raise InputError("mpc.enabled", False, "true: without a plan the robot only stands")
        self._asked.append(entry)

    def at(self, t: float) -> MotionCommand:
        """Return the command of the tick at ``t``, s."""
        for asked in self._asked:
            self.entries.append(asked.replace({"at_s": max(t, 0.0)}))
            self._command = self.entries[-1].change(self._command)
        self._asked.clear()
        return self._command


class Watched(Protocol):
    """A run, of a simulated robot or one at the end of a link.

    Attributes:
        controller: the controller.
        recorder: of the run.
        watch: called after each recorded tick.
    """

    controller: LeggedController
    recorder: Recorder
    watch: Callable[[Tick], bool] | None


class Shown:
    """A run that a viewer shows, and whose wishes are fulfilled between its ticks.

    Args:
        config: the closed loop.
        run: ready to begin.
        link: to the viewer.
        started: further items of the :class:`~lgmpc.live.wishes.Started` that the viewer receives.
    """

    def __init__(self, config: Config, run: Watched, link: Link, **started: Any) -> None:
        self._controller, self._link = run.controller, link
        ticks, updates = run.recorder.rows
        self._parts = (ticks, updates, np.zeros(EXTRAS))
        self._ring = RingWriter(ticks.size + updates.size + EXTRAS)
        run.watch = self._watch
        self._time, self._speed = 0.0, 1.0
        self._shown_at = self._asked_at = -math.inf
        self._gaits = tuple(run.controller.feet.gaits)
        link.send(Started(self._ring.name, config, self._gaits, tuple(config.maneuvers), **started))

    def close(self) -> None:
        """Give back the memory of the pictures."""
        self._ring.close()

    @property
    def _halted(self) -> bool:
        """Whether time stands still."""
        return False

    def _show(self, speed: float, halted: bool) -> None:
        """Write the picture of the last recorded tick."""
        report, ground = self._controller.report, self._controller.feet.ground
        x, y, _ = report.com.tolist()
        gait = self._gaits.index(report.gait.name) if report.gait.name in self._gaits else -1
        self._parts[2][:] = (speed, halted, gait, *ground.slope, x, y, ground.height_at(x, y))
        self._ring.write(*self._parts)

    def _watch(self, tick: Tick) -> bool:
        """Show a tick and fulfil wishes, now and then; return whether the run continues."""
        now, self._time = perf_counter(), tick.sample.time
        if now - self._asked_at > WISHES_S:
            self._asked_at = now
            self._answer()
        if now - self._shown_at > PICTURE_S:
            self._shown_at = now
            self._show(self._speed, self._halted)
        return True

    def _answer(self) -> None:
        """Fulfil the wishes that came."""
        for wish in self._link.wishes():
            try:
                self._fulfil(wish)
            except LgmpcError as error:
                self._link.send(Note(str(error), error=True))

    def _fulfil(self, wish: Any) -> None:
        self._link.send(Note("this run follows its config; `lgmpc live` is driven from here", error=True))
