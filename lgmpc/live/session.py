"""A run that a page shows, and a simulation that it drives: pace, commands, pulls, settings, the run's folder.

Pictures are written into a ring of shared memory at most sixty times a second, and wishes are looked for in a pipe
every few milliseconds. The run waits for nothing: without a viewer, or after its end, it goes on as it is.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
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
from lgmpc.control.legged import LeggedController
from lgmpc.errors import InputError, LgmpcError
from lgmpc.live.ring import EXTRAS, PICTURE_S, RingWriter
from lgmpc.live.tuning import Tuner
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Order, OrderName, Pace, Pull, Restart, Save, Started, Tune
from lgmpc.locomotion.command import CommandEntry, ModeRequest, MotionCommand
from lgmpc.runs import Recorder
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Tick
from lgmpc.typing import GRAVITY, Array
from lgmpc.world.settings import named_world

_WISHES_S = 5e-3
"""Time between two looks for wishes, s."""
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


class Shown:
    """A run that a viewer shows, and whose wishes are fulfilled between its ticks.

    Args:
        config: the closed loop.
        controller: its reports are shown.
        recorder: of the run.
        link: to the viewer.
        started: further items of the :class:`~lgmpc.live.wishes.Started` that the viewer receives.
    """

    def __init__(
        self, config: Config, controller: LeggedController, recorder: Recorder, link: Link, **started: Any
    ) -> None:
        self._controller, self._link = controller, link
        ticks, updates = recorder.rows
        self._parts = (ticks, updates, np.zeros(EXTRAS))
        self._ring = RingWriter(ticks.size + updates.size + EXTRAS)
        self._time, self._speed = 0.0, 1.0
        self._shown_at = self._asked_at = -math.inf
        self._gaits = tuple(controller.feet.gaits)
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
        report, ground = self._controller.report, self._controller.report.ground
        x, y, _ = report.com.tolist()
        gait = self._gaits.index(report.gait.name) if report.gait.name in self._gaits else -1
        self._parts[2][:] = (speed, halted, gait, *ground.slope, x, y, ground.plane_at(x, y))
        self._ring.write(*self._parts)

    def watch(self, tick: Tick) -> bool:
        """Show a tick and fulfil wishes, now and then; return whether the run continues."""
        now, self._time = perf_counter(), tick.sample.time
        if now - self._asked_at > _WISHES_S:
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
        super().__init__(config, session.controller, session.recorder, link, **started)
        for part in (session, *(earlier for earlier, _ in session.earlier)):
            part.watch = self.watch
        self._begin_to_pace()

    @property
    def _halted(self) -> bool:
        return self._pace.paused

    def watch(self, tick: Tick) -> bool:
        """Show a tick, fulfil wishes, and keep pace with the clock; return whether the run continues."""
        super().watch(tick)
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
            sleep(_WISHES_S)
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
                    sleep(_WISHES_S)
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
        at, values = max(self._time, self._session.ticks.period), {wish.key: wish.value}
        if self._changes and at - self._changes[-1].at_s < _SAME_CHANGE_S:
            last = self._changes.pop()
            at, values = last.at_s, {**last.set, **values}
        self._changes.append(Change(at_s=at, set=values))

    def _save(self) -> None:
        """Save what was recorded until now as a run folder."""
        session = self._session
        if session.recorder.ticks == 0:
            return
        period = session.ticks.period
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
    with ExitStack() as shown:

        def prepared(announce: Callable[[str], None]) -> Session:
            session = prepare(config, notify=announce)
            assert isinstance(session, ClosedLoopSession)
            shown.callback(ShownRun(config, session, link).close)
            return session

        return run_session(config, prepared, out, notify=notify, progress=progress)
