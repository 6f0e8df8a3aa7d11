"""Section ``world`` of a config: the kind of ground and where the robot starts on it.

A name that contains a size stands for a kind, and other keys may follow it: ``world: stairs_4cm``,
``world: {kind: blocks_50mm, size_m: 0.2}``.
"""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from typing_extensions import Self

from lgmpc.settings import Finite, Problem, Words, key, problem, problems
from lgmpc.world.kinds import (
    MOST_BOXES,
    OF_WORLD,
    Blocks,
    Gaps,
    GroundPart,
    GroundSettings,
    Heights,
    Hills,
    Laid,
    Patches,
    Ramp,
    Stairs,
    Stones,
    Tiled,
)
from lgmpc.world.layout import Layout
from lgmpc.world.surfaces import Plane
from lgmpc.world.world import World


class FloorSettings(GroundSettings):
    """A level floor."""

    kind: Literal["floor"] = key("floor", "A level floor.")


class SlopeSettings(GroundSettings):
    """An inclined plane."""

    kind: Literal["slope"] = key("slope", "An inclined plane.")
    angle_deg: Annotated[Finite, Field(ge=0.0, le=45.0)] = key(10.0, "Inclination, degrees, at most 45.")
    uphill_deg: Finite = key(
        0.0,
        "Direction in which it rises, from the world's x axis, degrees: 0 ahead of a robot that starts at"
        " yaw 0, 90 to its left, 180 behind it.",
    )


AnyPart = Annotated[
    Union[Ramp, Stairs, Blocks, Stones, Gaps, Patches, Hills, Heights],  # noqa: UP007
    Field(discriminator="kind"),
    BeforeValidator(lambda value: _by_name(value)),
]


class Course(Laid):
    """Parts one behind the other."""

    kind: Literal["course"] = key("course", "Parts one behind the other.")
    parts: tuple[AnyPart, ...] = Field(
        min_length=1, max_length=50, description="The parts, each from the end of the one before along the x axis."
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        found = [
            Problem(f"parts.{i}.{key}", getattr(part, key), f"no such key of a part: world.{key} is that of all parts")
            for i, part in enumerate(self.parts)
            for key in sorted(OF_WORLD & part.model_fields_set)
            if getattr(part, key) != type(part).model_fields[key].default
        ]
        if found:
            raise problems(found)
        tiled = [math.prod(part.counts(self.width_m)) for part in self.parts if isinstance(part, Tiled)]
        if sum(tiled) > MOST_BOXES:
            raise problem(f"parts of at most {MOST_BOXES} squares in all", "parts", Words(f"{sum(tiled)} squares"))
        return self


_NAMES: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    "slope": ("slope", "angle_deg", {}),
    "slope_down": ("slope", "angle_deg", {"uphill_deg": 180.0}),
    "slope_across": ("slope", "angle_deg", {"uphill_deg": 90.0}),
    "ramp": ("ramp", "angle_deg", {"back": True}),
    "step": ("stairs", "rise_m", {"steps": 1}),
    "drop": ("stairs", "-rise_m", {"steps": 1}),
    "stairs": ("stairs", "rise_m", {}),
    "stairs_down": ("stairs", "-rise_m", {}),
    "stairs_over": ("stairs", "rise_m", {"back": True}),
    "blocks": ("blocks", "max_height_m", {}),
    "stones": ("stones", "size_m", {}),
    "hills": ("hills", "max_height_m", {}),
    "gaps": ("gaps", "gap_m", {}),
    "hole": ("gaps", "depth_m", {"count": 1, "gap_m": 0.5}),
}
"""Named worlds, each with a size in its name: the kind, the key of the size (with its sign), other keys."""
_UNITS = {"deg": 1.0, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
_NAMED = re.compile(rf"({'|'.join(_NAMES)})_(\d+(?:\.\d+)?)({'|'.join(_UNITS)})")


def named_world(name: str) -> dict[str, Any]:
    """Return the section that a name stands for, such as ``stairs_4cm`` or ``slope_down_15deg``.

    Any other name is that of a kind.
    """
    if name == "ice":
        return {"kind": "patches", "share": 1.0}
    found = _NAMED.fullmatch(name)
    if found is None:
        return {"kind": name}
    kind, key, others = _NAMES[found[1]]
    size = float(found[2]) * _UNITS[found[3]]
    if (found[3] == "deg") != key.endswith("_deg"):
        return {"kind": name}
    return {"kind": kind, key.lstrip("-"): float(f"{-size if key.startswith('-') else size:.9g}"), **others}


def _by_name(value: Any) -> Any:
    """Return a kind given by its name alone, ``world: slope``, or kinds in a list, as a section; without: a floor."""
    if isinstance(value, str):
        return named_world(value)
    if isinstance(value, (list, tuple)):
        return {"kind": "course", "parts": list(value)}
    if not isinstance(value, Mapping):
        return value
    kind = value.get("kind", "floor")
    return {
        **(named_world(kind) if isinstance(kind, str) else {"kind": kind}),
        **{key: each for key, each in value.items() if key != "kind"},
    }


AnyWorld = Union[  # noqa: UP007
    FloorSettings, SlopeSettings, Ramp, Stairs, Blocks, Stones, Gaps, Patches, Hills, Heights, Course
]
WorldSettings = Annotated[AnyWorld, Field(discriminator="kind"), BeforeValidator(_by_name)]
"""Section ``world``, told apart by ``kind``; the kind's name alone stands for its defaults."""


def make_world(settings: AnyWorld, friction: float, seed: int = 0) -> World:
    """Return the world of the settings.

    Args:
        settings: section ``world``.
        friction: Coulomb coefficient of the ground, where a part has none of its own.
        seed: of what is random, unless the settings have one.
    """
    start, yaw = settings.start_m, math.radians(settings.start_yaw_deg)
    if isinstance(settings, FloorSettings):
        plane = Plane((0.0, 0.0, settings.height_m), coefficient=friction)
        return World((plane,), start, yaw, settings.soft)
    if isinstance(settings, SlopeSettings):
        tilt, uphill = math.radians(settings.angle_deg), math.radians(settings.uphill_deg)
        normal = (-math.sin(tilt) * math.cos(uphill), -math.sin(tilt) * math.sin(uphill), math.cos(tilt))
        plane = Plane((0.0, 0.0, settings.height_m), normal, friction)
        return World((plane,), start, yaw, settings.soft)
    rng = np.random.default_rng((seed if settings.seed is None else settings.seed, _STREAM))
    layout = Layout(settings.ahead_m, settings.height_m, settings.width_m, friction, rng)
    parts: tuple[GroundPart, ...] = settings.parts if isinstance(settings, Course) else (settings,)
    for i, part in enumerate(parts):
        layout.section = f"world.parts.{i}" if isinstance(settings, Course) else "world"
        part.lay(layout, friction if part.friction is None else part.friction)
    return World(layout.surfaces(), start, yaw, settings.soft, layout.largest_step)


_STREAM = 4
"""Number of the world's random stream among those of a run, which are seeded by (seed, number)."""
