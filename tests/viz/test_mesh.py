from __future__ import annotations

import coal
import numpy as np
import pytest

from lgmpc.viz.mesh import Mesh, box, cone, cylinder, disc, mesh_of, shade, sphere, tube


def face_normals(mesh: Mesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def volume(mesh: Mesh) -> float:
    """Signed volume: positive only if the surface is closed and its faces look outwards."""
    a, b, c = np.moveaxis(mesh.positions[mesh.faces].astype(np.float64), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


ANGLES = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13)
ROUND = 12.0 * np.sin(np.pi / 12.0)  # area of a regular 24-gon of radius 1: it stands for the circle's pi


def turned(radii: np.ndarray, heights: np.ndarray) -> float:
    """Volume of what a profile of straight pieces encloses when it is turned in 24 steps."""
    a, b = radii[:-1], radii[1:]
    return ROUND * float(np.sum(np.diff(heights) * (a * a + a * b + b * b) / 3.0))


BALL = turned(0.3 * np.cos(ANGLES), 0.3 * np.sin(ANGLES))


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (sphere(0.3), BALL),
        (sphere(0.3, 0.5), BALL + ROUND * 0.3**2),
        (box(np.array([0.1, 0.2, 0.3])), 8.0 * 0.1 * 0.2 * 0.3),
        (cylinder(0.2, -0.5, 1.0), ROUND * 0.2**2 * 1.5),
        (cone(0.2, 0.0, 0.6), ROUND * 0.2**2 * 0.6 / 3.0),
    ],
    ids=["sphere", "capsule", "box", "cylinder", "cone"],
)
def test_bodies_are_closed_face_outwards_and_have_their_size(mesh, expected) -> None:
    assert volume(mesh) == pytest.approx(expected, rel=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    own = mesh.normals[mesh.faces].astype(np.float64)
    assert np.all(np.einsum("ikj,ij->ik", own, face_normals(mesh)) > 0.0)


def test_a_box_keeps_its_edges() -> None:
    mesh = box(np.array([1.0, 2.0, 3.0]))
    assert len(mesh.positions) == 24
    assert set(np.abs(mesh.normals).max(axis=1)) == {1.0}


def test_a_sphere_is_smooth() -> None:
    mesh = sphere(2.0)
    np.testing.assert_allclose(mesh.normals, mesh.positions / 2.0, atol=0.02)


def test_a_disc_is_seen_from_above() -> None:
    assert np.all(face_normals(disc(1.0))[:, 2] > 0.0)


def test_faces_of_no_area_are_left_out() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    mesh = shade(vertices, np.array([[0, 1, 2], [0, 1, 3]]))
    assert len(mesh.faces) == 1
    assert np.isfinite(mesh.normals).all()


def test_slivers_have_a_normal() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1e-12, 0], [3, 0, 1e-17]])
    mesh = shade(vertices, np.array([[0, 1, 2], [1, 2, 3]]))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("geometry", "size"),
    [
        (coal.Box(0.2, 0.4, 0.6), [0.2, 0.4, 0.6]),
        (coal.Sphere(0.25), [0.5, 0.5, 0.5]),
        (coal.Cylinder(0.1, 0.8), [0.2, 0.2, 0.8]),
        (coal.Capsule(0.1, 0.8), [0.2, 0.2, 1.0]),
    ],
)
def test_shapes_of_a_urdf_have_their_size(geometry, size) -> None:
    mesh = mesh_of(geometry)
    assert mesh is not None
    np.testing.assert_allclose(np.ptp(mesh.positions, axis=0), size, rtol=0.02)


def test_what_is_not_drawn_is_none() -> None:
    assert mesh_of(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)) is None


def test_a_tube_keeps_its_radius_and_does_not_twist() -> None:
    angle = np.linspace(0.0, 4.0 * np.pi, 200)
    helix = np.column_stack((np.cos(angle), np.sin(angle), 0.1 * angle))
    mesh = tube(helix, 0.05, segments=8)
    away = np.linalg.norm(mesh.positions[:, None] - helix, axis=2).min(axis=1)
    np.testing.assert_allclose(away, 0.05, atol=1e-6)
    nearest = helix[np.linalg.norm(mesh.positions[:, None] - helix, axis=2).argmin(axis=1)]
    outwards = (mesh.positions - nearest) / 0.05
    assert np.einsum("ij,ij->i", outwards, mesh.normals).min() > 0.9
    # Edges along the tube are about as long as the helix's own steps: rings are not turned against each other.
    corners = mesh.positions[mesh.faces]
    shortest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min(axis=1)
    assert shortest.max() < 1.1 * np.linalg.norm(helix[1] - helix[0])


def test_a_tube_along_a_line_that_turns_back_has_no_hole() -> None:
    mesh = tube(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 0.1)
    assert np.isfinite(mesh.positions).all() and np.isfinite(mesh.normals).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.positions[:, 1:], axis=1), 0.1, atol=1e-6)
