"""Messages between the page and the run, besides the rows of the ring.

The page also sends changes of the motion command, as entries of a config's ``commands`` whose time does not matter.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from lgmpc.config.schema import Config
from lgmpc.locomotion.command import CommandEntry
from lgmpc.typing import Array

STILL = CommandEntry(at_s=0.0, velocity_m_s=(0.0, 0.0, 0.0), yaw_rate_rad_s=0.0)
"""A wish for no velocity."""


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


OrderName = Literal["stop", "arm", "disarm", "lie"]


@dataclass(frozen=True)
class Order:
    """Orders of the person who watches the robot.

    Attributes:
        name: ``stop`` is the emergency stop, ``arm`` lets the robot stand and move, ``disarm`` damps the joints, and
            ``lie`` lies down; a robot at the end of a link also ends its run then.
    """

    name: OrderName


@dataclass(frozen=True)
class Tune:
    """Another value of a setting; the answer is its value as read from the running controller.

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
class Started:
    """A run begins, whose rows follow.

    Attributes:
        ring: name of the shared memory.
        config: the closed loop.
        gaits: names of gaits, by the number in pictures.
        maneuvers: names of planned motions.
        tunable: settings that can change, with their values now.
        deployed: whether the robot is at the end of a link.
    """

    ring: str
    config: Config
    gaits: tuple[str, ...] = ()
    maneuvers: tuple[str, ...] = ()
    tunable: dict[str, Any] = field(default_factory=dict)
    deployed: bool = False


@dataclass(frozen=True)
class Note:
    """A message for the user.

    Attributes:
        text: the message.
        error: whether something went wrong.
        over: whether the run is over: nothing moves until a restart.
    """

    text: str
    error: bool = False
    over: bool = False
