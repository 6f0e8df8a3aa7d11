"""Parts of the ground that a config can name: ramps, stairs, blocks, stones, gaps, patches.

A new one is a class with a ``kind``, its sizes, and :meth:`Part.lay`; a line in ``AnyPart`` makes it a world, and a
part of a course.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from typing_extensions import Self

from lgmpc.errors import InputError
from lgmpc.settings import Count, Finite, Fraction, Friction, Positive, Settings, Vector2, Words, key, problem
from lgmpc.typing import Array
from lgmpc.world.heights import HeightField, read_heights
from lgmpc.world.layout import Layout, incline
from lgmpc.world.surfaces import Softness

Place = Annotated[Finite, Field(ge=-1e4, le=1e4)]
"""m."""
Size = Annotated[Positive, Field(ge=0.005, le=100.0)]
"""m."""
Rise = Annotated[Finite, Field(ge=-2.0, le=2.0)]
"""m."""
Angle = Annotated[Finite, Field(ge=-45.0, le=45.0)]
"""Degrees."""

MOST_BOXES = 5000
"""Of a world."""
MOST_POINTS = 1_000_000
"""Of random hills."""
_BELOW_PATCHES_M = 0.05
"""Depth of the ground around patches: two surfaces at one height would both carry a foot."""


class GroundSettings(Settings):
    """Settings of every kind of ground."""

    height_m: Place = key(0.0, "Height of the ground at the world's origin, m.")
    start_m: Vector2 = key((0.0, 0.0), "Where the robot starts, [x, y], m.")
    start_yaw_deg: Finite = key(0.0, "Heading of the robot at the start, degrees.")
    soft: Softness | None = key(None, "Ground that gives way, the same in both plants; null: hard ground.")


OF_WORLD = frozenset(GroundSettings.model_fields) | {"ahead_m", "width_m", "seed"}
"""Keys of a whole world, that a part of a course does not have."""


class Laid(GroundSettings):
    """Settings of ground that is laid out along the x axis, with a level area at the origin to start from."""

    ahead_m: Annotated[Finite, Field(ge=0.0, le=100.0)] = key(1.0, "Level ground ahead of the world's origin, m.")
    width_m: Size = key(2.0, "Width of the parts that are not level, m.")
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] | None = key(
        None, "Seed of what is random in the ground; null: that of the run."
    )


class GroundPart(Laid):
    """One part of the ground."""

    friction: Friction | None = key(None, "Coulomb coefficient of this part; null: plant.friction.")

    @abstractmethod
    def lay(self, layout: Layout, friction: float) -> None:
        """Add the part at the end of a layout."""


class Ramp(GroundPart):
    """An inclined plane between two level ones."""

    kind: Literal["ramp"] = key("ramp", "An inclined plane between two level ones.")
    angle_deg: Angle = key(10.0, "Inclination, degrees; negative: downhill.")
    length_m: Size = key(1.5, "Horizontal length, m.")
    landing_m: Size = key(1.0, "Length of the level ground behind it, m.")
    back: bool = key(False, "Whether a second ramp leads back to the first level.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add ramp and landing."""
        for sign in (1.0, -1.0)[: 1 + self.back]:
            angle = sign * math.radians(self.angle_deg)
            rise = self.length_m * math.tan(angle)
            layout.add(incline(layout, self.length_m, angle, friction))
            layout.advance(self.length_m, rise)
            layout.slab(layout.x, layout.x + self.landing_m, layout.level, friction=friction)
            layout.advance(self.landing_m)


class Stairs(GroundPart):
    """Steps of equal height; a single one is a step, or a drop."""

    kind: Literal["stairs"] = key("stairs", "Steps of equal height.")
    rise_m: Rise = key(0.05, "Height of a step, m; negative: downstairs.")
    tread_m: Size = key(0.25, "Depth of a step, m.")
    steps: Annotated[Count, Field(le=200)] = key(5, "Number of steps.")
    landing_m: Size = key(1.0, "Length of the level ground behind the last step, m.")
    back: bool = key(False, "Whether as many steps lead back to the first level.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add steps, each as deep as all that are above it, and landing."""
        layout.step(self.rise_m, "rise_m")
        length = self.steps * self.tread_m
        for rise in (self.rise_m, -self.rise_m)[: 1 + self.back]:
            begin, level = layout.x, layout.level
            end = begin + length + self.landing_m - self.tread_m
            for k in range(1, self.steps + 1):
                first, last = begin + (k - 1) * self.tread_m, begin + k * self.tread_m
                if k == self.steps:
                    last = end
                # A flight has no seams: upstairs a step goes on below those above it, downstairs it begins below them.
                outline = (first, end) if rise > 0.0 else (begin, last)
                layout.slab(*outline, level + k * rise, friction=friction)
            layout.advance(end - begin, self.steps * rise)


class Tiled(GroundPart):
    """A part of squares in a grid."""

    size_m: Size = key(0.12, "Side of a block, a stone or a patch, m.")
    length_m: Size = key(3.0, "Length of the whole, m; rounded down to whole squares.")

    @property
    def pitch(self) -> float:
        """Distance of the squares, m."""
        return self.size_m

    def counts(self, width: float) -> tuple[int, int]:
        """Return the number of squares along and across ground of a width, m."""
        along, across = (max(1, math.floor(each / self.pitch + 1e-9)) for each in (self.length_m, width))
        return along, across

    @model_validator(mode="after")
    def _limit_boxes(self) -> Self:
        if math.prod(self.counts(self.width_m)) > MOST_BOXES:
            raise problem(f"larger squares: at most {MOST_BOXES} in length_m and width_m", "size_m", self.size_m)
        return self

    def _tiles(self, layout: Layout) -> Iterator[tuple[float, float]]:
        """Yield the middles of the squares, (x, y), m; afterwards the layout ends behind them."""
        (along, across), pitch, begin = self.counts(layout.width), self.pitch, layout.x
        for i in range(along):
            for j in range(across):
                yield begin + (i + 0.5) * pitch, (j + 0.5 - 0.5 * across) * pitch
        layout.advance(along * pitch)

    def _tile(self, layout: Layout, x: float, y: float, top: float, friction: float) -> None:
        half = 0.5 * self.size_m
        layout.slab(x - half, x + half, top, right=y - half, left=y + half, friction=friction)


class Blocks(Tiled):
    """Square blocks of random heights side by side."""

    kind: Literal["blocks"] = key("blocks", "Square blocks of random heights side by side.")
    max_height_m: Annotated[Positive, Field(le=2.0)] = key(0.04, "Of the highest block, m.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add the blocks."""
        layout.step(self.max_height_m, "max_height_m")
        for x, y in self._tiles(layout):
            self._tile(layout, x, y, layout.level + layout.rng.uniform(0.0, self.max_height_m), friction)


class Stones(Tiled):
    """Stepping stones."""

    kind: Literal["stones"] = key("stones", "Stepping stones.")
    gap_m: Size = key(0.08, "Mean distance between stones, m.")
    shift_m: Annotated[Finite, Field(ge=0.0, le=1.0)] = key(
        0.0, "Largest displacement of a stone from its place in the grid, each way, m."
    )
    uneven_m: Annotated[Finite, Field(ge=0.0, le=1.0)] = key(
        0.0, "Largest difference of the height of a stone from that of the ground before, m."
    )
    depth_m: Size = key(0.3, "Depth of the ground between them, m.")

    @property
    def pitch(self) -> float:
        """Distance of the stones' middles, m."""
        return self.size_m + self.gap_m

    def lay(self, layout: Layout, friction: float) -> None:
        """Add the stones and what is between them."""
        layout.dig(layout.level - self.depth_m)
        layout.step(self.uneven_m, "uneven_m")
        for x, y in self._tiles(layout):
            shift, rise = layout.rng.uniform(-self.shift_m, self.shift_m, 2), layout.rng.uniform(-1.0, 1.0)
            self._tile(layout, x + shift[0], y + shift[1], layout.level + self.uneven_m * rise, friction)

    @model_validator(mode="after")
    def _stay_apart(self) -> Self:
        if self.shift_m > 0.5 * self.gap_m:
            raise problem(f"at most half of gap_m, {0.5 * self.gap_m:g}", "shift_m", self.shift_m)
        return self


class Gaps(GroundPart):
    """Ditches across the way."""

    kind: Literal["gaps"] = key("gaps", "Ditches across the way.")
    gap_m: Size = key(0.08, "Width of a ditch, m.")
    depth_m: Size = key(0.3, "Depth of a ditch, m.")
    count: Annotated[Count, Field(le=200)] = key(3, "Number of ditches.")
    spacing_m: Size = key(0.4, "Level ground behind each ditch, m.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add ditches and what is between them."""
        layout.dig(layout.level - self.depth_m)
        for _ in range(self.count):
            layout.advance(self.gap_m)
            layout.slab(layout.x, layout.x + self.spacing_m, layout.level, friction=friction)
            layout.advance(self.spacing_m)


class Patches(Tiled):
    """Level ground with slippery patches."""

    kind: Literal["patches"] = key("patches", "Level ground with slippery patches.")
    patch_friction: Friction = key(0.15, "Coulomb coefficient of the patches.")
    size_m: Size = key(0.3, "Side of a patch, m.")
    share: Fraction = key(0.4, "Share of the ground that is slippery; 1: all of it.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add the patches."""
        layout.dig(layout.level - _BELOW_PATCHES_M)
        for x, y in self._tiles(layout):
            slippery = layout.rng.uniform() < self.share
            self._tile(layout, x, y, layout.level, self.patch_friction if slippery else friction)


class Hills(GroundPart):
    """Smooth random hills, level at both ends."""

    kind: Literal["hills"] = key("hills", "Smooth random hills, level at both ends.")
    max_height_m: Annotated[Positive, Field(le=5.0)] = key(0.1, "Of the highest hill, m.")
    wavelength_m: Size = key(0.6, "Distance of hills, m.")
    cell_m: Size = key(0.03, "Distance of the points of the height field, m.")
    length_m: Size = key(3.0, "Length of the whole, m.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add the hills."""
        from scipy.ndimage import gaussian_filter  # imported here, because it takes half a second

        columns, rows = (max(2, round(each / self.cell_m) + 1) for each in (self.length_m, layout.width))
        noise = gaussian_filter(layout.rng.normal(size=(rows, columns)), self.wavelength_m / (4.0 * self.cell_m))
        noise = (noise - noise.min()) / np.ptp(noise)
        along = np.linspace(0.0, self.length_m, columns)
        ends = np.clip(2.0 * np.minimum(along, self.length_m - along) / self.wavelength_m, 0.0, 1.0)
        _add_field(layout, self.max_height_m * noise * ends, self.cell_m, friction)

    @model_validator(mode="after")
    def _limit_points(self) -> Self:
        if self.length_m * self.width_m / self.cell_m**2 > MOST_POINTS:
            raise problem(f"larger cells: at most {MOST_POINTS} in length_m and width_m", "cell_m", self.cell_m)
        return self


class Heights(GroundPart):
    """A height field of one's own."""

    kind: Literal["heights"] = key("heights", "A height field of one's own.")
    heights_m: tuple[tuple[Finite, ...], ...] | None = key(
        None, "Rows of heights above the ground before, the first row on the right, m."
    )
    file: str | None = key(None, "Or a picture (.png), its upper edge on the left, or an array (.npy). Runs store it.")
    white_m: Positive | None = key(None, "Height of white in a picture, m; black is 0.")
    cell_m: Size = Field(description="Distance of the heights along x and y, m.")

    def lay(self, layout: Layout, friction: float) -> None:
        """Add the field."""
        if self.file is not None:
            heights = read_heights(self.file, f"{layout.section}.file", self.white_m)
        else:
            heights = np.array(self.heights_m, dtype=np.float64)
        try:
            _add_field(layout, heights, self.cell_m, friction)
        except InputError as error:
            key = "heights_m" if self.file is None else "file"
            raise InputError(f"{layout.section}.{key}", error.got, error.expected) from error

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.heights_m is None) == (self.file is None):
            raise problem("either heights_m or file", "file", self.file)
        lengths = sorted({len(row) for row in self.heights_m or ()})
        if len(lengths) > 1:
            raise problem("rows of one length", "heights_m", Words(f"rows of {lengths[0]} and of {lengths[-1]}"))
        return self


def _add_field(layout: Layout, heights: Array, cell: float, friction: float) -> None:
    """Add a height field, its middle row on the x axis, and the ground around it."""
    field = HeightField(layout.level + heights, cell, (layout.x, -0.5 * cell * (np.shape(heights)[0] - 1)), friction)
    layout.dig(float(field.heights.min()) - _BELOW_PATCHES_M)
    layout.add(field)
    layout.advance(cell * (field.heights.shape[1] - 1))
