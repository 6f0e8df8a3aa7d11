"""A simulation in real time that a page shows and drives: pace, commands, pulls, settings, the run's folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from time import perf_counter, sleep
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession, failed
from lgmpc.config.execution import FinishedRun, run_session, save_run
from lgmpc.config.schema import Change, Config
from lgmpc.config.session import ProgressReport, Session, StopSignals, ignore, stop_signals
from lgmpc.errors import LgmpcError
from lgmpc.live.shown import WISHES_S, PageCommands, Shown
from lgmpc.live.tuning import Tuner
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Order, OrderName, Pace, Pull, Restart, Save, Tune
from lgmpc.locomotion.command import CommandEntry, ModeRequest
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Tick
from lgmpc.typing import GRAVITY, Array
from lgmpc.world.settings import named_world

__all__ = ["LiveRun", "Pulls", "ShownRun", "live_config", "viewed_config"]

_AHEAD_S = 2e-3
"""Simulated time may be ahead of the clock by so much, s: less would be a system call at every tick."""
_BEHIND_S = 0.1
"""A loop that is further behind does not catch up, s."""
_STIFFNESS, _DAMPING_S, _STRONGEST = 5.0, 0.1, 2.0
"""Of a pull: weights of the robot per metre, damping relative to that, largest force in weights."""
_SAME_CHANGE_S = 0.5
"""Values of one setting within this time, s, are one change in the saved config: each is a controller of its own."""
_MODES: dict[OrderName, ModeRequest] = {"stop": "damp", "disarm": "damp", "arm": "stand", "lie": "lie"}
"""Of a simulated robot, by what is ordered."""


class Pulls(PushSchedule):
    """The pushes of a session, and a spring between a point of a body and one of the world."""

    def __init__(self, session: ClosedLoopSession) -> None:
        plant, self._robot = session.plant, session.robot
        super().__init__(session.pushes.pushes, plant.dt, plant.bodies)
        self._plant, self._data = plant, self._robot.create_data()
        self._weight = GRAVITY * self._robot.mass
        frames = self._robot.model.frames
        joints = ((frames[self._robot.body_frame(body)].parentJoint, body) for body in reversed(plant.bodies))
        self._body_of: dict[int, str] = dict(joints)
        self._pull = Pull(0)
        self._released: set[str] = set()

    def pull(self, wish: Pull) -> None:
        """Begin, move or end the pull."""
        if self._pull.joint not in (0, wish.joint):
            self._released.add(self._body_of[self._pull.joint])
        self._pull = wish if wish.joint in self._body_of else Pull(0)

    def is_active(self, time: float) -> bool:
        """Return whether a body is pushed or pulled during the step that begins at ``time``."""
        return self._pull.joint != 0 or bool(self._released) or super().is_active(time)

    def wrenches(self, time: float) -> Mapping[str, Array]:
        """Return the wrenches of the step that begins at ``time``; see the base class."""
        pushes = super().wrenches(time)
        if self._pull.joint == 0 and not self._released:
            return pushes
        found = dict(pushes)
        for body in self._released:
            found.setdefault(body, np.zeros(6))
        self._released.clear()
        if self._pull.joint:
            body = self._body_of[self._pull.joint]
            found = {body: found.pop(body, np.zeros(6)) + self._wrench(self._pull, body), **found}
        return MappingProxyType(found)

    def _wrench(self, pull: Pull, body: str) -> Array:
        """Return (6,) the spring's [force; torque] at the body's centre of mass, world axes."""
        sample, joint = self._plant.sense(), pull.joint
        pin.forwardKinematics(self._robot.model, self._data, sample.q, sample.v)
        pose, twist, arm = self._data.oMi[joint], self._data.v[joint], pull.grip
        grip = pose.act(arm)
        speed = pose.rotation @ (twist.linear + np.cross(twist.angular, arm))
        force = _STIFFNESS * self._weight * (pull.target - grip - _DAMPING_S * speed)
        force *= min(1.0, _STRONGEST * self._weight / max(float(np.linalg.norm(force)), 1e-12))
        return np.concatenate([force, np.cross(grip - self._plant.body_point(body), force)])


class ShownRun(Shown):
    """A simulation in real time that a viewer shows; the page changes its pace.

    Args:
        config: the closed loop.
        session: ready to run.
        link: to the viewer.
        started: see :class:`Shown`.
    """

    def __init__(self, config: Config, session: ClosedLoopSession, link: Link, **started: Any) -> None:
        self._session = session
        self._pace, self._steps = Pace(), 0
        self.check: Callable[[None], None] = ignore
        super().__init__(config, session, link, **started)
        for part, _ in session.earlier:
            part.watch = self._watch
        self._begin_to_pace()

    @property
    def _halted(self) -> bool:
        return self._pace.paused

    def _watch(self, tick: Tick) -> bool:
        super()._watch(tick)
        if self._pace.paused:
            self._wait_for_step()
        self._keep_pace()
        return self._continues

    @property
    def _continues(self) -> bool:
        return True

    def _begin_to_pace(self) -> None:
        self._origin = self._measured = (perf_counter(), self._time)

    def _keep_pace(self) -> None:
        (begun, origin), now = self._origin, perf_counter()
        ahead = (self._time - origin) / self._pace.speed - (now - begun)
        if ahead > _AHEAD_S:
            sleep(ahead)
        elif ahead < -_BEHIND_S:
            self._origin = (now, self._time)
        since, time = self._measured
        if now - since > 0.5:
            self._speed, self._measured = (self._time - time) / (now - since), (now, self._time)

    def _wait_for_step(self) -> None:
        self._show(0.0, True)
        while self._pace.paused and self._steps == 0 and self._continues:
            sleep(WISHES_S)
            self._answer()
        self._steps = max(self._steps - 1, 0)
        self._begin_to_pace()

    def _answer(self) -> None:
        self.check(None)
        super()._answer()

    def _fulfil(self, wish: Any) -> None:
        if isinstance(wish, Pace):
            self._pace, self._steps = wish, self._steps + wish.steps
            self._begin_to_pace()
        else:
            super()._fulfil(wish)


class LiveRun(ShownRun):
    """A run that the page drives.

    Args:
        config: the closed loop.
        link: to the viewer.
        stop: signals that end it.
        out: folder of run folders.
        notify: called with a description of what is being prepared.

    Attributes:
        after: the wish for the next run that ended this one, if any did.
        saved: the last folder that was written.
    """

    def __init__(self, config: Config, link: Link, stop: StopSignals, out: Path, notify: Callable[[str], None]) -> None:
        session = prepare(config, notify=stop.checked(notify))
        assert isinstance(session, ClosedLoopSession)
        self._pulls = Pulls(session)
        session, controller = replace(session, pushes=self._pulls), session.controller
        gaits = tuple(controller.feet.gaits)
        controller.commands = self._commands = PageCommands(gaits, plans=config.mpc.enabled)
        self._tuner = Tuner(config, controller)
        self._config, self._changes = self._tuner.config, list[Change]()
        self._stop, self._out, self._failure = stop, out, ""
        self.after: Restart | None = None
        self.saved: Path | None = None
        super().__init__(self._config, session, link, tunable=self._tuner.values)

    @property
    def _continues(self) -> bool:
        return self.after is None

    def run(self) -> None:
        """Simulate until the duration's end, a failure, or a wish for another run; after the former wait for a wish.

        Raises:
            Interrupted: by a signal, after the run was saved.
        """
        with self._stop.deferred(ignore) as self.check:
            try:
                self._begin_to_pace()
                try:
                    self._session.advance(ignore)
                except Exception as error:
                    self._failure = failed(error, self._time)
                self._show(0.0, True)
                if self.after is None:
                    ending = self._failure or f"the run ended after {self._time:.1f} s"
                    self._link.send(Note(ending, error=bool(self._failure), over=True))
                while self.after is None:
                    self._answer()
                    sleep(WISHES_S)
            except KeyboardInterrupt:
                self._save()
                raise

    def _fulfil(self, wish: Any) -> None:
        if isinstance(wish, CommandEntry):
            self._commands.ask(wish)
        elif isinstance(wish, Order):
            self._commands.ask(CommandEntry(at_s=0.0, mode=_MODES[wish.name]))
        elif isinstance(wish, Pull):
            self._pulls.pull(wish)
        elif isinstance(wish, Tune):
            self._link.send(Tune(wish.key, self._tuner.set(wish.key, wish.value)))
            self._remember(wish)
        elif isinstance(wish, Restart):
            self.after = wish
        elif isinstance(wish, Save):
            self._save()
            self._link.send(Note(f"saved in {self.saved}" if self.saved else "there is nothing to save yet"))
            self._begin_to_pace()
        else:
            super()._fulfil(wish)

    def _remember(self, wish: Tune) -> None:
        """Keep a change of a setting for the saved config."""
        at, values = max(self._time, self._session.rates.period), {wish.key: wish.value}
        if self._changes and at - self._changes[-1].at_s < _SAME_CHANGE_S:
            last = self._changes.pop()
            at, values = last.at_s, {**last.set, **values}
        self._changes.append(Change(at_s=at, set=values))

    def _save(self) -> None:
        """Save what was recorded until now as a run folder."""
        session = self._session
        if session.recorder.ticks == 0:
            return
        period = session.rates.period
        end = (session.recorder.ticks + 1) * period
        changes = tuple(each for each in self._changes if each.at_s < end - period)
        commands = tuple(self._commands.entries) if self._config.mpc.enabled else ()
        config = self._config.replace({"duration_s": end, "commands": commands, "changes": changes})
        result = session.result(interrupted=not self._failure, failure=self._failure)
        self.saved = save_run(config, result, self._out)


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
