"""Geometry of the contacts of spherical feet: the only module that knows where a foot touches.

A spherical foot of radius r whose centre is at ``c`` touches a surface of unit normal ``n`` at ``p = c - r n``. Rolling
without slipping holds the velocity of that material point at zero, ``v_c + omega x (-r n) = 0``; as ``-r n`` does not
turn with the foot, its derivative is ``a_c + alpha x (-r n) = 0``. The point p itself moves as the centre does.

The functions take numbers, arrays and CasADi expressions alike, unless they say otherwise.
"""

from typing import Any

import casadi as ca

UP = (0.0, 0.0, 1.0)
"""Normal of a level surface, world axes."""


def lever(radius: float, normal: Any) -> Any:
    """Return the vector from a foot's centre to its contact point, for (..., 3) normals, m."""
    return -radius * normal


def touching(centre: Any, radius: float, normal: Any) -> Any:
    """Return the contact points of feet with (..., 3) centres on surfaces with these normals, m."""
    return centre + lever(radius, normal)


def axes_of(normal: Any) -> Any:
    """Return the (3, 3) expression of a surface's axes: two tangents, the first above the world's x, and the normal n.

    The tangents are ``t = (e_x - x n) / |e_x - x n|`` and ``n x t``, with x the first entry of n, which is not along
    e_x. On a level surface these are the world's axes, exactly.
    """
    x, y, z = normal[0], normal[1], normal[2]
    size = ca.sqrt(1.0 - x * x)
    tx, ty, tz = size, -x * y / size, -x * z / size
    rows = (tx, y * tz - z * ty, x), (ty, z * tx - x * tz, y), (tz, x * ty - y * tx, z)
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))
