"""The modes of a legged robot and the transitions between them: what it does now, and why it changes to something else.

Commands request one of three things (``stand``, ``lie``, ``damp``); which mode serves a request, and through which
modes the robot gets there, is decided here, by named transitions alone::

    damp -- re-arm --> lie -- rise --> rise -- risen --> stand <--> locomote, recover
                        ^                                  |
                        +------ lain -- sit <-- sit down --+      any mode -- give up, emergency stop --> damp
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

__all__ = ["TRANSITIONS", "Mode", "ModeMachine", "Situation", "Transition"]


class Mode(Enum):
    """What the robot does."""

    LIE = "lies on its belly and folds its legs"
    RISE = "raises itself on its four feet"
    STAND = "stands and keeps its balance"
    LOCOMOTE = "walks as commanded, or comes to a stop"
    RECOVER = "steps uncommanded: against a push, or because its feet are not where they belong"
    SIT = "lowers itself onto its belly"
    DAMP = "has no torque but the damping of its joints"

    __hash__ = object.__hash__  # members are unique: Enum's own hashes their names, in Python

    @property
    def upright(self) -> bool:
        """Whether the feet carry the robot at its commanded height."""
        return self is Mode.STAND or self is Mode.LOCOMOTE or self is Mode.RECOVER


_ARMED = frozenset(Mode) - {Mode.DAMP}


@dataclass(slots=True)
class Situation:
    """What transitions depend on, at one tick.

    Attributes:
        request: ``stand``, ``lie`` or ``damp``, as commanded.
        failure: why balancing is given up, in words; empty while it is not.
        rearmed: a damped robot lies still on its belly, and a command or the settings allow it to move again.
        folded: the legs are folded under the trunk.
        lifted: the motion up or down of mode rise or sit is over.
        moving: a velocity is commanded.
        stepping: a foot swings or is to lift off.
        reacting: the steps are uncommanded.
    """

    request: str = "stand"
    failure: str = ""
    rearmed: bool = False
    folded: bool = False
    lifted: bool = False
    moving: bool = False
    stepping: bool = False
    reacting: bool = False


@dataclass(frozen=True)
class Transition:
    """One way from some modes to another.

    Attributes:
        name: what happens.
        sources: modes that it leaves.
        target: mode that it leads to.
        condition: whether it takes place.
    """

    name: str
    sources: frozenset[Mode]
    target: Mode
    condition: Callable[[Situation], bool]


def _way(name: str, sources: frozenset[Mode], target: Mode, condition: Callable[[Situation], bool]) -> Transition:
    return Transition(name, sources, target, condition)


TRANSITIONS: tuple[Transition, ...] = (
    _way("emergency stop", _ARMED, Mode.DAMP, lambda s: s.request == "damp"),
    _way("give up", _ARMED, Mode.DAMP, lambda s: bool(s.failure)),
    _way("re-arm", frozenset({Mode.DAMP}), Mode.LIE, lambda s: s.rearmed and s.request != "damp"),
    _way("rise", frozenset({Mode.LIE}), Mode.RISE, lambda s: s.folded and s.request == "stand"),
    _way("risen", frozenset({Mode.RISE}), Mode.STAND, lambda s: s.lifted),
    _way("recover", frozenset({Mode.STAND, Mode.LOCOMOTE}), Mode.RECOVER, lambda s: s.stepping and s.reacting),
    _way("set off", frozenset({Mode.STAND}), Mode.LOCOMOTE, lambda s: s.stepping),
    _way("walk on", frozenset({Mode.RECOVER}), Mode.LOCOMOTE, lambda s: s.stepping and s.moving),
    _way("halt", frozenset({Mode.LOCOMOTE}), Mode.STAND, lambda s: not s.stepping),
    _way("recovered", frozenset({Mode.RECOVER}), Mode.STAND, lambda s: not s.stepping),
    _way("sit down", frozenset({Mode.STAND}), Mode.SIT, lambda s: s.request == "lie" and not s.moving),
    _way("lain", frozenset({Mode.SIT}), Mode.LIE, lambda s: s.lifted),
)
"""In order of precedence."""


class ModeMachine:
    """The present mode; moves on by :data:`TRANSITIONS`, at most one a tick.

    Attributes:
        mode: the present one.
        last: the last transition; None before the first.
    """

    def __init__(self) -> None:
        self.mode = Mode.DAMP
        self.last: Transition | None = None

    def begin(self, mode: Mode) -> None:
        """Begin in ``mode``, whatever was before."""
        self.mode, self.last = mode, None

    def update(self, situation: Situation) -> Transition | None:
        """Return the transition that takes place; :attr:`mode` is its target then."""
        for transition in _WAYS[self.mode]:
            if transition.condition(situation):
                self.mode, self.last = transition.target, transition
                return transition
        return None


_WAYS = {mode: tuple(each for each in TRANSITIONS if mode in each.sources) for mode in Mode}
