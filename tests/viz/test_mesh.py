"""Shading of triangle meshes, and the solids of a URDF."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from lgmpc.viz.mesh import Mesh, box, cone, cylinder, disc, funnel, mesh_of, shade, sphere, tube

SIDES = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-2.0, 2.0) for z in (-3.0, 3.0)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def test_a_box_keeps_its_edges() -> None:
    mesh = shade(SIDES, TRIANGLES)
    assert len(mesh.positions) == 24
    assert set(np.abs(mesh.normals).max(axis=1)) == {1.0}
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(np.float64), 1, 0)
    own = mesh.normals[mesh.faces].astype(np.float64)
    assert np.all(np.einsum("ikj,ij->ik", own, np.cross(b - a, c - a)) > 0.0)


def test_a_sphere_is_smooth() -> None:
    around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), np.linspace(-1.5, 1.5, 16))
    points = 2.0 * np.stack((np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)), axis=-1)
    index = np.arange(16 * 24).reshape(16, 24)
    a, b, c, d = index[:-1], np.roll(index, -1, axis=1)[:-1], np.roll(index, -1, axis=1)[1:], index[1:]
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])
    mesh = shade(points.reshape(-1, 3), faces)
    assert len(mesh.positions) == 16 * 24
    inner = np.abs(mesh.positions[:, 2]) < 1.9
    np.testing.assert_allclose(mesh.normals[inner], mesh.positions[inner] / 2.0, atol=0.03)


def test_faces_of_no_area_are_left_out() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    mesh = shade(vertices, np.array([[0, 1, 2], [0, 1, 3]]))
    assert len(mesh.faces) == 1
    assert np.isfinite(mesh.normals).all()


def test_slivers_have_a_normal() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1e-12, 0], [3, 0, 1e-17]])
    mesh = shade(vertices, np.array([[0, 1, 2], [1, 2, 3]]))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)


def test_meshes_are_joined_with_their_faces() -> None:
    mesh = shade(SIDES, TRIANGLES)
    joined = Mesh.joined([mesh, mesh])
    np.testing.assert_array_equal(joined.positions[joined.faces[12:]], mesh.positions[mesh.faces])


@pytest.mark.parametrize(
    ("geometry", "size"),
    [
        (coal.Box(0.2, 0.4, 0.6), [0.2, 0.4, 0.6]),
        (coal.Sphere(0.25), [0.5, 0.5, 0.5]),
        (coal.Cylinder(0.1, 0.8), [0.2, 0.2, 0.8]),
        (coal.Capsule(0.1, 0.8), [0.2, 0.2, 1.0]),
    ],
)
def test_shapes_of_a_urdf_have_their_size(geometry: object, size: list[float]) -> None:
    solid = mesh_of(geometry)
    assert solid is not None
    np.testing.assert_allclose(np.ptp(solid.positions, axis=0), size, rtol=1e-6)


def volume(mesh: Mesh) -> float:
    """Return the volume that triangles enclose whose normals point outwards."""
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(np.float64), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_cylinders_lie_along_z_between_their_ends() -> None:
    for solid in (cylinder(0.2, -0.5, 1.0), cone(0.2, -0.5, 1.0)):
        np.testing.assert_allclose([solid.positions[:, 2].min(), solid.positions[:, 2].max()], [-0.5, 1.0])


@pytest.mark.parametrize(
    ("solid", "wanted"),
    [
        (box(np.array([0.1, 0.2, 0.3])), 0.048),
        (cylinder(0.2, -0.5, 1.0), 1.5 * np.pi * 0.04),
        (cone(0.2, -0.5, 1.0), 0.5 * np.pi * 0.04),
        (sphere(0.3), 4.0 / 3.0 * np.pi * 0.027),
        (mesh_of(coal.Capsule(0.1, 0.8)), np.pi * (0.01 * 0.8 + 4.0 / 3.0 * 0.001)),
    ],
)
def test_surfaces_are_closed_and_seen_from_outside(solid: Mesh, wanted: float) -> None:
    assert volume(solid) == pytest.approx(wanted, rel=0.04)
    edges = np.sort(np.concatenate([solid.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    corners = np.unique(solid.positions.round(6), axis=0, return_inverse=True)[1].ravel()
    assert (np.unique(np.sort(corners[edges], axis=1), axis=0, return_counts=True)[1] == 2).all()


def test_a_sphere_has_radial_normals_and_a_disc_is_seen_from_above() -> None:
    ball = sphere(0.5)
    np.testing.assert_allclose(ball.normals, ball.positions / 0.5, atol=0.03)
    np.testing.assert_array_equal(disc(0.2).normals, np.tile([0.0, 0.0, 1.0], (len(disc(0.2).positions), 1)))
    assert funnel(0.1, 0.3).positions[:, 2].min() == 0.0


def test_a_tube_keeps_its_radius_around_corners_and_where_it_turns_back() -> None:
    angles = np.linspace(0.0, 4.0, 200)
    line = np.column_stack([np.cos(angles), np.sin(angles), 0.2 * angles])
    distances = np.linalg.norm(tube(line, 0.05).positions[:, None] - line, axis=2).min(axis=1)
    assert 0.04 < distances.min() and distances.max() < 0.051
    assert np.isfinite(tube(np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 1]]), 0.1).positions).all()


def test_what_is_not_drawn_is_none() -> None:
    assert mesh_of(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)) is None
