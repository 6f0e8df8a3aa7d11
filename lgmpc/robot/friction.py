"""Friction of contacts and joints: the pyramid that approximates the friction cone, and smoothed Coulomb torques.

The regular pyramid with n facets inscribed in the cone of coefficient mu,

    cos(2 pi j / n) f_x + sin(2 pi j / n) f_y <= mu cos(pi / n) f_z,      j = 0 .. n - 1,

has its edges on the cone. A circumscribed one would allow diagonal forces outside the cone, at which feet slip.
"""

import math
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

FULL_SPEED = 0.1
"""rad/s (m/s): where a joint reverses, its friction is smoothed over some of this; noise of speeds is well below it."""

_ROUNDING = 1e-15  # largest rounding error of cosines and sines that are zero


def check_facets(facets: int) -> None:
    """Check the number of facets.

    Raises:
        InputError: fewer than three.
    """
    if facets < 3:
        raise InputError("facets", facets, "at least 3 sides of the friction pyramid (4 and 8 are usual)")


def chosen_facets(given: int | None, soles: bool) -> int:
    """Return the number of facets at each contact point: as given, else 4 at the corners of soles and 12 at points.

    Forces at the corners of a sole share its load: more facets cost 7 to 20 times as much time and move nothing.
    """
    return given if given is not None else 4 if soles else 12


def pyramid_half_width(friction: Any, facets: int) -> Any:
    """Return ``mu cos(pi / n)``, the pyramid's half-width at unit height; friction is a number or a CasADi scalar."""
    return friction * math.cos(math.pi / facets)


def facet_normals(facets: int) -> Array:
    """Return the horizontal outward normals (n, 2) of the facets; one faces each axis if n is a multiple of 4."""
    angles = 2.0 * np.pi * np.arange(facets) / facets
    return np.column_stack([np.cos(angles), np.sin(angles)])


def friction_pyramid(friction: float, facets: int) -> Array:
    """Return the rows F (n, 3) of ``F f <= 0``, f in axes whose z is the surface's normal."""
    return np.column_stack([facet_normals(facets), np.full(facets, -pyramid_half_width(friction, facets))])


def friction_margins(force: Any, half_width: Any, facets: int) -> list[Any]:
    """Return ``-F f`` as n CasADi expressions, N: positive strictly inside the pyramid.

    Args:
        force: (3,) in axes whose z is the surface's normal, N.
        half_width: of :func:`pyramid_half_width`, computed once for all contacts.
        facets: n.
    """
    # Entries that differ from zero by rounding only are omitted, so that the rows stay sparse.
    normals = np.where(np.abs(facet_normals(facets)) < _ROUNDING, 0.0, facet_normals(facets)).tolist()
    return [half_width * force[2] - x * force[0] - y * force[1] for x, y in normals]


def joint_friction_torque(friction: ca.SX, rates: ca.SX) -> ca.SX:
    r"""Return the torques (nu,) that overcome Coulomb friction, ``f_c tanh(v / v_s)``.

    Coulomb friction is discontinuous where a joint reverses. The smoothed magnitude stays below that of the joint, so
    that its compensation does not move a joint at rest.

    Args:
        friction: (nu,) f_c, N.m.
        rates: (nu,) v, rad/s.
    """
    return friction * ca.tanh(rates / FULL_SPEED)
