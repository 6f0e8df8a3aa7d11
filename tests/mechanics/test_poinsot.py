from __future__ import annotations

import numpy as np
import pytest

from lgmpc.lie import so3
from lgmpc.mechanics import EulerTop, Poinsot, torque_free_body

TURN = so3.exp([0.3, -0.8, 0.5])
TOP = EulerTop(TURN @ np.diag([1.0, 2.0, 2.7]) @ TURN.T, TURN @ [0.5, 1.0, 0.4], so3.exp([0.4, -0.3, 0.9]))
CONSTRUCTION = Poinsot(TOP)
TIMES = np.linspace(0.0, 1.3 * TOP.period, 2001)
MOTION = torque_free_body(TOP.inertia).simulate(TOP.rotation, TOP.velocity, step=1e-3, steps=8000)
CONTACT = MOTION.velocities / np.sqrt(2 * TOP.energy)
HERPOLHODE = np.einsum("nij,nj->ni", MOTION.poses, CONTACT)


def test_ellipsoid_touches_the_invariable_plane_all_the_time() -> None:
    polhode = CONSTRUCTION.polhode(TIMES)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", polhode, TOP.inertia, polhode), 1.0, atol=1e-12)
    np.testing.assert_allclose(HERPOLHODE @ CONSTRUCTION.normal, CONSTRUCTION.distance, atol=1e-9)
    gradients = np.einsum("nij,nj->ni", MOTION.poses, CONTACT @ TOP.inertia)
    np.testing.assert_allclose(np.cross(gradients, CONSTRUCTION.normal), 0.0, atol=1e-9)  # tangent there, so inside


def test_whole_ellipsoid_is_on_one_side_of_the_plane() -> None:
    lengths, axes = CONSTRUCTION.semi_axes
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(2000, 3))
    surface = (sphere / np.linalg.norm(sphere, axis=1, keepdims=True) * lengths) @ axes.T
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", surface, TOP.inertia, surface), 1.0, atol=1e-12)
    for rotation in MOTION.poses[::800]:
        assert (surface @ rotation.T @ CONSTRUCTION.normal).max() < CONSTRUCTION.distance


def test_it_rolls_without_slipping() -> None:
    """Of an integrated motion: the curves on ellipsoid and plane are run through at one speed, arc for arc."""
    on_body = np.linalg.norm(np.diff(CONTACT, axis=0), axis=1)
    on_plane = np.linalg.norm(np.diff(HERPOLHODE, axis=0), axis=1)
    np.testing.assert_allclose(on_plane, on_body, rtol=1e-5)  # chords of a thousandth of a second
    assert on_plane.sum() == pytest.approx(on_body.sum(), rel=1e-6)
    # A point of the body that is not on the axis does move.
    elsewhere = np.einsum("nij,j->ni", MOTION.poses, CONTACT[0])
    assert np.linalg.norm(np.diff(elsewhere, axis=0), axis=1).max() > 1e-4
    np.testing.assert_allclose(CONTACT, CONSTRUCTION.polhode(MOTION.times), atol=1e-9)


def test_polhode_is_the_intersection_of_two_quadrics_and_of_sphere_and_energy_ellipsoid() -> None:
    polhode, momenta = CONSTRUCTION.polhode(TIMES), TOP.velocities(TIMES) @ TOP.inertia
    squares = np.linalg.norm(polhode @ TOP.inertia, axis=1) ** 2
    np.testing.assert_allclose(squares, TOP.momentum**2 / (2 * TOP.energy), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(momenta, axis=1), TOP.momentum, rtol=1e-12)
    energies = 0.5 * np.einsum("ni,ij,nj->n", momenta, np.linalg.inv(TOP.inertia), momenta)
    np.testing.assert_allclose(energies, TOP.energy, rtol=1e-12)


@pytest.mark.parametrize("spin", [(0.5, 1.0, 0.4), (0.3, 0.2, 1.0), (-1.2, 0.3, -0.2)])
def test_herpolhode_fills_its_ring(spin: tuple[float, float, float]) -> None:
    construction = Poinsot(EulerTop(np.diag([1.0, 2.0, 2.7]), spin))
    top = construction.top
    motion = torque_free_body(top.inertia).simulate(top.rotation, top.velocity, step=top.period / 20000, steps=20000)
    points = np.einsum("nij,nj->ni", motion.poses, motion.velocities) / np.sqrt(2 * top.energy)
    offsets = points - construction.distance * construction.normal
    low, high = construction.radii
    radii = np.linalg.norm(offsets, axis=1)
    assert radii.min() == pytest.approx(low, abs=1e-6)
    assert radii.max() == pytest.approx(high, abs=1e-6)


def test_steady_rotation_rolls_on_one_point() -> None:
    construction = Poinsot(EulerTop(np.diag([1.0, 2.0, 2.7]), [0.0, 0.0, 2.0]))
    assert construction.radii == (0.0, 0.0)
    assert construction.distance == pytest.approx(construction.semi_axes[0][2])
