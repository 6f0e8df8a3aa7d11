"""The friction pyramid, which approximates the friction cone by linear conditions.

The regular pyramid with n facets inscribed in the cone of coefficient mu,

    cos(2 pi j / n) f_x + sin(2 pi j / n) f_y <= mu cos(pi / n) f_z,      j = 0 .. n - 1,

has its edges on the cone. A circumscribed one would allow diagonal forces outside the cone, at which feet slip.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["check_facets", "facet_normals", "friction_margins", "friction_pyramid", "pyramid_half_width"]

_ROUNDING = 1e-15  # largest rounding error of cosines and sines that are zero


def check_facets(facets: int) -> None:
    """Check the number of facets.

    Raises:
        InputError: fewer than three.
    """
    if facets < 3:
        raise InputError("facets", facets, "at least 3 sides of the friction pyramid (4 and 8 are usual)")


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
