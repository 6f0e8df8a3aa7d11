"""Every axiom and identity on every group, over the seam grid of angles times translations.

The oracles are independent of the code under test: scipy's matrix exponential, products of matrices, central
differences. CasADi functions are compared with the same values, and their derivatives with the generators of the
algebra.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from lgmpc.lie import se3, sek3, so3

SYMBOLS = pytest.mark.parametrize("symbol", [ca.SX, ca.MX], ids=["SX", "MX"])
OF_TANGENTS = (
    "exp",
    "hat",
    "ad",
    "coadjoint",
    "force_cross",
    "left_jacobian",
    "right_jacobian",
    "left_jacobian_inverse",
    "right_jacobian_inverse",
)
OF_ELEMENTS = ("log", "inverse", "adjoint")


def left_jacobian_by_expm(ad: np.ndarray) -> np.ndarray:
    """``integral of expm(s ad), s from 0 to 1``: the corner of one larger exponential."""
    n = len(ad)
    return expm(np.block([[ad, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]


def central_difference(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Fourth-order central differences of a vector function, column by column."""
    columns = []
    for e in np.eye(len(at)) * step:
        near = function(at + e) - function(at - e)
        far = function(at + 2 * e) - function(at - 2 * e)
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


def assert_equal(got: Any, expected: np.ndarray, tolerance: float) -> None:
    """Absolute below 1, relative above."""
    expected = np.asarray(expected)
    np.testing.assert_allclose(np.asarray(got).reshape(expected.shape), expected, rtol=tolerance, atol=tolerance)


def test_every_group_is_under_test(cases) -> None:
    assert {id(case.group) for case in cases} == {id(group) for group in (so3, se3, sek3)}


def test_exp_is_the_matrix_exponential(case, any_angle) -> None:
    for xi in case.tangents(any_angle):
        assert_equal(case.group.exp(xi), expm(case.hat(xi)), 1e-14 * max(1.0, any_angle))


def test_exp_of_zero_is_exactly_the_identity(case) -> None:
    assert np.array_equal(case.group.exp(np.zeros(case.dim)), np.eye(case.size))
    assert np.array_equal(case.group.log(np.eye(case.size)), np.zeros(case.dim))


def test_log_inverts_exp(case, angle) -> None:
    for xi in case.tangents(angle):
        element = case.group.exp(xi)
        got = case.group.log(element)
        assert np.linalg.norm(got[case.angular]) <= math.pi + 1e-15
        if angle < math.pi:
            assert_equal(got, xi, 2e-15)
            # Small rotations keep their relative, not only their absolute, accuracy.
            assert_equal(got[case.angular] / (angle or 1.0), xi[case.angular] / (angle or 1.0), 2e-15)
        assert_equal(case.group.exp(got), element, 3e-15)


def test_exp_inverts_log_near_pi(case, length) -> None:
    for seed in range(20):
        for gap in (0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-3):
            element = expm(case.hat(case.tangent(math.pi - gap, length, seed)))
            assert_equal(case.group.exp(case.group.log(element)), element, 2e-14)


def test_group_axioms(case) -> None:
    group, identity = case.group, np.eye(case.size)
    g, h, k = (case.random(seed) for seed in range(3))
    assert_equal(group.compose(g, h), g @ h, 1e-15)
    assert_equal(group.compose(group.compose(g, h), k), group.compose(g, group.compose(h, k)), 1e-14)
    assert_equal(group.compose(g, identity), g, 1e-15)
    assert_equal(group.compose(g, group.inverse(g)), identity, 1e-14)
    assert_equal(group.compose(group.inverse(g), g), identity, 1e-14)
    assert_equal(group.inverse(g), np.linalg.inv(g), 1e-14)


def test_action_is_a_homomorphism(case) -> None:
    group, point = case.group, np.random.default_rng(5).normal(size=case.ambient)
    g, h = case.random(0), case.random(1)
    assert_equal(group.act(group.compose(g, h), point), group.act(g, group.act(h, point)), 1e-14)
    assert_equal(group.act(np.eye(case.size), point), point, 1e-15)
    homogeneous = np.r_[point, np.ones(case.size - case.ambient)]
    assert_equal(group.act(g, point), (g @ homogeneous)[: case.ambient], 1e-14)


def test_hat_and_vee(case) -> None:
    xi = case.tangent(1.3, 2.0)
    assert np.array_equal(case.group.hat(xi), case.hat(xi))
    assert np.array_equal(case.group.vee(case.hat(xi)), xi)


def test_adjoint_conjugates_the_algebra(case) -> None:
    g, inverse = case.random(0), np.linalg.inv(case.random(0))
    adjoint = case.group.adjoint(g)
    for xi in np.eye(case.dim):
        assert_equal(case.hat(adjoint @ xi), g @ case.hat(xi) @ inverse, 1e-14)
    other = case.random(1)
    assert_equal(case.group.adjoint(g @ other), adjoint @ case.group.adjoint(other), 1e-13)


def test_ad_is_the_bracket(case) -> None:
    xi, generators = case.tangent(1.1, 2.0), case.generators()
    ad = case.group.ad(xi)
    for generator, column in zip(generators, ad.T, strict=True):
        assert_equal(case.hat(column), case.hat(xi) @ generator - generator @ case.hat(xi), 1e-15)


def test_coadjoint_and_force_cross_follow_the_convention(case) -> None:
    rng = np.random.default_rng(3)
    xi, eta, mu = rng.normal(size=(3, case.dim))
    ad = case.group.ad(xi)
    assert (case.group.coadjoint(xi) @ mu) @ eta == pytest.approx(mu @ (ad @ eta), rel=1e-13)
    assert np.array_equal(case.group.force_cross(xi), -ad.T)


def test_adjoint_of_exp_is_exp_of_ad(case, any_angle) -> None:
    for xi in case.tangents(any_angle):
        adjoint = case.group.adjoint(case.group.exp(xi))
        assert_equal(adjoint, expm(case.group.ad(xi)), 3e-14)


def test_left_jacobian_is_the_integral_of_exp_ad(case, any_angle) -> None:
    for xi in case.tangents(any_angle):
        assert_equal(case.group.left_jacobian(xi), left_jacobian_by_expm(case.group.ad(xi)), 2e-14)


def test_jacobians_and_their_inverses(case, any_angle) -> None:
    group = case.group
    for xi in case.tangents(any_angle):
        left, right = group.left_jacobian(xi), group.right_jacobian(xi)
        assert np.array_equal(right, group.left_jacobian(-xi))
        assert_equal(group.adjoint(group.exp(xi)) @ right, left, 3e-14)
        assert_equal(left @ group.left_jacobian_inverse(xi), np.eye(case.dim), 4e-14)
        assert_equal(right @ group.right_jacobian_inverse(xi), np.eye(case.dim), 4e-14)
        # The inverses by themselves, not only in a product that a singular factor could hide.
        assert_equal(group.left_jacobian_inverse(xi), np.linalg.inv(left), 1e-12)


def test_left_jacobian_has_its_coupling_at_zero_angle(case) -> None:
    for angle in (0.0, 1e-12, 1e-8):
        xi = case.tangent(angle, 1.0)
        # To first order in the angle, J = I + ad/2 and J^{-1} = I - ad/2, translations included.
        half = 0.5 * case.group.ad(xi)
        assert_equal(case.group.left_jacobian(xi), np.eye(case.dim) + half, 2.0 * angle + 1e-16)
        assert_equal(case.group.left_jacobian_inverse(xi), np.eye(case.dim) - half, 2.0 * angle + 1e-16)


def test_jacobians_against_central_differences(case, angle, length) -> None:
    group, xi = case.group, case.tangent(angle, length)
    back = np.linalg.inv(expm(case.hat(xi)))

    def by_left(step: np.ndarray) -> np.ndarray:
        return group.log(expm(case.hat(xi + step)) @ back)

    def by_right(step: np.ndarray) -> np.ndarray:
        return group.log(back @ expm(case.hat(xi + step)))

    zero = np.zeros(case.dim)
    assert_equal(group.left_jacobian(xi), central_difference(by_left, zero, 1e-3), 1e-9)
    assert_equal(group.right_jacobian(xi), central_difference(by_right, zero, 1e-3), 1e-9)


def test_batches_equal_single_elements(case) -> None:
    group = case.group
    grid = [(angle, length) for angle in (0.0, 1e-9, 0.3, 1.0, math.pi, 3.5) for length in (0.0, 1.0)]
    xi = np.stack([case.tangent(angle, length, seed) for seed, (angle, length) in enumerate(grid)]).reshape(3, 4, -1)
    singles = list(np.ndindex(3, 4))
    for name in OF_TANGENTS:
        function = getattr(group, name)
        batch = function(xi)
        assert batch.shape[:2] == (3, 4)
        for index in singles:
            assert_equal(batch[index], function(xi[index]), 4e-15)
    elements = group.exp(xi)
    points = np.random.default_rng(0).normal(size=(3, 4, case.ambient))
    for name in OF_ELEMENTS:
        batch = getattr(group, name)(elements)
        for index in singles:
            assert_equal(batch[index], getattr(group, name)(elements[index]), 4e-15)
    assert_equal(group.vee(group.hat(xi)), xi, 1e-16)
    for index in singles:
        assert_equal(group.compose(elements, elements[::-1])[index], elements[index] @ elements[::-1][index], 1e-15)
        assert_equal(group.act(elements, points)[index], group.act(elements[index], points[index]), 1e-15)
        assert_equal(group.act(elements, points[0, 0])[index], group.act(elements[index], points[0, 0]), 1e-15)


def test_an_empty_batch_is_no_error(case) -> None:
    elements = case.group.exp(np.zeros((0, case.dim)))
    assert elements.shape == (0, case.size, case.size)
    assert case.group.log(elements).shape == (0, case.dim)


@SYMBOLS
def test_casadi_functions_of_tangents(case, any_angle, symbol) -> None:
    for xi in case.tangents(any_angle):
        for name in OF_TANGENTS:
            assert_equal(case.function(name, symbol)(xi), getattr(case.group, name)(xi), 2e-14)


@SYMBOLS
def test_casadi_functions_of_elements(case, symbol) -> None:
    g, h = symbol.sym("g", case.size, case.size), symbol.sym("h", case.size, case.size)
    point = symbol.sym("p", case.ambient)
    outputs = [getattr(case.symbolic, name)(g) for name in OF_ELEMENTS]
    outputs += [case.symbolic.compose(g, h), case.symbolic.act(g, point)]
    function = ca.Function("f", [g, h, point], outputs)
    p = np.random.default_rng(0).normal(size=case.ambient)
    for angle in (0.0, 1e-12, 1e-8, 0.3, 1.0, 2.0, 3.0, math.pi - 1e-6):
        for seed in range(6):
            a, b = expm(case.hat(case.tangent(angle, 1.0, seed))), case.random(seed)
            got = function(a, b, p)
            expected = [getattr(case.group, name)(a) for name in OF_ELEMENTS]
            expected += [case.group.compose(a, b), case.group.act(a, p)]
            for left, right in zip(got, expected, strict=True):
                assert_equal(left, right, 2e-14)


def test_casadi_vee_inverts_hat(case) -> None:
    xi = ca.SX.sym("xi", case.dim)
    function = ca.Function("f", [xi], [case.symbolic.vee(case.symbolic.hat(xi))])
    value = case.tangent(1.0, 2.0)
    assert_equal(function(value), value, 1e-16)


@SYMBOLS
def test_casadi_log_agrees_at_exactly_pi(case, symbol) -> None:
    g = symbol.sym("g", case.size, case.size)
    function = ca.Function("log", [g], [case.symbolic.log(g)])
    for axis in ((1, 0, 0), (0, -1, 0), (0, 0, 1), (1, 1, 0), (0, 1, -1), (-1, 1, 1), (-2, 1, 2)):
        u = np.array(axis) / np.linalg.norm(axis)
        element = np.eye(case.size)
        element[:3, :3] = 2.0 * np.outer(u, u) - np.eye(3)  # symmetric: half a turn about u, either way
        element[:3, 3:] = 1.5
        expected = case.group.log(element)
        leading = expected[case.angular][np.flatnonzero(np.abs(expected[case.angular]) > 1e-9)[0]]
        assert leading > 0.0
        assert_equal(np.abs(expected[case.angular]), np.abs(math.pi * u), 1e-15)
        assert_equal(function(element), expected, 2e-14)
        assert_equal(case.group.exp(expected), element, 1e-14)


@lru_cache
def jacobian_of_exp(case: Any, symbol: type) -> ca.Function:
    xi = symbol.sym("xi", case.dim)
    return ca.Function("J", [xi], [ca.jacobian(ca.vec(case.symbolic.exp(xi)), xi)])


@SYMBOLS
def test_casadi_derivatives_of_exp(case, any_angle, symbol) -> None:
    """d exp(xi) = hat(J_left dxi) exp(xi); at 0 that is the generators themselves."""
    jacobian = jacobian_of_exp(case, symbol)
    for length in (0.0, 1.0):
        value = case.tangent(any_angle, length)
        left, element = left_jacobian_by_expm(case.group.ad(value)), expm(case.hat(value))
        expected = np.stack([(case.hat(column) @ element).ravel(order="F") for column in left.T], axis=-1)
        assert_equal(jacobian(value), expected, 3e-14)


def test_casadi_second_derivative_of_exp_at_zero(case) -> None:
    """d^2 exp at 0 is the symmetrised product of generators."""
    xi = ca.SX.sym("xi", case.dim)
    first = ca.jacobian(ca.vec(case.symbolic.exp(xi)), xi)
    second = ca.Function("H", [xi], [ca.jacobian(ca.vec(first), xi)])(np.zeros(case.dim)).full()
    got = second.reshape(case.size**2, case.dim, case.dim, order="F")
    generators = case.generators()
    for i, a in enumerate(generators):
        for j, b in enumerate(generators):
            assert_equal(got[:, i, j], (0.5 * (a @ b + b @ a)).ravel(order="F"), 1e-15)


@lru_cache
def jacobian_of_log(case: Any, symbol: type) -> ca.Function:
    xi = symbol.sym("xi", case.dim)
    return ca.Function("J", [xi], [ca.jacobian(case.symbolic.log(case.symbolic.exp(xi)), xi)])


@SYMBOLS
def test_casadi_derivatives_of_log(case, angle, symbol) -> None:
    """log(exp(xi)) = xi has the identity as its derivative up to just below pi."""
    for value in case.tangents(min(angle, math.pi - 1e-7)):
        assert_equal(jacobian_of_log(case, symbol)(value), np.eye(case.dim), 1e-13)


def test_casadi_derivatives_of_jacobians_at_zero(case) -> None:
    """J_left = I + ad/2 + ..., J_left^{-1} = I - ad/2 + ...: their derivatives at 0 are +-ad of the generators / 2."""
    for name, sign in (
        ("left_jacobian", 0.5),
        ("right_jacobian", -0.5),
        ("left_jacobian_inverse", -0.5),
        ("right_jacobian_inverse", 0.5),
    ):
        xi = ca.SX.sym("xi", case.dim)
        value = ca.vec(getattr(case.symbolic, name)(xi))
        derivative = ca.Function("d", [xi], [ca.jacobian(value, xi)])(np.zeros(case.dim)).full()
        for i, e in enumerate(np.eye(case.dim)):
            assert_equal(derivative[:, i], sign * case.group.ad(e).ravel(order="F"), 1e-15)


@lru_cache
def jacobian_of_gap(case: Any) -> ca.Function:
    """d/de log(exp(xi)^{-1} exp(xi + e))."""
    xi, e = ca.SX.sym("xi", case.dim), ca.SX.sym("e", case.dim)
    symbolic = case.symbolic
    gap = symbolic.log(symbolic.compose(symbolic.inverse(symbolic.exp(xi)), symbolic.exp(xi + e)))
    return ca.Function("J", [xi, e], [ca.jacobian(gap, e)])


def test_right_jacobian_is_the_casadi_derivative(case, any_angle) -> None:
    """One reference for CasADi and numpy, at e = 0."""
    value = case.tangent(any_angle, 1.0)
    assert_equal(jacobian_of_gap(case)(value, np.zeros(case.dim)), case.group.right_jacobian(value), 3e-14)
