"""What the page asks of the run, and what the run tells the page, besides the rows of the ring."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lgmpc.config.schema import Config
from lgmpc.locomotion.command import CommandEntry
from lgmpc.typing import Array

__all__ = ["Drive", "Ended", "Note", "Opened", "Pace", "Pull", "Restart", "Save", "Started", "Tune", "Tuned"]


@dataclass(frozen=True)
class Drive:
    """A change of the motion command, from the next tick on.

    Attributes:
        entry: the quantities that change; its time does not matter.
    """

    entry: CommandEntry


@dataclass(frozen=True)
class Pull:
    """A spring between a point of a body and a point of the world.

    Attributes:
        joint: index of the joint that moves the body; 0 ends the pull.
        grip: (3,) point of the body, axes of the joint, m.
        target: (3,) point of the world, m.
    """

    joint: int
    grip: Array = field(default_factory=lambda: np.zeros(3))
    target: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Pace:
    """The passage of time.

    Attributes:
        speed: simulated over elapsed time.
        paused: whether time stands still.
        steps: ticks to advance by in a pause.
    """

    speed: float = 1.0
    paused: bool = False
    steps: int = 0


@dataclass(frozen=True)
class Tune:
    """Another value of a setting.

    Attributes:
        key: dotted key of the config.
        value: a number, or numbers.
    """

    key: str
    value: Any


@dataclass(frozen=True)
class Restart:
    """A new run.

    Attributes:
        world: name of the kind of ground; empty for the present one.
    """

    world: str = ""


@dataclass(frozen=True)
class Save:
    """Save what was recorded until now as a run folder."""


@dataclass(frozen=True)
class Opened:
    """The page is served.

    Attributes:
        url: its address.
        error: what prevented it, if anything did.
    """

    url: str = ""
    error: str = ""


@dataclass(frozen=True)
class Started:
    """A run begins, whose rows follow.

    Attributes:
        ring: name of the shared memory.
        config: the closed loop.
        gaits: names of gaits, by the number in pictures.
        maneuvers: names of planned motions.
        tunable: settings that can change, with their values now; empty if nothing can be asked for.
    """

    ring: str
    config: Config
    gaits: tuple[str, ...] = ()
    maneuvers: tuple[str, ...] = ()
    tunable: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuned:
    """The value of a setting, as read from the running controller.

    Attributes:
        key: of the config.
        value: as it is now.
    """

    key: str
    value: Any


@dataclass(frozen=True)
class Note:
    """A message for the user.

    Attributes:
        text: the message.
        error: whether something went wrong.
    """

    text: str
    error: bool = False


@dataclass(frozen=True)
class Ended:
    """The run is over; nothing moves until a restart.

    Attributes:
        reason: why, such as the controller's exception.
        error: whether it was one.
    """

    reason: str
    error: bool = False
