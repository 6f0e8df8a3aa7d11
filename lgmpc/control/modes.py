"""The modes of a legged robot and the transitions between them, as a state machine.

Commands request one of three modes (``stand``, ``lie``, ``damp``); the sequence of modes that leads there is determined
here by named transitions::

    damp -- re-arm --> lie -- rise --> rise -- risen --> stand <--> locomote, recover -- sink --> sit
                        ^                                  |
                        +------ lain -- sit <-- sit down --+      any mode -- give up, emergency stop --> damp

    stand -- take off, fall --> maneuver <-- turn over -- damp            maneuver -- performed --> stand

Their conditions are evaluated by :class:`FallMonitor` (tilt, height, contacts, tracking, solver failures) and
:class:`RestMonitor` (when a damped robot may move again).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal

from pydantic import Field

from lgmpc.control.lying import LyingSettings
from lgmpc.settings import Fraction, Positive, Settings, key
from lgmpc.typing import Array

_LOST_S = 0.03
"""s without contact of any foot after which a standing robot falls."""

_FREE_M_S2 = 8.0
"""Least acceleration downwards of a robot that falls freely."""

_LEVEL, _HIGH_SHARE = math.cos(math.radians(20.0)), 0.85
"""Least cosine of the tilt, and of the height of standing, of a robot that falls onto its feet and not from them."""

_FASTEST_M_S = 1.0
"""Horizontal speed from which it does not land on its feet."""


class FallSettings(Settings):
    """Limits beyond which a robot is damped: its joints have no torque but damping."""

    tilt_deg: Annotated[Positive, Field(le=180.0)] = key(60.0, "Tilt of the base at which joints are damped, degrees.")
    height_share: Fraction = key(0.5, "Least height of the centre of mass above the feet, as a share of standing's.")
    low_s: Positive = key(0.1, "Longest time below that height, s.")
    height_error_share: Positive = key(0.4, "Largest error of the height, as a share of the height of standing.")
    tilt_error_deg: Positive = key(40.0, "Largest tilt error, degrees.")
    tracking_s: Positive = key(0.2, "Longest time with larger errors of height or tilt, s.")
    unsupported_s: Positive = key(0.25, "Longest time without measured contact of any foot, s.")
    failing_s: Positive = key(0.1, "Longest time without a solution of the whole-body controller, s.")


class ModeSettings(Settings):
    """Lying, rising, fall detection and recovery of a robot."""

    lying: LyingSettings = key(LyingSettings(), "Lying on the belly, rising and lying down.")
    fall: FallSettings = key(FallSettings(), "Fall detection.")
    rearm: Literal["on_command", "automatic"] = key(
        "on_command",
        "Condition for a damped robot that lies still on its belly to move again: on_command (the commanded"
        " mode has changed since it was damped), or automatic.",
    )
    lie_still_s: Positive = key(0.3, "Time for which it must lie still, s.")
    displaced_m: Positive = key(0.05, "Distance from its place beyond which a foot of a robot at rest steps back, m.")
    displaced_s: Positive = key(0.3, "Time for which it stands there before, s.")


class Mode(Enum):
    """Mode of a legged robot.

    Attributes:
        upright: whether the feet carry the robot at its commanded height.
    """

    LIE = "lies on its belly and folds its legs"
    RISE = "raises itself on its four feet"
    STAND = "stands and keeps its balance"
    LOCOMOTE = "walks as commanded, or comes to a stop"
    RECOVER = "steps uncommanded: against a push, or because its feet are not where they belong"
    SIT = "lowers itself onto its belly"
    DAMP = "has no torque but the damping of its joints"
    MANEUVER = "performs a planned motion"

    __hash__ = object.__hash__  # members are unique: Enum's own hashes their names, in Python

    def __init__(self, description: str) -> None:
        self.upright = self.name in ("STAND", "LOCOMOTE", "RECOVER")  # a property takes a microsecond a tick


_ARMED = frozenset(Mode) - {Mode.DAMP}


@dataclass(slots=True)
class TransitionInputs:
    """The conditions of transitions at one tick.

    Attributes:
        request: ``stand``, ``lie`` or ``damp``, as commanded.
        failure: reason of a detected fall in words; empty if there is none.
        rearmed: a damped robot lies still on its belly, and a command or the settings allow it to move again.
        folded: the legs are folded under the trunk.
        lifted: the motion up or down of mode rise or sit is over.
        moving: a velocity is commanded.
        stepping: a foot swings or is to lift off.
        reacting: the steps are uncommanded.
        maneuver: a planned motion is commanded that has not been performed.
        settled: the robot is at rest on feet that have carried for a while.
        performed: the planned motion is over.
        lame: a motor is dead without which the robot would topple before it came to rest.
        falling: the robot stood, and has lost the ground under all feet.
        dropped: the robot is damped and falls freely, and a planned motion in the air is commanded.
    """

    request: str = "stand"
    failure: str = ""
    rearmed: bool = False
    folded: bool = False
    lifted: bool = False
    moving: bool = False
    stepping: bool = False
    reacting: bool = False
    maneuver: bool = False
    settled: bool = False
    performed: bool = False
    lame: bool = False
    falling: bool = False
    dropped: bool = False


@dataclass(frozen=True)
class Transition:
    """A transition from some modes to another.

    Attributes:
        name: name of the transition.
        sources: modes that it leaves.
        target: mode that it leads to.
        condition: whether it takes place.
    """

    name: str
    sources: frozenset[Mode]
    target: Mode
    condition: Callable[[TransitionInputs], bool]


_way = Transition

TRANSITIONS: tuple[Transition, ...] = (
    _way("emergency stop", _ARMED, Mode.DAMP, lambda s: s.request == "damp"),
    _way("give up", _ARMED, Mode.DAMP, lambda s: bool(s.failure)),
    _way("sink", frozenset({Mode.STAND, Mode.LOCOMOTE, Mode.RECOVER}), Mode.SIT, lambda s: s.lame),
    _way("re-arm", frozenset({Mode.DAMP}), Mode.LIE, lambda s: s.rearmed and s.request != "damp"),
    _way("rise", frozenset({Mode.LIE}), Mode.RISE, lambda s: s.folded and s.request == "stand"),
    _way("risen", frozenset({Mode.RISE}), Mode.STAND, lambda s: s.lifted),
    _way("recover", frozenset({Mode.STAND, Mode.LOCOMOTE}), Mode.RECOVER, lambda s: s.stepping and s.reacting),
    _way("take off", frozenset({Mode.STAND}), Mode.MANEUVER, lambda s: s.maneuver and s.settled and not s.stepping),
    _way("fall", frozenset({Mode.STAND}), Mode.MANEUVER, lambda s: s.falling),
    _way("turn over", frozenset({Mode.DAMP}), Mode.MANEUVER, lambda s: s.dropped and s.request != "damp"),
    _way("performed", frozenset({Mode.MANEUVER}), Mode.STAND, lambda s: s.performed),
    _way("set off", frozenset({Mode.STAND}), Mode.LOCOMOTE, lambda s: s.stepping),
    _way("walk on", frozenset({Mode.RECOVER}), Mode.LOCOMOTE, lambda s: s.stepping and s.moving),
    _way("halt", frozenset({Mode.LOCOMOTE}), Mode.STAND, lambda s: not s.stepping),
    _way("recovered", frozenset({Mode.RECOVER}), Mode.STAND, lambda s: not s.stepping),
    _way("sit down", frozenset({Mode.STAND}), Mode.SIT, lambda s: s.request == "lie" and not s.moving),
    _way("lain", frozenset({Mode.SIT}), Mode.LIE, lambda s: s.lifted),
)
"""In order of precedence."""


class ModeMachine:
    """The present mode, changed by :data:`TRANSITIONS`, at most one per tick.

    Attributes:
        mode: the present one.
        last: the last transition; None before the first.
    """

    def __init__(self) -> None:
        self.begin(Mode.DAMP)

    def begin(self, mode: Mode) -> None:
        """Start in ``mode``, and discard the history."""
        self.mode = mode
        self.last: Transition | None = None
        self._ways = _WAYS[mode]

    def update(self, inputs: TransitionInputs) -> Transition | None:
        """Return the transition that takes place; :attr:`mode` is its target then."""
        for transition in self._ways:
            if transition.condition(inputs):
                self.mode, self.last = transition.target, transition
                self._ways = _WAYS[transition.target]
                return transition
        return None


_WAYS = {mode: tuple(each for each in TRANSITIONS if mode in each.sources) for mode in Mode}


class FallMonitor:
    """Compares measurements with the limits, each with its own time.

    Args:
        settings: see :class:`FallSettings`.
        height: of the centre of mass above the feet of the standing robot, m.
    """

    def __init__(self, settings: FallSettings, height: float) -> None:
        self._settings = s = settings
        self._tilt, self._tilted = math.cos(math.radians(s.tilt_deg)), math.cos(math.radians(s.tilt_error_deg))
        self._height = height
        self._lowest, self._error = s.height_share * height, s.height_error_share * height
        self.reset()

    def reset(self) -> None:
        """Discard all history."""
        self._low = self._off = self._unsupported = self._failing = math.inf  # since when, s
        self._dropped, self._climb = math.nan, math.nan

    def falls(self, time: float, upright: float, height: float, speed: float) -> bool:
        """Return whether a standing robot has lost the ground and may land on its feet: level, as high as it stands.

        Args:
            time: s.
            upright: cosine of the tilt.
            height: of the centre of mass above the ground as it was, m.
            speed: horizontal, m/s.
        """
        level = upright > _LEVEL and height > _HIGH_SHARE * self._height
        return level and speed < _FASTEST_M_S and time - self._unsupported >= _LOST_S

    def drops(self, time: float, climb: float) -> bool:
        """Return whether a robot, in any attitude, falls freely; call every tick.

        Args:
            time: s.
            climb: vertical speed of the centre of mass, m/s.
        """
        if not climb - self._climb <= -_FREE_M_S2 * (time - self._dropped):
            self._dropped, self._climb = time, climb
        return time - self._dropped >= _LOST_S

    def tilted(self, upright: float) -> str:
        """Return the reason why a robot with cosine ``upright`` of its tilt is damped; empty if it is not."""
        return f"tilted by more than {self._settings.tilt_deg:g} degrees" if upright < self._tilt else ""

    def update(self, t: float, upright: float, error: float, solved: bool) -> str:
        """Return the reason why a robot that rises, stands or lies down is damped; empty if it is not.

        Args:
            t: time, s.
            upright: cosine of the tilt.
            error: of the height of the centre of mass, m.
            solved: whether the whole-body controller had a solution at the last tick.
        """
        s = self._settings
        off = abs(error) > self._error or upright < self._tilted
        self._off = min(self._off, t) if off else math.inf
        self._failing = math.inf if solved else min(self._failing, t)
        if t - self._off >= s.tracking_s:
            return "height or tilt could not be held"
        if t - self._failing >= s.failing_s:
            return "the whole-body controller has no solution"
        return self.tilted(upright) if upright < self._tilt else ""

    def update_support(self, t: float, height: float, touching: bool) -> str:
        """Return the reason why a robot that stands or walks is damped; empty if it is not.

        Args:
            t: time, s.
            height: of the centre of mass above the feet, m.
            touching: whether any foot measures a contact, or none can.
        """
        s = self._settings
        self._low = min(self._low, t) if height < self._lowest else math.inf
        self._unsupported = math.inf if touching else min(self._unsupported, t)
        if t - self._low >= s.low_s:
            return f"lower than {100.0 * s.height_share:g} % of its height"
        if t - self._unsupported >= s.unsupported_s:
            return f"no foot on the ground for {s.unsupported_s:g} s"
        return ""


class RestMonitor:
    """The condition under which a damped robot may move again: it lies still on its belly, and is re-armed.

    Args:
        lie_still_s: time for which it must lie still, s.
        automatic: whether lying still suffices; otherwise the request has to change after the robot was damped.
    """

    _UPRIGHT = math.cos(math.radians(20.0))
    _SPEED = 0.1  # m/s and rad/s of the base
    _RATE = 1.0  # rad/s of all joints

    def __init__(self, lie_still_s: float, automatic: bool) -> None:
        self._rest, self._automatic = lie_still_s, automatic
        self._request, self._changed = "", automatic
        self._still = math.inf

    def begin(self, request: str) -> None:
        """Begin to watch a robot that was damped under ``request``."""
        self._request, self._changed = request, self._automatic
        self._still = math.inf

    def update(self, t: float, upright: float, v: Array, request: str) -> bool:
        """Return whether the robot may move again.

        Args:
            t: time, s.
            upright: cosine of the tilt.
            v: (nv,) velocity, the base's first.
            request: the commanded mode.
        """
        self._changed = self._changed or request != self._request
        base, joints = v[:6], v[6:]
        still = upright > self._UPRIGHT and base @ base < self._SPEED**2 and joints @ joints < self._RATE**2
        self._still = min(self._still, t) if still else math.inf
        return self._changed and t - self._still >= self._rest
