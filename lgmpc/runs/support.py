"""The capture point and its margin to the support, within which a robot can come to rest without a step."""

from __future__ import annotations

import numpy as np

from lgmpc.runs.log import MODES, RunLog
from lgmpc.runs.modes import LOW_MODES
from lgmpc.typing import GRAVITY, Array, BoolArray

__all__ = ["capture_margin", "capture_point", "support_margin"]

_LOWEST = 0.02  # m; at lower heights the pendulum does not model the robot
_TINY = 1e-9  # m


def capture_point(log: RunLog) -> Array:
    """Return the (n, 2) capture point of each tick, m, world axes; NaN where the mass was not recorded.

    Of a linear inverted pendulum: ``x + v sqrt(z / g)`` with the centre of mass ``x`` at height ``z`` above the ground,
    measured vertically, and its velocity ``v`` (Pratt et al., Humanoids 2006); a pendulum that moves parallel to a
    slope has the same (Kajita et al., IROS 2001).
    """
    height = np.maximum(log.above_ground(log.com) / log.ground_normal[:, 2], _LOWEST)
    velocity = log.momentum[:, :2] / log.mass_kg
    point: Array = log.com[:, :2] + velocity * np.sqrt(height / GRAVITY)[:, None]
    return point


def capture_margin(log: RunLog) -> Array:
    """Return the (n,) distance of the capture point from the edge of the support, m; negative outside.

    The support is the convex hull of the feet that touch the ground and of the footholds of those that swing. NaN in
    flight, where the mass was not recorded, and while the robot lies, rises or lies down: its body may carry it.
    """
    points, used = log.contact_points[:, :, :2], log.closed
    if log.stance is not None and log.footholds is not None:
        swinging = log.stance == 0
        points = np.where(swinging[:, :, None], log.footholds[:, :, :2], points)
        used = used | swinging
    margin = support_margin(points, used, capture_point(log))
    if log.mode is not None:
        margin[np.isin(log.mode, [MODES.index(mode) for mode in LOW_MODES])] = np.nan
    return margin


def support_margin(points: Array, used: BoolArray, place: Array) -> Array:
    """Return the signed distance of a place from the edge of the convex hull of points, positive inside.

    It is the minimum over unit vectors of the support function of the hull about the place, attained at the normal of
    an edge or, from outside, at the direction from a vertex to the place.

    Args:
        points: (n, k, 2) points, m.
        used: (n, k) flags of the points that the hull includes.
        place: (n, 2) the place, m.

    Returns:
        (n,) distances, m; NaN where the hull is empty or the place is NaN.
    """
    offsets = points - place[:, None]
    margin = np.full(len(points), np.inf)
    count = points.shape[1]
    for i in range(count):
        others = [offsets[:, j] - offsets[:, i] for j in range(count) if j != i]
        normals = [edge[:, ::-1] * [1.0, -1.0] for edge in others]
        usable = [used[:, i] & used[:, j] for j in range(count) if j != i]
        for direction, valid in zip([-offsets[:, i], *normals], [used[:, i], *usable], strict=True):
            length = np.linalg.norm(direction, axis=1)
            heights = np.einsum("nkx,nx->nk", offsets, direction)
            reach = np.where(used, heights, -np.inf).max(axis=1)
            known = valid & (length > _TINY)
            margin[known] = np.minimum(margin[known], reach[known] / length[known])
    margin[np.isinf(margin)] = 0.0  # on the only point
    margin[~used.any(axis=1) | ~np.isfinite(place).all(axis=1)] = np.nan
    return margin
