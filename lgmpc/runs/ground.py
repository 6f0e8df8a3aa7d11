"""Positions of feet and base relative to the ground: the one module of this package that knows where a foot touches."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.typing import Array
from lgmpc.world import World

__all__ = ["along_ground", "ground_channels", "level_ground"]


def ground_channels(world: World, radius: float, base: Array, points: Array, normals: Array) -> dict[str, Array]:
    """Return the channels of a log that relate to the ground, by name.

    A spherical foot of this radius with its centre at c touches a surface of unit normal m at ``c - radius m``.

    Args:
        world: the world of the run.
        radius: of the feet, m.
        base: (n, 3) positions of the base, m.
        points: (n, nc, 3) contact points for the ``normals``, m: what the controller took them for.
        normals: (n, nc, 3) unit normals of the surfaces for which they were computed.
    """
    centres = (points + radius * normals).reshape(-1, 3)
    distances, true = world.distance(centres)
    true = true.reshape(points.shape)
    return {
        "contact_points": points + (radius * normals - radius * true),  # the same bits where the normals are the same
        "contact_normals": true,
        "contact_clearance": distances.reshape(points.shape[:2]) - radius,
        "ground_height": world.height(base[:, :2]),
        "ground_normal": world.normal(base[:, :2]),
    }


def level_ground(points: NDArray[Any] | None) -> dict[str, Array]:
    """Return these channels of a log from contact points (n, nc, 3) on a level floor at z = 0; none if misshapen."""
    if points is None or points.ndim != 3 or points.shape[2] != 3:
        return {}
    up = np.array([0.0, 0.0, 1.0])
    return {
        "contact_normals": np.tile(up, (*points.shape[:2], 1)),
        "contact_clearance": np.array(points[:, :, 2]),
        "ground_height": np.zeros(len(points)),
        "ground_normal": np.tile(up, (len(points), 1)),
    }


def along_ground(vectors: Array, normals: Array) -> Array:
    """Return (...,) the norms of the parts of (..., 3) vectors that are perpendicular to (..., 3) unit normals."""
    parts: Array = np.linalg.norm(vectors - np.sum(vectors * normals, axis=-1, keepdims=True) * normals, axis=-1)
    return parts
