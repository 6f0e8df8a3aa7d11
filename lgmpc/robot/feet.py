"""Geometry of the contacts of spherical feet: the only module that knows where a foot touches.

A spherical foot of radius r whose centre is at ``c`` touches a surface of unit normal ``n`` at ``p = c - r n``. Rolling
without slipping holds the velocity of that material point at zero, ``v_c + omega x (-r n) = 0``; as ``-r n`` does not
turn with the foot, its derivative is ``a_c + alpha x (-r n) = 0``. The point p itself moves as the centre does.

The functions take numbers, arrays and CasADi expressions alike, unless they say otherwise.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from lgmpc.typing import Array

__all__ = ["UP", "axes_of", "in_surface_axes", "in_world_axes", "lever", "surface_axes", "touching"]

UP = (0.0, 0.0, 1.0)
"""Normal of a level surface, world axes."""


def lever(radius: float, normal: Any) -> Any:
    """Return the vector from a foot's centre to its contact point, for (..., 3) normals, m."""
    return -radius * normal


def touching(centre: Any, radius: float, normal: Any) -> Any:
    """Return the contact points of feet with (..., 3) centres on surfaces with these normals, m."""
    return centre + lever(radius, normal)


def surface_axes(normals: Array) -> Array:
    """Return (..., 3, 3) rotations whose columns are two tangents and the normal; see :func:`axes_of`.

    Args:
        normals: (..., 3) unit normals, not along the world's x axis.
    """
    x, y, z = np.moveaxis(normals, -1, 0)
    return np.stack([np.stack(row, axis=-1) for row in _rows(x, y, z, np.sqrt)], axis=-2)


def in_world_axes(vectors: Array, normals: Array) -> Array:
    """Return (..., 3) vectors given in the axes of surfaces with these (..., 3) normals; the same ones where level."""
    turned: Array = vectors if _level(normals) else (surface_axes(normals) @ vectors[..., None])[..., 0]
    return turned


def in_surface_axes(vectors: Array, normals: Array) -> Array:
    """Return (..., 3) vectors of the world in the axes of surfaces with these (..., 3) normals."""
    turned: Array = vectors if _level(normals) else (vectors[..., None, :] @ surface_axes(normals))[..., 0, :]
    return turned


def _level(normals: Array) -> bool:
    return not normals[..., :2].any()


def axes_of(normal: Any) -> Any:
    """Return the (3, 3) expression of a surface's axes: two tangents, the first above the world's x, and the normal.

    On a level surface these are the world's axes, exactly.
    """
    rows = _rows(normal[0], normal[1], normal[2], ca.sqrt)
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _rows(x: Any, y: Any, z: Any, root: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Return the rows of the axes of the normal (x, y, z): ``t = (e_x - x n) / |e_x - x n|``, ``n x t`` and n."""
    size = root(1.0 - x * x)
    tx, ty, tz = size, -x * y / size, -x * z / size
    return (tx, y * tz - z * ty, x), (ty, z * tx - x * tz, y), (tz, x * ty - y * tx, z)
