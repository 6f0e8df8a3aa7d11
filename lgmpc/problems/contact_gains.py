"""Gains that hold contacts in their places, by frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.settings import NonNegative
from lgmpc.typing import Array

__all__ = ["ContactGains", "gains_of_contacts"]

ContactGains = Annotated[
    dict[str, tuple[NonNegative, NonNegative]],
    Field(
        description="Baumgarte's [stiffness, damping] of single contacts, {frame: [1/s2, 1/s]}; those of others follow "
        "from the interval's length."
    ),
]


def gains_of_contacts(robot: Robot, given: Mapping[str, tuple[float, float]], default: Array) -> Array:
    """Return (n, 2 nc) stiffness and damping of each contact of a robot.

    Args:
        robot: with contact frames.
        given: [stiffness, damping] by frame.
        default: (n, 2) of the other contacts, at each of n nodes.

    Raises:
        InputError: a frame that is no contact.
    """
    gains = np.tile(default, (1, robot.nc))
    for name, pair in given.items():
        if name not in robot.contact_frames:
            raise InputError("contact_gains", name, f"a contact frame of {robot.name}", robot.contact_frames)
        start = 2 * robot.contact_frames.index(name)
        gains[:, start : start + 2] = pair
    return gains
