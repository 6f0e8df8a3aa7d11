"""Section ``world`` of a config: the kind of ground and where the robot starts on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, Field

from lgmpc.settings import Finite, Settings, Vector2
from lgmpc.world.surfaces import Plane
from lgmpc.world.world import World

__all__ = ["FloorSettings", "SlopeSettings", "WorldSettings", "make_world"]

_FURTHEST = 1e4  # m
Place = Annotated[Finite, Field(ge=-_FURTHEST, le=_FURTHEST)]


class _GroundSettings(Settings):
    """Settings of every kind of ground."""

    height_m: Place = Field(default=0.0, description="Height of the ground at the world's origin, m.")
    start_m: Vector2 = Field(default=(0.0, 0.0), description="Where the robot starts, [x, y], m.")
    start_yaw_deg: Finite = Field(default=0.0, description="Heading of the robot at the start, degrees.")

    def _world(self, plane: Plane) -> World:
        return World((plane,), self.start_m, math.radians(self.start_yaw_deg))


class FloorSettings(_GroundSettings):
    """A level floor."""

    kind: Literal["floor"] = Field(default="floor", description="A level floor.")

    def make(self, friction: float) -> World:
        """Return the world with this coefficient of friction."""
        return self._world(Plane((0.0, 0.0, self.height_m), coefficient=friction))


class SlopeSettings(_GroundSettings):
    """An inclined plane."""

    kind: Literal["slope"] = Field(default="slope", description="An inclined plane.")
    angle_deg: Annotated[Finite, Field(ge=0.0, le=45.0)] = Field(
        default=10.0, description="Inclination, degrees, at most 45."
    )
    uphill_deg: Finite = Field(
        default=0.0,
        description="Direction in which it rises, from the world's x axis, degrees: 0 ahead of a robot that starts at"
        " yaw 0, 90 to its left, 180 behind it.",
    )

    def make(self, friction: float) -> World:
        """Return the world with this coefficient of friction."""
        tilt, uphill = math.radians(self.angle_deg), math.radians(self.uphill_deg)
        normal = (-math.sin(tilt) * math.cos(uphill), -math.sin(tilt) * math.sin(uphill), math.cos(tilt))
        return self._world(Plane((0.0, 0.0, self.height_m), normal, friction))


def _by_name(value: Any) -> Any:
    """Return a kind given by its name alone, ``world: slope``, as a section; a section without a kind is a floor."""
    if isinstance(value, str):
        return {"kind": value}
    return {"kind": "floor", **value} if isinstance(value, Mapping) else value


WorldSettings = Annotated[
    Union[FloorSettings, SlopeSettings],  # noqa: UP007
    Field(discriminator="kind"),
    BeforeValidator(_by_name),
]
"""Section ``world``, told apart by ``kind``; the kind's name alone stands for its defaults."""


def make_world(settings: FloorSettings | SlopeSettings, friction: float) -> World:
    """Return the world of the settings, its ground with this Coulomb coefficient."""
    return settings.make(friction)
