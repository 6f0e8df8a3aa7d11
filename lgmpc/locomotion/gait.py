"""Periodic gaits: durations of stance and swing in a cycle, and phase offsets of the feet.

A gait is a period, a duty factor (share of the cycle in stance) and for each foot the share of the cycle at which it
lifts off (Hildebrand, "Symmetrical gaits of horses", Science 150, 1965). Standing is the gait of duty 1:
its feet never lift off.
"""

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Annotated

from pydantic import Field, field_validator

from lgmpc.errors import InputError
from lgmpc.settings import Settings, key, problem
from lgmpc.typing import GRAVITY

_SLACK = 1e-9  # of a cycle


class Gait(Settings):
    """One periodic gait.

    Raises:
        InputError: a value out of its bounds, or no foot.
    """

    name: Annotated[str, Field(min_length=1)] = Field(description="Name by which commands choose the gait.")
    period_s: Annotated[float, Field(strict=True, ge=0.05, le=10.0)] = Field(description="Duration of a cycle, s.")
    duty: Annotated[float, Field(strict=True, gt=0.0, le=1.0)] = Field(
        description="Share of the cycle in which a foot is on the ground; 1: standing."
    )
    offsets: tuple[Annotated[float, Field(strict=True, ge=0.0, lt=1.0)], ...] = Field(
        description="For each foot, the share of the cycle at which it lifts off."
    )
    width: Annotated[float, Field(strict=True, gt=0.0, le=2.0)] = key(
        1.0,
        "Lateral distance of the footholds, as a share of that in the reference posture; gaits that stand"
        " on one side at a time require narrow steps.",
    )

    @field_validator("offsets")
    @classmethod
    def _name_feet(cls, offsets: tuple[float, ...]) -> tuple[float, ...]:
        if not offsets:
            raise problem("an offset for each foot: a gait without feet is none")
        return offsets

    @property
    def nc(self) -> int:
        """Number of feet."""
        return len(self.offsets)

    @cached_property
    def stands(self) -> bool:
        """Whether no foot ever lifts off."""
        return self.duty == 1.0

    @cached_property
    def stance_s(self) -> float:
        """Duration of the stance in each cycle, s; inf for standing."""
        return math.inf if self.stands else self.duty * self.period_s

    @cached_property
    def swing_s(self) -> float:
        """Duration of the swing in each cycle, s."""
        return (1.0 - self.duty) * self.period_s

    @cached_property
    def min_support(self) -> int:
        """Smallest number of feet on the ground in the cycle."""
        if self.stands:
            return self.nc
        swing = 1.0 - self.duty - _SLACK
        # The minimum is reached just after a lift-off.
        return min(sum((now - other + _SLACK) % 1.0 >= swing for other in self.offsets) for now in self.offsets)

    def reordered(self, order: Iterable[int]) -> "Gait":
        """Return the gait of the same feet in another order: foot i of the new one is foot ``order[i]`` of this one.

        Raises:
            InputError: ``order`` is not a permutation of the feet.
        """
        order = tuple(order)
        if sorted(order) != list(range(self.nc)):
            raise InputError("order", order, f"each of 0 to {self.nc - 1} once")
        return self.replace({"offsets": tuple(self.offsets[i] for i in order)})


# name: (period in sqrt(height / gravity), duty, offsets of front left, front right, hind left, hind right, width).
# On the feet of one side or one end a robot topples: shorter stances on them cause less roll or pitch.
_QUADRUPED: Mapping[str, tuple[float, float, tuple[float, ...], float]] = {
    "stand": (2.2, 1.0, (0.0, 0.0, 0.0, 0.0), 1.0),
    "walk": (3.8, 0.77, (0.25, 0.75, 0.0, 0.5), 1.0),
    "trot": (1.65, 0.5, (0.0, 0.5, 0.5, 0.0), 1.0),
    "pace": (1.37, 0.65, (0.0, 0.5, 0.0, 0.5), 0.35),
    "bound": (1.37, 0.65, (0.0, 0.0, 0.5, 0.5), 1.0),
    "pronk": (1.65, 0.7, (0.0, 0.0, 0.0, 0.0), 1.0),
}


# Of left and right foot.
_BIPED: Mapping[str, tuple[float, float, tuple[float, ...], float]] = {"walk": (2.4, 0.6, (0.0, 0.5), 0.5)}


def biped_gaits(height_m: float) -> dict[str, Gait]:
    """Return the predefined gaits of two feet by name, besides standing; order: left, right.

    Between two footfalls the centre of mass sways by less the shorter the steps and the narrower the gait.

    Args:
        height_m: height of the centre of mass above the feet, m; see :func:`quadruped_gaits`.
    """
    return _scaled(_BIPED, height_m)


def quadruped_gaits(height_m: float = 0.21) -> dict[str, Gait]:
    """Return the predefined gaits of four feet by name; order: front left, front right, hind left, hind right.

    The dynamics of a pendulum of height h are the same in units of ``sqrt(h / g)`` (equal Froude numbers), so the
    periods are proportional to that time. The trot of a robot of Solo12's height has a period of 0.24 s: longer ones
    are common (0.32 s in Leziart et al., "Implementation of a reactive walking controller for the new open-hardware
    quadruped Solo-12", ICRA 2021) and cost less, but between two steps a pushed robot moves beyond its legs' reach.

    Args:
        height_m: height of the centre of mass above the feet, m.

    Raises:
        InputError: a height that is not positive.
    """
    if not (height_m > 0.0 and math.isfinite(height_m)):
        raise InputError("height_m", height_m, "a finite height above 0 m")
    return _scaled(_QUADRUPED, height_m)


def _scaled(gaits: Mapping[str, tuple[float, float, tuple[float, ...], float]], height_m: float) -> dict[str, Gait]:
    unit = math.sqrt(height_m / GRAVITY)
    return {
        name: Gait(name=name, period_s=periods * unit, duty=duty, offsets=offsets, width=width)
        for name, (periods, duty, offsets, width) in gaits.items()
    }


def find_gait(gaits: Mapping[str, Gait], name: str, argument: str = "gait") -> Gait:
    """Return the gait called ``name``.

    Raises:
        InputError: there is none; it names ``argument`` and the nearest gaits.
    """
    if name not in gaits:
        raise InputError(argument, f"'{name}'", "the name of a gait", tuple(gaits), word=name)
    return gaits[name]
