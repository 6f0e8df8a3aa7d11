"""Triangle meshes from profiles and from coal geometries, shaded with sharp creases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from lgmpc.typing import Array, IntArray

__all__ = [
    "Mesh",
    "box",
    "cone",
    "cylinder",
    "disc",
    "ellipsoid",
    "lathe",
    "mesh_of",
    "shade",
    "sphere",
    "triangles_of",
    "tube",
]

CREASE_DEG = 35.0
"""The edge between faces at a larger angle, degrees, is drawn sharp."""

_SEGMENTS = 24


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
    def joined(cls, meshes: Sequence[Mesh]) -> Mesh:
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


def lathe(profile: Sequence[tuple[float, float]], segments: int = _SEGMENTS) -> Mesh:
    """Return the surface of revolution about z of a profile of (radius, height) points, from the bottom up.

    The surface is closed if the profile begins and ends on the axis.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    vertices: list[Array] = []
    rings: list[IntArray] = []
    for radius, height in profile:
        count = 1 if radius == 0.0 else segments
        start = sum(len(part) for part in vertices)
        vertices.append(np.column_stack((radius * circle[:count], np.full(count, height))))
        rings.append(np.resize(np.arange(start, start + count), segments))
    faces = []
    for lower, upper in zip(rings[:-1], rings[1:], strict=True):
        following_lower, following_upper = np.roll(lower, -1), np.roll(upper, -1)
        faces.append(np.column_stack((lower, following_lower, following_upper)))
        faces.append(np.column_stack((lower, following_upper, upper)))
    triangles = np.concatenate(faces)
    distinct = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return shade(np.concatenate(vertices), triangles[distinct])


def cylinder(radius: float, bottom: float, top: float) -> Mesh:
    """Return a closed cylinder about z."""
    return lathe([(0.0, bottom), (radius, bottom), (radius, top), (0.0, top)])


def cone(radius: float, bottom: float, top: float) -> Mesh:
    """Return a closed cone about z with its base at ``bottom`` and its apex at ``top``."""
    return lathe([(0.0, bottom), (radius, bottom), (0.0, top)])


def disc(radius: float, height: float = 0.0) -> Mesh:
    """Return a disc about z, visible from above."""
    return lathe([(radius, height), (0.0, height)], segments=48)


def sphere(radius: float, stretch: float = 0.0) -> Mesh:
    """Return a sphere; with ``stretch`` > 0 a capsule about z whose cylindrical part is ``2 stretch`` long."""
    angles = np.linspace(0.0, 0.5 * np.pi, 7)
    upper = [(radius * math.cos(a), stretch + radius * math.sin(a)) for a in angles[:-1]] + [(0.0, stretch + radius)]
    lower = [(r, -z) for r, z in reversed(upper)]
    # Without a cylinder between them, the two halves share their equator.
    return lathe(lower + (upper if stretch > 0.0 else upper[1:]))


def ellipsoid(semi_axes: Array) -> Mesh:
    """Return an ellipsoid about the origin with semi-axes (3,) along x, y and z."""
    unit = sphere(1.0)
    size = np.asarray(semi_axes, dtype=np.float32)
    normals = unit.normals / size
    return Mesh(unit.positions * size, normals / np.linalg.norm(normals, axis=1)[:, None], unit.faces)


def box(half: Array) -> Mesh:
    """Return a box about the origin with half sides ``half`` (3,)."""
    signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return shade(signs * half, triangles)


def tube(points: Array, radius: float, segments: int = 8) -> Mesh:
    """Return an open tube along a line through points (n, 3), consecutive ones apart.

    Its rings are transported without torsion (double reflection: Wang, Juettler, Zheng and Liu, ACM TOG 27, 2008).
    """
    ahead = np.diff(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    tangents = np.vstack([ahead[:1], ahead[1:] + ahead[:-1], ahead[-1:]])
    size = np.linalg.norm(tangents, axis=1)[:, None]
    # Where the line reverses its direction the mean direction is zero: use the previous one.
    tangents = np.where(size > 1e-6, tangents / np.maximum(size, 1e-6), np.vstack([ahead[:1], ahead]))
    side = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    angles = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    rings = []
    for k, (point, tangent) in enumerate(zip(points, tangents, strict=True)):
        if k > 0:
            across = point - points[k - 1]
            reflect = across / (across @ across)
            side, before = side - 2.0 * (reflect @ side) * across, tangents[k - 1]
            turn = tangent - (before - 2.0 * (reflect @ before) * across)
            side = side - 2.0 * (turn @ side) / max(turn @ turn, 1e-30) * turn
        side = side - (side @ tangent) * tangent
        side /= np.linalg.norm(side)
        rings.append(
            point + radius * (np.outer(np.cos(angles), side) + np.outer(np.sin(angles), np.cross(tangent, side)))
        )
    index = np.arange(len(points) * segments).reshape(len(points), segments)
    lower, upper = index[:-1], index[1:]
    lower_next, upper_next = np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1)
    corners = ((lower, lower_next, upper_next), (lower, upper_next, upper))
    triangles = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in corners])
    return shade(np.concatenate(rings), triangles)


def triangles_of(geometry: Any) -> IntArray:
    """Return the vertex indices (n, 3) of a coal mesh's triangles."""
    corners = map(geometry.tri_indices, range(geometry.num_tris))
    return np.array([(t[0], t[1], t[2]) for t in corners], dtype=np.int64).reshape(-1, 3)


def mesh_of(geometry: Any) -> Mesh | None:
    """Return the mesh of a coal geometry in its own frame; ``None`` for a kind that is not drawn (plane, ...)."""
    if isinstance(geometry, coal.BVHModelBase):
        return shade(np.array(geometry.vertices(), dtype=np.float64).reshape(-1, 3), triangles_of(geometry))
    if isinstance(geometry, coal.Box):
        return box(np.asarray(geometry.halfSide))
    if isinstance(geometry, coal.Sphere):
        return sphere(geometry.radius)
    if isinstance(geometry, coal.Cylinder):
        return cylinder(geometry.radius, -geometry.halfLength, geometry.halfLength)
    if isinstance(geometry, coal.Capsule):
        return sphere(geometry.radius, geometry.halfLength)
    return None
