"""Triangle meshes of a scene, shaded with sharp creases."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lgmpc.typing import Array, IntArray

CREASE_DEG = 35.0
"""The edge between faces at a larger angle, degrees, is drawn sharp."""

_AROUND, _SMOOTH_AROUND = 24, 48
_ARC = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13)
_BOX = np.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6),
                 (0, 6, 2), (1, 3, 7), (1, 7, 5)])  # fmt: skip


@dataclass(frozen=True)
class Mesh:
    """Triangles with a normal per vertex.

    Attributes:
        positions: (n, 3) vertices, m.
        normals: (n, 3) unit normals.
        faces: (m, 3) vertex indices, counter-clockwise seen from outside.
    """

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.uint32]

    @classmethod
    def joined(cls, meshes: "Sequence[Mesh]") -> "Mesh":
        """Return one mesh of several."""
        first = np.cumsum([0, *(len(mesh.positions) for mesh in meshes[:-1])], dtype=np.uint32)
        return cls(
            np.concatenate([mesh.positions for mesh in meshes]),
            np.concatenate([mesh.normals for mesh in meshes]),
            np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=True)]),
        )


def shade(vertices: Array, triangles: IntArray) -> Mesh:
    """Return the mesh with, at every corner, the mean normal of the adjacent faces without a crease in between.

    Each face is weighted by its angle at the corner (Thürmer and Wüthrich 1998), so that normals do not depend on the
    triangulation of flat parts.

    Args:
        vertices: (n, 3) m.
        triangles: (m, 3) indices.
    """
    corners = vertices[triangles]
    area_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area_normal, axis=1)
    solid = length > 0.0
    triangles, corners, unit = triangles[solid], corners[solid], area_normal[solid] / length[solid, None]
    along = np.roll(corners, -1, axis=1) - corners
    along /= np.linalg.norm(along, axis=2)[:, :, None]
    angle = np.arccos(np.clip(-np.einsum("ikj,ikj->ik", along, np.roll(along, 1, axis=1)), -1.0, 1.0)).ravel()

    # Every pair (i, j) of corners that share a vertex, ordered by i.
    vertex = triangles.ravel()
    face = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(vertex, kind="stable")
    counts = np.bincount(vertex, minlength=len(vertices))
    starts = np.concatenate(([0], np.cumsum(counts)))[:-1]
    repeats = counts[vertex]
    first = np.concatenate(([0], np.cumsum(repeats)))[:-1]
    i = np.repeat(np.arange(len(vertex)), repeats)
    j = order[starts[vertex[i]] + np.arange(len(i)) - first[i]]
    smooth = np.einsum("ij,ij->i", unit[face[i]], unit[face[j]]) > np.cos(np.radians(CREASE_DEG))
    normals = np.add.reduceat((smooth * angle[j])[:, None] * unit[face[j]], first, axis=0)
    size = np.linalg.norm(normals, axis=1)
    # At the corner of a sliver, whose angle may be zero in floating point, use the face's normal.
    normals = np.where((size > 1e-9)[:, None], normals / np.maximum(size, 1e-9)[:, None], unit[face])

    # Merge corners with the same vertex and the same normal.
    key = np.column_stack((vertex, np.round(normals * 256.0).astype(np.int64)))
    _, kept, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return Mesh(
        vertices[vertex[kept]].astype(np.float32),
        normals[kept].astype(np.float32),
        inverse.reshape(-1, 3).astype(np.uint32),
    )


@lru_cache(maxsize=256)  # a scene stores what several objects share once
def cylinder(radius: float, bottom: float, top: float) -> Mesh:
    """Return a closed cylinder about z."""
    return _turned([(0.0, bottom), (radius, bottom), (radius, top), (0.0, top)])


@lru_cache(maxsize=256)
def cone(radius: float, bottom: float, top: float) -> Mesh:
    """Return a closed cone about z with its base at ``bottom`` and its apex at ``top``."""
    return _turned([(0.0, bottom), (radius, bottom), (0.0, top)])


@lru_cache(maxsize=256)
def funnel(radius: float, height: float) -> Mesh:
    """Return an open cone about z with its apex at the origin."""
    return _turned([(0.0, 0.0), (radius, height)], _SMOOTH_AROUND)


@lru_cache(maxsize=256)
def disc(radius: float) -> Mesh:
    """Return a disc in the x-y plane, visible from above."""
    return _turned([(radius, 0.0), (0.0, 0.0)], _SMOOTH_AROUND)


@lru_cache(maxsize=256)
def sphere(radius: float) -> Mesh:
    """Return a sphere."""
    return ellipsoid(np.full(3, radius))


def ellipsoid(semi_axes: Array) -> Mesh:
    """Return an ellipsoid about the origin with semi-axes (3,) along x, y and z."""
    return _turned(np.column_stack((np.cos(_ARC), np.sin(_ARC))), scale=semi_axes)


def box(half: Array) -> Mesh:
    """Return a box about the origin with half sides ``half`` (3,)."""
    corners = np.array([(x, y, z) for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
    return shade(corners * half, _BOX)


def tube(points: Array, radius: float) -> Mesh:
    """Return an open tube of 8 sides along the line through points (n, 3), consecutive ones apart."""
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    points = points[np.unique(np.append(np.searchsorted(way, np.arange(0.0, way[-1], radius)), len(points) - 1))]
    along = np.diff(points, axis=0)
    along = np.concatenate((along, along[-1:])) / np.linalg.norm(along[[*range(len(along)), -1]], axis=1)[:, None]
    side, sides = np.eye(3)[np.argmin(np.abs(along[0]))], []
    for direction in along:  # the sides turn as little as possible
        side = side - (side @ direction) * direction
        length = float(np.linalg.norm(side))
        side = side / length if length > 1e-6 else np.roll(direction, 1)
        sides.append(side)
    first, second = np.array(sides), np.cross(along, sides)
    angles = 2.0 * np.pi * np.arange(8) / 8
    rings = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    return shade((points[:, None] + radius * rings).reshape(-1, 3), _between(len(points), 8))


def mesh_of(geometry: Any) -> Mesh | None:
    """Return a coal geometry in its own frame; ``None`` for a kind that is not drawn (plane, ...)."""
    if isinstance(geometry, coal.BVHModelBase):
        return shade(np.array(geometry.vertices(), dtype=np.float64).reshape(-1, 3), triangles_of(geometry))
    if isinstance(geometry, coal.Box):
        return box(np.asarray(geometry.halfSide))
    if isinstance(geometry, coal.Sphere):
        return sphere(geometry.radius)
    if isinstance(geometry, coal.Cylinder):
        return cylinder(geometry.radius, -geometry.halfLength, geometry.halfLength)
    if isinstance(geometry, coal.Capsule):
        radii, heights = geometry.radius * np.cos(_ARC), geometry.radius * np.sin(_ARC)
        ends = [np.column_stack((radii, heights + side * geometry.halfLength)) for side in (-1.0, 1.0)]
        return _turned(np.concatenate((ends[0][:7], ends[1][6:])))
    return None


def triangles_of(geometry: Any) -> IntArray:
    """Return the vertex indices (n, 3) of a coal mesh's triangles."""
    corners = map(geometry.tri_indices, range(geometry.num_tris))
    return np.array([(t[0], t[1], t[2]) for t in corners], dtype=np.int64).reshape(-1, 3)


def _turned(profile: ArrayLike, around: int = _AROUND, scale: ArrayLike = 1.0) -> Mesh:
    """Return a surface of revolution about z.

    Args:
        profile: (n, 2) radii and heights, counter-clockwise seen with the axis to the left.
        around: number of its sides.
        scale: factors along x, y and z.
    """
    radii, heights = np.asarray(profile, dtype=np.float64).T
    radii = np.where(radii > 1e-9 * radii.max(), radii, 0.0)
    angles = 2.0 * np.pi * np.arange(around) / around
    x, y = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))
    vertices = np.stack([x, y, np.broadcast_to(heights[:, None], x.shape)], axis=-1).reshape(-1, 3)
    # A point on the axis is one vertex, so that the surface is smooth there.
    own = np.where(
        np.repeat(radii, around) > 0.0, np.arange(len(vertices)), np.arange(len(vertices)) // around * around
    )
    return shade(vertices * np.asarray(scale, dtype=np.float64), own[_between(len(radii), around)])


def _between(rings: int, around: int) -> IntArray:
    """Return the triangles between rings of vertices, counter-clockwise seen from outside."""
    ring, at = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = (ring * around + at).ravel(), (ring * around + (at + 1) % around).ravel()
    return np.concatenate([np.column_stack([a, b, b + around]), np.column_stack([a, b + around, a + around])])
