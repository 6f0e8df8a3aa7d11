"""Parts of the ground laid out one behind the other along the x axis."""

import math
from dataclasses import dataclass, field

import numpy as np

from lgmpc.world.boxes import Box
from lgmpc.world.heights import HeightField
from lgmpc.world.surfaces import Plane

_THICKNESS_M = 0.5
"""Of the ground below its lowest level."""
_AROUND_M = 10.0
"""Length of level ground behind the start and beyond the end, where they are not on the lowest level."""


@dataclass
class Layout:
    """The ground so far; parts read and advance ``x`` and ``level``.

    Attributes:
        x: end of the last part, m.
        level: height of the ground there, m.
        width: of the parts, m.
        friction: of the ground where a part has none of its own.
        rng: for what is random.
        largest_step: so far, m, and the key that sets it.
        section: of the part that is being laid out; the beginning of its keys.
    """

    x: float
    level: float
    width: float
    friction: float
    rng: np.random.Generator
    largest_step: tuple[float, str] = (0.0, "")
    section: str = "world"
    _slabs: list[tuple[tuple[float, ...], float]] = field(default_factory=list)
    _others: list[Box | HeightField] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._first = (self.x, self.level)
        self._lowest = self.level

    def slab(
        self,
        begin: float,
        end: float,
        top: float,
        *,
        right: float | None = None,
        left: float | None = None,
        friction: float | None = None,
    ) -> None:
        """Add level ground between two x, and of the whole width unless given by two y, at height ``top``, m."""
        half = 0.5 * self.width
        outline = (begin, end, -half if right is None else right, half if left is None else left, top)
        self._slabs.append((outline, self.friction if friction is None else friction))
        self._lowest = min(self._lowest, top)

    def add(self, surface: Box | HeightField) -> None:
        """Add any surface, such as an inclined box."""
        self._others.append(surface)

    def dig(self, bottom: float) -> None:
        """Lower the ground around all parts to height ``bottom``, m, or leave it below."""
        self._lowest = min(self._lowest, bottom)

    def step(self, height: float, key: str) -> None:
        """Report a step of a height, m, that a robot has to climb or descend, and the key that sets it."""
        self.largest_step = max(self.largest_step, (abs(height), f"{self.section}.{key}"))

    def advance(self, length: float, rise: float = 0.0) -> None:
        """Move the end of the ground."""
        self.x += length
        self.level += rise

    def surfaces(self) -> tuple[Plane | Box | HeightField, ...]:
        """Return a plane at the lowest level, and what stands on it."""
        for begin, end, level in ((self._first[0] - _AROUND_M, *self._first), (self.x, self.x + _AROUND_M, self.level)):
            if level > self._lowest:
                self.slab(begin, end, level)
        bottom = self._lowest - _THICKNESS_M
        boxes = [
            Box(
                (0.5 * (begin + end), 0.5 * (right + left), 0.5 * (bottom + top)),
                (0.5 * (end - begin), 0.5 * (left - right), 0.5 * (top - bottom)),
                coefficient=friction,
            )
            for (begin, end, right, left, top), friction in self._slabs
            if top > self._lowest
        ]
        return (Plane((0.0, 0.0, self._lowest), coefficient=self.friction), *boxes, *self._others)


def incline(layout: Layout, length: float, angle: float, friction: float) -> Box:
    """Return a box whose top rises by ``angle``, rad, over a horizontal ``length``, m, from the end of the layout."""
    slant, depth = length / math.cos(angle), _THICKNESS_M
    middle = (layout.x + 0.5 * length, layout.level + 0.5 * length * math.tan(angle))
    center = (middle[0] + 0.5 * depth * math.sin(angle), 0.0, middle[1] - 0.5 * depth * math.cos(angle))
    return Box(center, (0.5 * slant, 0.5 * layout.width, 0.5 * depth), (0.0, -angle, 0.0), friction)
