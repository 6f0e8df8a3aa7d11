"""Geometries of a scene: solids that the viewer builds, and triangle meshes, shaded with sharp creases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from lgmpc.typing import Array, IntArray

__all__ = [
    "Mesh",
    "Solid",
    "box",
    "cone",
    "cylinder",
    "disc",
    "ellipsoid",
    "funnel",
    "mesh_of",
    "shade",
    "sphere",
    "triangles_of",
    "tube",
]

CREASE_DEG = 35.0
"""The edge between faces at a larger angle, degrees, is drawn sharp."""

_SEGMENTS, _SMOOTH_SEGMENTS = 24, 48


@dataclass(frozen=True)
class Solid:
    """A geometry of three.js.

    Attributes:
        sizes: its JSON: type and sizes.
        matrix: (4, 4) its placement: cylinders of three.js lie along y, with their middles at the origin.
        positions: (n, 3) points whose hull contains it, m; none where they are not needed.
    """

    sizes: Mapping[str, Any]
    matrix: Array = field(default_factory=lambda: np.eye(4))
    positions: Array = field(default_factory=lambda: np.zeros((0, 3)))


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


def cylinder(radius: float, bottom: float, top: float) -> Solid:
    """Return a closed cylinder about z."""
    return _turned("CylinderGeometry", bottom, top, radiusTop=radius, radiusBottom=radius)


def cone(radius: float, bottom: float, top: float) -> Solid:
    """Return a closed cone about z with its base at ``bottom`` and its apex at ``top``."""
    return _turned("CylinderGeometry", bottom, top, radiusTop=0.0, radiusBottom=radius)


def funnel(radius: float, height: float) -> Solid:
    """Return an open cone about z with its apex at the origin."""
    sizes = {"radiusTop": radius, "radiusBottom": 0.0, "openEnded": True, "radialSegments": _SMOOTH_SEGMENTS}
    return _turned("CylinderGeometry", 0.0, height, **sizes)


def disc(radius: float) -> Solid:
    """Return a disc in the x-y plane, visible from above."""
    return Solid({"type": "CircleGeometry", "radius": radius, "segments": _SMOOTH_SEGMENTS})


def sphere(radius: float) -> Solid:
    """Return a sphere."""
    return ellipsoid(np.full(3, radius))


def ellipsoid(semi_axes: Array) -> Solid:
    """Return an ellipsoid about the origin with semi-axes (3,) along x, y and z."""
    sizes = {"type": "SphereGeometry", "radius": 1.0, "widthSegments": _SEGMENTS, "heightSegments": _SEGMENTS // 2}
    return Solid(sizes, np.diag([*semi_axes, 1.0]))


def box(half: Array) -> Solid:
    """Return a box about the origin with half sides ``half`` (3,)."""
    return Solid({"type": "BoxGeometry", **dict(zip(("width", "height", "depth"), (2.0 * half).tolist(), strict=True))})


def tube(points: Array, radius: float) -> Solid:
    """Return an open tube along a smooth line through points (n, 3), consecutive ones apart."""
    count = 2 * len(points)
    path = {"type": "CatmullRomCurve3", "points": points.round(5).tolist(), "closed": False, "curveType": "centripetal"}
    path |= {"arcLengthDivisions": count, "tension": 0.5}
    return Solid({"type": "TubeGeometry", "path": path, "tubularSegments": count, "radius": radius})


def mesh_of(geometry: Any) -> Mesh | Solid | None:
    """Return a coal geometry in its own frame; ``None`` for a kind that is not drawn (plane, ...)."""
    if isinstance(geometry, coal.BVHModelBase):
        return shade(np.array(geometry.vertices(), dtype=np.float64).reshape(-1, 3), triangles_of(geometry))
    if isinstance(geometry, coal.Box):
        solid = box(np.asarray(geometry.halfSide))
    elif isinstance(geometry, coal.Sphere):
        solid = sphere(geometry.radius)
    elif isinstance(geometry, coal.Cylinder):
        solid = cylinder(geometry.radius, -geometry.halfLength, geometry.halfLength)
    elif isinstance(geometry, coal.Capsule):
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 14)
        radii, heights = np.cos(angles) * geometry.radius, np.sin(angles) * geometry.radius
        profile = np.column_stack((radii, heights + np.sign(angles) * geometry.halfLength)).tolist()
        solid = _turned("LatheGeometry", 0.0, 0.0, points=[{"x": x, "y": y} for x, y in profile], segments=_SEGMENTS)
    else:
        return None
    geometry.computeLocalAABB()
    low, high = geometry.aabb_local.min_, geometry.aabb_local.max_
    return replace(solid, positions=low + (high - low) * np.array(list(np.ndindex(2, 2, 2))))


def triangles_of(geometry: Any) -> IntArray:
    """Return the vertex indices (n, 3) of a coal mesh's triangles."""
    corners = map(geometry.tri_indices, range(geometry.num_tris))
    return np.array([(t[0], t[1], t[2]) for t in corners], dtype=np.int64).reshape(-1, 3)


def _turned(kind: str, bottom: float, top: float, **sizes: Any) -> Solid:
    """Return a solid of revolution about z, from that of three.js about y."""
    matrix = np.eye(4)
    matrix[1:, 1:] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.5 * (bottom + top)], [0.0, 0.0, 1.0]]
    return Solid({"type": kind, "height": top - bottom, "radialSegments": _SEGMENTS, **sizes}, matrix)
