"""Steps of a standing robot against a push: the criterion, and the choice of the schedule."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from lgmpc.locomotion.gait import Gait
from lgmpc.settings import Count, Finite, NonNegative, Positive, Settings, key
from lgmpc.support import capture_point, support_margin
from lgmpc.typing import Array

_COM_RATE = 1.25  # 1/s: what a metre away counts as, in m/s
_PER_METRE = 1.0  # 1/m


class StepReactionSettings(Settings):
    """Thresholds and durations of a standing robot's steps against pushes."""

    enabled: bool = Field(default=False, strict=True, description="Whether a standing robot steps against pushes.")
    margin_m: Finite = key(
        0.05,
        "Step when the forecast capture point is closer than this to the edge of the support, m; negative:"
        " further outside, which steps less often but later, when the robot is faster.",
    )
    gait: Annotated[str, Field(min_length=1)] = key("trot", "Name of the gait to step with.")
    cycle_shares: Annotated[
        tuple[Annotated[Positive, Field(ge=0.2, le=2.0)], ...], Field(min_length=1, max_length=4)
    ] = key(
        (0.75, 0.9),
        "Durations of the first cycles to choose from, as shares of the gait's own; each is evaluated with"
        " each group of feet that may lift off first.",
    )
    cycles: Count = key(2, "Cycles against the push, before the robot goes back.")
    return_speed_m_s: NonNegative = key(0.4, "Speed at which the robot goes back to where it stood, m/s.")
    return_rate_hz: Positive = key(3.0, "Rate at which the rest of the way back decays, 1/s.")
    place_tolerance_m: Positive = key(0.005, "Distance from where it stood at which the robot stops stepping, m.")


@dataclass(frozen=True)
class StepSchedule:
    """One way to step.

    Attributes:
        gait: to step with.
        first: foot that lifts off first, with those of the same offset.
    """

    gait: Gait
    first: int

    def load(self, forces: Array) -> float:
        """Return what the feet that lift off first carry together of normal forces (nc,), N."""
        offsets = np.array(self.gait.offsets)
        return float(forces[offsets == offsets[self.first]].sum())

    def __str__(self) -> str:
        return f"{self.gait.name} in cycles of {self.gait.period_s:.3g} s, foot {self.first} first"


def step_schedules(gait: Gait, cycle_shares: Sequence[float]) -> tuple[StepSchedule, ...]:
    """Return the schedules of a gait: each share of its period with each group of feet first."""
    groups = dict.fromkeys(gait.offsets)
    return tuple(
        StepSchedule(gait.replace({"period_s": share * gait.period_s}), gait.offsets.index(offset))
        for share in cycle_shares
        for offset in groups
    )


def forecast_cost(xs: Array, com: Array, mass: float) -> float:
    """Return the cost of a forecast, the mean over its nodes of weighted squares, m2/s2.

    Steps that catch a push leave the robot slower, nearer to its place, and less turned. The weights are in the
    proportions of the MPC's while it steps (:class:`~lgmpc.mpc.centroidal.CentroidalSteppingWeights`), for
    every predictive model.

    Args:
        xs: (N+1, 9) [centre of mass; linear momentum; angular momentum].
        com: (N+1, 3) desired centre of mass, m.
        mass: kg.
    """
    away, linear, angular = xs[:, 0:3] - com, xs[:, 3:6] / mass, xs[:, 6:9] / mass
    squares = _COM_RATE**2 * away**2 + linear**2 + _PER_METRE**2 * angular**2
    return float(squares.sum(axis=1).mean() + squares[-1].sum())


def least(costs: Sequence[float], ties: Sequence[float]) -> int:
    """Return the index of the least cost; of costs equal to a part in a thousand, that of the least ``ties``."""
    lowest = min(costs)
    close = [i for i, cost in enumerate(costs) if cost <= lowest + 1e-3 * abs(lowest)] or [0]
    return min(close, key=ties.__getitem__)


class StepReaction:
    """Compares the forecast capture point with the support.

    While the forecast keeps it over the support, the feet in place can hold; beyond, no force that they can exert stops
    the fall.

    Args:
        settings: see :class:`StepReactionSettings`.
        height: of the centre of mass above the feet, m.
    """

    def __init__(self, settings: StepReactionSettings, height: float) -> None:
        self.settings, self._height = settings, height

    def needed(self, com: Array, velocity: Array, points: Array) -> bool:
        """Return whether a centre of mass (3,) with velocity (3,) leaves the support of contact points (nc, 3)."""
        place, used = capture_point(com, velocity, self._height), np.ones((1, len(points)), dtype=np.bool_)
        return bool(support_margin(points[None, :, :2], used, place[None])[0] < self.settings.margin_m)
