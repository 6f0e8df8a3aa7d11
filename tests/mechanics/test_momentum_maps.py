from __future__ import annotations

import tracemalloc

import casadi as ca
import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics import (
    HEIGHT,
    SE3,
    SEMIDIRECT,
    SO3,
    UP,
    EulerPoincare,
    LeftSymmetry,
    LieGroup,
    Motion,
    SpatialInertia,
    body_momentum,
    conserved_dimension,
    free_body,
    heavy_top,
    spatial_momentum,
    torque_free_body,
)

BODY = SpatialInertia(1.5, np.array([0.1, 0.05, -0.2]), np.diag([0.1, 0.2, 0.25]))
GROUPS = pytest.mark.parametrize("group", [SO3, SE3, SEMIDIRECT], ids=lambda group: group.name)


def several(system: EulerPoincare, count: int = 3) -> list[Motion]:
    """Motions from general starts."""
    rng = np.random.default_rng(5)
    size, dim = system.group.size, system.group.dim
    motions = []
    for _ in range(count):
        pose = system.group.numeric.exp(rng.normal(size=dim))
        world = None if system.advected is None else (UP if size == 3 else HEIGHT)
        advected = None if world is None else pose.T @ world
        motions.append(system.simulate(pose, rng.normal(size=dim), advected, step=2.5e-4, steps=8000, every=80))
    return motions


@GROUPS
def test_momentum_maps_are_the_pairings_with_the_generators(group: LieGroup) -> None:
    """``<J(p), zeta> = <p, zeta_G(g)>``: left translation moves g by ``zeta g``, right translation by ``g zeta``."""
    rng = np.random.default_rng(0)
    g, zeta, mu = group.numeric.exp(rng.normal(size=group.dim)), *rng.normal(size=(2, group.dim))
    generator = group.numeric.hat(zeta) @ g
    body_velocity = group.numeric.vee(np.linalg.inv(g) @ generator)
    nu = spatial_momentum(group, g, mu)
    assert nu @ zeta == pytest.approx(mu @ body_velocity, rel=1e-12)
    np.testing.assert_allclose(body_momentum(group, g, nu), mu, atol=1e-12)


@GROUPS
def test_spatial_momentum_is_equivariant_and_body_momentum_invariant_under_left_translation(group: LieGroup) -> None:
    """``J(h p) = Ad*_{h^-1} J(p)``; the body momentum of ``h p`` is that of p: it is no momentum map of this action."""
    rng = np.random.default_rng(1)
    g, h = group.numeric.exp(rng.normal(size=(2, group.dim)))
    mu = rng.normal(size=group.dim)
    moved = spatial_momentum(group, h @ g, mu)
    np.testing.assert_allclose(moved, spatial_momentum(group, h, spatial_momentum(group, g, mu)), atol=1e-12)
    np.testing.assert_allclose(body_momentum(group, h @ g, moved), mu, atol=1e-12)


def test_spatial_momentum_on_se3_is_linear_momentum_and_angular_about_the_worlds_origin() -> None:
    rng = np.random.default_rng(2)
    pose, twist = se3.exp(rng.normal(size=6)), rng.normal(size=6)
    rotation, origin = pose[:3, :3], pose[:3, 3]
    center = origin + rotation @ BODY.center
    velocity = rotation @ (twist[:3] + np.cross(twist[3:], BODY.center))
    linear = BODY.mass * velocity
    angular = rotation @ BODY.rotational @ twist[3:] + np.cross(center, linear)
    np.testing.assert_allclose(spatial_momentum(SE3, pose, BODY.matrix @ twist), np.r_[linear, angular], atol=1e-13)


def test_noether_conserves_the_spatial_momentum_and_not_the_body_momentum() -> None:
    system = torque_free_body(np.diag([1.0, 2.0, 2.5]))
    motion = system.simulate(so3.exp([0.3, 0.2, 0.1]), [1.0, 0.5, -0.7], step=1e-3, steps=3000, every=10)
    np.testing.assert_allclose(np.ptp(system.noether_momenta(motion), axis=0), 0.0, atol=1e-10)
    assert np.ptp(system.momenta(motion), axis=0).min() > 0.1


def test_directions_of_long_motions_take_memory_in_proportion_to_their_length() -> None:
    system = torque_free_body(np.diag([1.0, 2.0, 2.5]))
    motion = system.simulate(np.eye(3), [1.0, 0.5, -0.7], step=1e-3, steps=4000)
    symmetry = LeftSymmetry(system)
    assert len(symmetry.directions([motion])) == 3
    tracemalloc.start()
    try:
        symmetry.directions([motion])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100 * motion.poses.nbytes  # 29 MB; a square matrix of one row a state would be 128 MB


SYSTEMS = {
    "free": (free_body(BODY), 6),
    "gravity": (free_body(BODY, 9.81), 3),
    "gravity and a bowl of revolution": (
        free_body(BODY, 9.81, potential=lambda s: 20.0 * ca.sumsqr(s.pose[:2, 3]) + 9.0 * s.pose[2, 3] ** 2),
        1,
    ),
    "gravity and an oval bowl": (
        free_body(BODY, 9.81, potential=lambda s: 20.0 * s.pose[0, 3] ** 2 + 30.0 * s.pose[1, 3] ** 2),
        0,
    ),
    "gravity and a frictionless plane": (free_body(BODY, 9.81, potential=lambda s: 50.0 * s.pose[2, 3] ** 2), 3),
    "torque-free": (torque_free_body(np.diag([1.0, 2.0, 2.5])), 3),
    "heavy top": (heavy_top(np.diag([1.0, 2.0, 2.5]), [0.1, 0.2, 0.7]), 1),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_table_of_broken_symmetries(name: str) -> None:
    """Chapter 4.13.4: the conserved components are exactly those of the Lagrangian's symmetries."""
    system, expected = SYSTEMS[name]
    motions = several(system)
    directions = LeftSymmetry(system).directions(motions)
    momenta = [system.noether_momenta(motion) for motion in motions]
    assert len(directions) == expected
    assert conserved_dimension(momenta) == expected
    for table in momenta:
        np.testing.assert_allclose((table - table[0]) @ directions.T, 0.0, atol=1e-8)


@pytest.mark.parametrize("name", SYSTEMS)
def test_momentum_changes_at_the_rate_that_noether_predicts(name: str) -> None:
    system, _ = SYSTEMS[name]
    for motion in several(system, 1):
        rates, momenta = LeftSymmetry(system).rates(motion), system.noether_momenta(motion)
        # Simpson's rule over pairs of stored intervals.
        h = motion.times[1]
        gained = h / 3 * (rates[:-2:2] + 4 * rates[1::2] + rates[2::2])
        scale = max(1.0, float(np.abs(rates).max()))
        np.testing.assert_allclose(np.diff(momenta[::2], axis=0), gained, atol=1e-4 * h * scale)


def test_gravity_keeps_horizontal_momentum_and_the_vertical_angular_momentum() -> None:
    directions = LeftSymmetry(SYSTEMS["gravity"][0]).directions(several(SYSTEMS["gravity"][0]))
    projector = directions.T @ directions
    np.testing.assert_allclose(projector, np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]), atol=1e-9)


def test_one_fall_alone_keeps_a_fourth_component() -> None:
    system = SYSTEMS["gravity"][0]
    motions = several(system, 1)
    assert conserved_dimension([system.noether_momenta(m) for m in motions]) == 4
    assert len(LeftSymmetry(system).directions(motions)) == 4


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="pose: .* rotation"):
        spatial_momentum(SO3, 2 * np.eye(3), np.ones(3))
    with pytest.raises(InputError, match=r"body: got shape \(2,\)"):
        spatial_momentum(SO3, np.eye(3), np.ones(2))
    with pytest.raises(InputError, match="spatial: .* finite"):
        body_momentum(SO3, np.eye(3), np.full(3, np.inf))
    with pytest.raises(InputError, match="momenta"):
        conserved_dimension([])
    with pytest.raises(InputError, match="momenta"):
        conserved_dimension([np.ones((1, 3))])
    with pytest.raises(InputError, match="motions: got none"):
        LeftSymmetry(SYSTEMS["free"][0]).directions([])
