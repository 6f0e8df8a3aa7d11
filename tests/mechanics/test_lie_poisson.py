from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.mechanics import SE3_DUAL, SEMIDIRECT_DUAL, SO3, SO3_DUAL, UP, LiePoisson, body_momentum, heavy_top

pytestmark = pytest.mark.usefixtures("interpreted")
SPACES = (SO3_DUAL, SE3_DUAL, SEMIDIRECT_DUAL)
by_name = pytest.mark.parametrize("space", SPACES, ids=lambda space: space.group.name)


def functions(space: LiePoisson, seed: int, count: int) -> list[Callable[[ca.SX], ca.SX]]:
    """Smooth functions without special structure: a wave, a quadratic form and a cubic term each."""
    rng = np.random.default_rng([seed, space.group.dim])
    made = []
    for _ in range(count):
        a, b = rng.normal(size=(2, space.group.dim))
        m = rng.normal(size=(space.group.dim, space.group.dim))
        made.append(
            lambda mu, a=a, b=b, m=m: (
                ca.sin(ca.dot(ca.DM(a), mu)) + ca.dot(mu, ca.DM(m) @ mu) + ca.dot(ca.DM(b), mu) ** 3
            )
        )
    return made


def point(space: LiePoisson, seed: int = 0) -> ca.DM:
    return ca.DM(np.random.default_rng([7, seed]).normal(size=space.group.dim) / 2)


@by_name
def test_bracket_is_bilinear_antisymmetric_a_derivation_and_satisfies_jacobi(space: LiePoisson) -> None:
    f, g, h = functions(space, 1, 3)
    mu, bracket = point(space), space.bracket

    def at(function: Callable[[ca.DM], ca.DM]) -> float:
        return float(function(mu))

    scale = abs(at(bracket(f, g)))
    assert scale > 1e-3
    assert at(bracket(f, g)) == pytest.approx(-at(bracket(g, f)), rel=1e-12)
    combined = at(bracket(lambda m: 2.0 * f(m) - 3.0 * h(m), g))
    assert combined == pytest.approx(2.0 * at(bracket(f, g)) - 3.0 * at(bracket(h, g)), rel=1e-11)
    product = at(bracket(lambda m: f(m) * h(m), g))
    assert product == pytest.approx(at(f) * at(bracket(h, g)) + at(h) * at(bracket(f, g)), rel=1e-11)
    cycle = [at(bracket(bracket(a, b), c)) for a, b, c in ((f, g, h), (g, h, f), (h, f, g))]
    assert abs(sum(cycle)) < 1e-11 * max(map(abs, cycle))


@by_name
def test_casimirs_commute_with_everything_and_are_all_there_are(space: LiePoisson) -> None:
    mu = point(space)
    for _, casimir in space.casimirs:
        for function in functions(space, 2, 5):
            assert abs(float(space.bracket(casimir, function)(mu))) < 1e-12
    slopes = np.hstack([space.differential(casimir, mu).full() for _, casimir in space.casimirs])
    assert np.linalg.matrix_rank(slopes) == len(space.casimirs)
    assert space.orbit_dimension(mu.full().ravel()) == space.group.dim - len(space.casimirs)


def test_a_function_that_is_no_casimir_does_not_commute() -> None:
    assert abs(float(SE3_DUAL.bracket(lambda mu: ca.sumsqr(mu[3:]), lambda mu: mu[0])(point(SE3_DUAL)))) > 1e-3


@by_name
def test_tensor_field_and_bracket_agree(space: LiePoisson) -> None:
    f, h = functions(space, 4, 2)
    mu = point(space)
    df, dh = (space.differential(x, mu).full().ravel() for x in (f, h))
    tensor = space.tensor(mu.full().ravel())
    np.testing.assert_allclose(tensor, -tensor.T, atol=1e-15)
    np.testing.assert_allclose(tensor @ dh, space.field(h, mu).full().ravel(), atol=1e-12)
    value = float(space.bracket(f, h)(mu))
    assert df @ tensor @ dh == pytest.approx(value, rel=1e-12)


def test_legendre_transform_of_the_heavy_top() -> None:
    """Lie-Poisson on (so(3) x R^3)* and Euler-Poincare with an advected direction are one equation (chapter 4.17)."""
    inertia, moment = np.array([[1.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 2.5]]), np.array([0.1, -0.2, 0.8])
    up, spin = so3.exp([0.4, -0.3, 0.9]).T @ UP, np.array([0.7, -1.1, 0.5])
    inverse, weight, system = ca.DM(np.linalg.inv(inertia)), ca.DM(9.81 * moment), heavy_top(inertia, moment)
    rate = SEMIDIRECT_DUAL.field(
        lambda mu: 0.5 * ca.dot(mu[:3], inverse @ mu[:3]) + ca.dot(weight, mu[3:]), ca.DM(np.r_[inertia @ spin, up])
    )
    slope = system.acceleration(0.0, np.eye(3), spin, up, system.parameters).full().ravel()
    np.testing.assert_allclose(rate.full().ravel(), np.r_[inertia @ slope, np.cross(up, spin)], atol=1e-13)


def test_chapters_brackets_on_rotations_and_on_the_semidirect_product() -> None:
    f, g = functions(SEMIDIRECT_DUAL, 5, 2)
    mu = point(SEMIDIRECT_DUAL)
    df, dg = (SEMIDIRECT_DUAL.differential(x, mu).full().ravel() for x in (f, g))
    pi, gamma = np.split(mu.full().ravel(), 2)
    expected = -pi @ np.cross(df[:3], dg[:3]) - gamma @ (np.cross(df[:3], dg[3:]) - np.cross(dg[:3], df[3:]))
    assert float(SEMIDIRECT_DUAL.bracket(f, g)(mu)) == pytest.approx(expected, rel=1e-12)
    f, g = functions(SO3_DUAL, 5, 2)
    mu = point(SO3_DUAL)
    df, dg = (SO3_DUAL.differential(x, mu).full().ravel() for x in (f, g))
    assert float(SO3_DUAL.bracket(f, g)(mu)) == pytest.approx(-mu.full().ravel() @ np.cross(df, dg), rel=1e-12)


def test_special_leaves() -> None:
    assert SO3_DUAL.orbit_dimension(np.zeros(3)) == 0
    assert SE3_DUAL.orbit_dimension(np.r_[np.zeros(3), 1.0, 2.0, 3.0]) == 2
    assert SE3_DUAL.orbit_dimension(1e-12 * np.arange(1.0, 7.0)) == 4  # small is not special
    poses = so3.exp(np.random.default_rng(0).normal(size=(50, 3)))
    sphere = body_momentum(SO3, poses, np.tile([0.0, 0.0, 2.0], (50, 1)))
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 2.0, rtol=1e-14)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match=r"mu: got shape \(2,\)"):
        SO3_DUAL.tensor(np.zeros(2))
