"""The support of a robot in the plane: capture point, and distance from the edge of a convex hull."""

from typing import Any

import numpy as np

from lgmpc.typing import GRAVITY, Array, BoolArray

_TINY = 1e-9  # m
_BLOCK = 4096  # places at a time: memory


def capture_point(com: Array, velocity: Array, height: Any) -> Array:
    """Return (..., 2) where a pendulum has to put its centre of pressure to come to rest, m, world axes.

    Of a linear inverted pendulum ``x + v sqrt(h / g)``, whose mass stays at its height h (Pratt et al., "Capture
    point", Humanoids 2006); one that moves parallel to a slope has the same (Kajita et al., IROS 2001).

    Args:
        com: (..., 2 or 3) centre of mass, world, m.
        velocity: (..., 2 or 3) m/s.
        height: (...) of the centre of mass above the ground, measured vertically, m.
    """
    return com[..., :2] + velocity[..., :2] * np.sqrt(np.asarray(height) / GRAVITY)[..., None]


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
    count, k, _ = points.shape
    if count > _BLOCK:
        blocks = (slice(at, at + _BLOCK) for at in range(0, count, _BLOCK))
        return np.concatenate([support_margin(points[each], used[each], place[each]) for each in blocks])
    offsets = points - place[:, None]
    directions = (offsets[:, None] - offsets[:, :, None])[..., ::-1] * [1.0, -1.0]  # normals of edges
    directions[:, range(k), range(k)] = -offsets
    directions = directions.reshape(count, k * k, 2)
    length = np.linalg.norm(directions, axis=2)
    reach = np.where(used[:, None], directions @ offsets.swapaxes(1, 2), -np.inf).max(axis=2)
    known = (used[:, None] & used[:, :, None]).reshape(count, k * k) & (length > _TINY)
    margin = np.where(known, reach / np.maximum(length, _TINY), np.inf).min(axis=1)
    margin[np.isinf(margin)] = 0.0  # on the only point
    margin[~used.any(axis=1) | ~np.isfinite(place).all(axis=1)] = np.nan
    return margin
