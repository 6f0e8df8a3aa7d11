"""The decision of a standing robot to step: when its feet cannot hold a push, and with which feet first."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from lgmpc.settings import Count, Finite, Settings
from lgmpc.typing import Array

__all__ = ["StepReaction", "StepReactionSettings", "support_margin"]

_GRAVITY = 9.81


class StepReactionSettings(Settings):
    """When a standing robot steps, and how."""

    enabled: bool = Field(default=False, strict=True, description="Whether a standing robot steps against pushes.")
    margin_m: Finite = Field(
        default=0.0,
        description="Step when the forecast capture point is closer than this to the edge of the support, m; negative:"
        " further outside.",
    )
    gait: Annotated[str, Field(min_length=1)] = Field(default="trot", description="Name of the gait to step with.")
    cycles: Count = Field(default=3, description="Cycles to step before the robot stands again.")


class StepReaction:
    """Compares the forecast capture point with the support.

    The capture point ``c + v sqrt(h / g)`` is where a robot whose centre of mass stays at height h has to put its
    centre of pressure to come to rest (Pratt et al., "Capture point", Humanoids 2006). While the forecast keeps it over
    the support, the feet in place can hold; beyond, no force that they can exert stops the fall.

    Args:
        settings: see :class:`StepReactionSettings`.
        height: of the centre of mass above the feet, m.
    """

    def __init__(self, settings: StepReactionSettings, height: float) -> None:
        self.settings = settings
        self._time_constant = math.sqrt(height / _GRAVITY)

    def capture_point(self, com: Array, velocity: Array) -> Array:
        """Return (2,) the capture point of centre of mass (3,) and velocity (3,), world, m."""
        point: Array = com[:2] + self._time_constant * velocity[:2]
        return point

    def needed(self, com: Array, velocity: Array, points: Array) -> bool:
        """Return whether a centre of mass (3,) with velocity (3,) leaves the support of contact points (nc, 3)."""
        return support_margin(self.capture_point(com, velocity), points[:, :2]) < self.settings.margin_m


def support_margin(point: Array, corners: Array) -> float:
    """Return the distance of ``point`` (2,) to the edge of the convex hull of ``corners`` (n, 2), m; negative outside.

    Outside it is the largest distance to the line of an edge, which at a corner is less than that to the hull.
    """
    centre = corners.mean(axis=0)
    order = np.argsort(np.arctan2(*(corners - centre).T[::-1]))
    ring = _convex(corners[order])
    margin = math.inf
    for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1], strict=True):
        length = math.hypot(bx - ax, by - ay)
        if length > 0.0:
            margin = min(margin, ((bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax)) / length)
    return float(margin)


def _convex(ring: Array) -> list[tuple[float, float]]:
    """Return the corners, in counterclockwise order about their centre, without those that the hull does not need."""
    corners = [(float(x), float(y)) for x, y in ring]
    changed = True
    while changed and len(corners) > 3:
        changed = False
        for i in range(len(corners)):
            (ax, ay), (bx, by), (cx, cy) = corners[i - 1], corners[i], corners[(i + 1) % len(corners)]
            if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) <= 0.0:
                del corners[i]
                changed = True
                break
    return corners
