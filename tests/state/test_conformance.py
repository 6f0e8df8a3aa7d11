"""The contract of a state space, on every kind of state: laws, Jacobians, batches, CasADi functions, refusals."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.state import ProductState, State, StateMultibody

SYMBOLS = pytest.mark.parametrize("symbol", [ca.SX, ca.MX], ids=["SX", "MX"])


def central_difference(function: Callable[[np.ndarray], np.ndarray], size: int, step: float) -> np.ndarray:
    columns = []
    for e in np.eye(size) * step:
        near, far = function(e) - function(-e), function(2 * e) - function(-2 * e)
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


def step(state: State, seed: int, scale: float = 1.0) -> np.ndarray:
    """A tangent vector whose rotations stay below half a turn."""
    return scale * np.random.default_rng(seed).uniform(-1.5, 1.5, state.ndx)


def test_diff_inverts_integrate(state, points) -> None:
    for seed, x in enumerate(points):
        for scale in (0.0, 1e-12, 1e-8, 1e-4, 1e-2, 1.0):
            dx = step(state, seed, scale)
            # Absolute, to rounding of the coordinates, which are of order 1.
            np.testing.assert_allclose(state.diff(x, state.integrate(x, dx)), dx, rtol=1e-14, atol=2e-14)


def test_integrate_inverts_diff(state, points) -> None:
    for x0, x1 in zip(points, points[1:], strict=False):
        reached = state.integrate(x0, state.diff(x0, x1))
        np.testing.assert_allclose(state.diff(x1, reached), np.zeros(state.ndx), atol=1e-13)


def test_zero_steps(state, points) -> None:
    zero = np.zeros(state.ndx)
    for x in points:
        np.testing.assert_allclose(state.integrate(x, zero), x, atol=1e-15)
        np.testing.assert_allclose(state.diff(x, x), zero, atol=1e-15)


def test_arguments_are_unchanged_and_results_are_new(state, points) -> None:
    x0, x1 = points[0].copy(), points[1].copy()
    dx = state.diff(x0, x1)
    kept = dx.copy()
    moved = state.integrate(x0, dx)
    moved[:] = 0.0
    for jacobian in (*state.Jintegrate(x0, dx), *state.Jdiff(x0, x1), state.neutral()):
        jacobian[:] = 9.0
    assert np.array_equal(x0, points[0]) and np.array_equal(x1, points[1]) and np.array_equal(dx, kept)
    assert not np.any(state.neutral() == 9.0)
    assert not np.any(state.Jintegrate(x0, dx)[0] == 9.0)


def test_jintegrate_against_central_differences(state, points) -> None:
    for seed, x in enumerate(points):
        for scale in (0.0, 1e-3, 1.0):
            dx = step(state, seed, scale)
            end = state.integrate(x, dx)
            jx, jdx = state.Jintegrate(x, dx)

            def from_x(e: np.ndarray, x: np.ndarray = x, dx: np.ndarray = dx, end: np.ndarray = end) -> np.ndarray:
                return state.diff(end, state.integrate(state.integrate(x, e), dx))

            def from_dx(e: np.ndarray, x: np.ndarray = x, dx: np.ndarray = dx, end: np.ndarray = end) -> np.ndarray:
                return state.diff(end, state.integrate(x, dx + e))

            np.testing.assert_allclose(jx, central_difference(from_x, state.ndx, 1e-3), atol=1e-9)
            np.testing.assert_allclose(jdx, central_difference(from_dx, state.ndx, 1e-3), atol=1e-9)


def test_jdiff_against_central_differences(state, points) -> None:
    for seed, x0 in enumerate(points):
        for scale in (0.0, 1e-3, 1.0):
            x1 = state.integrate(x0, step(state, seed, scale))
            j0, j1 = state.Jdiff(x0, x1)

            def from_x0(e: np.ndarray, x0: np.ndarray = x0, x1: np.ndarray = x1) -> np.ndarray:
                return state.diff(state.integrate(x0, e), x1)

            def from_x1(e: np.ndarray, x0: np.ndarray = x0, x1: np.ndarray = x1) -> np.ndarray:
                return state.diff(x0, state.integrate(x1, e))

            np.testing.assert_allclose(j0, central_difference(from_x0, state.ndx, 1e-3), atol=1e-8)
            np.testing.assert_allclose(j1, central_difference(from_x1, state.ndx, 1e-3), atol=1e-8)


def test_jdiff_undoes_jintegrate(state, points) -> None:
    """diff(x, integrate(x, dx)) = dx: the chain rule ties the two, argument by argument."""
    for seed, x in enumerate(points):
        dx = step(state, seed)
        jx, jdx = state.Jintegrate(x, dx)
        j0, j1 = state.Jdiff(x, state.integrate(x, dx))
        np.testing.assert_allclose(j1 @ jdx, np.eye(state.ndx), atol=2e-14)
        np.testing.assert_allclose(j0 + j1 @ jx, np.zeros((state.ndx, state.ndx)), atol=2e-14)


def test_batches_equal_single_states(state) -> None:
    rng = np.random.default_rng(0)
    origins = np.tile(state.neutral(), (2, 3, 1))
    x = state.integrate(origins, rng.uniform(-2.0, 2.0, size=(2, 3, state.ndx)))
    # Longer than half a turn, too, where the quaternion of a free-flyer must keep its hemisphere.
    dx = 3.0 * rng.normal(size=(2, 3, state.ndx))
    x1 = state.integrate(x, dx)
    j = state.Jintegrate(x, dx)
    d, k = state.diff(x, x[::-1]), state.Jdiff(x, x[::-1])
    for i in np.ndindex(2, 3):
        np.testing.assert_allclose(x1[i], state.integrate(x[i], dx[i]), atol=1e-13)
        np.testing.assert_allclose(d[i], state.diff(x[i], x[::-1][i]), atol=1e-13)
        for batch, single in zip(
            (*j, *k), (*state.Jintegrate(x[i], dx[i]), *state.Jdiff(x[i], x[::-1][i])), strict=True
        ):
            np.testing.assert_allclose(batch[i], single, atol=1e-12)


@SYMBOLS
def test_casadi_derivatives_are_the_jacobians_at_zero_too(state, points, symbol) -> None:
    x, y, z = (symbol.sym(name, state.nx) for name in "xyz")
    dx, e = symbol.sym("dx", state.ndx), symbol.sym("e", state.ndx)
    zero = np.zeros(state.ndx)
    end = state.integrate_symbolic(state.integrate_symbolic(x, e), dx)
    jx = ca.Function("jx", [x, dx, z, e], [ca.jacobian(state.diff_symbolic(z, end), e)])
    jdx = ca.Function("jdx", [x, dx, z], [ca.jacobian(state.diff_symbolic(z, state.integrate_symbolic(x, dx)), dx)])
    j0 = ca.Function("j0", [x, y, e], [ca.jacobian(state.diff_symbolic(state.integrate_symbolic(x, e), y), e)])
    j1 = ca.Function("j1", [x, y, e], [ca.jacobian(state.diff_symbolic(x, state.integrate_symbolic(y, e)), e)])
    for seed, point in enumerate(points[:2]):
        for scale in (0.0, 1e-9, 1e-4, 1.0):
            value = step(state, seed, scale)
            reached = state.integrate(point, value)
            expected = (*state.Jintegrate(point, value), *state.Jdiff(point, reached))
            got = (
                jx(point, value, reached, zero),
                jdx(point, value, reached),
                j0(point, reached, zero),
                j1(point, reached, zero),
            )
            for left, right in zip(got, expected, strict=True):
                np.testing.assert_allclose(left.full(), right, atol=2e-13)


def test_wrong_shapes_are_named(state) -> None:
    x, dx = state.neutral(), np.zeros(state.ndx)
    for function in (state.integrate, state.Jintegrate):
        with pytest.raises(InputError, match=r"x: got shape"):
            function(x[:-1], dx)
        with pytest.raises(InputError, match=r"dx: got shape"):
            function(x, dx[:-1])
        with pytest.raises(InputError, match=r"dx: got shape"):
            function(x, np.zeros((2, state.ndx)))
    for function in (state.diff, state.Jdiff):
        with pytest.raises(InputError, match=r"x0: got shape"):
            function(x[:-1], x)
        with pytest.raises(InputError, match=r"x1: got shape"):
            function(x, np.r_[x, 0.0])


@pytest.mark.parametrize("bad", [None, "text", np.nan, [0.0], {}], ids=lambda bad: type(bad).__name__)
def test_arguments_of_other_types_are_named(state: State, bad: object) -> None:
    x, dx = state.neutral(), np.zeros(state.ndx)
    for function, second in ((state.integrate, dx), (state.diff, x), (state.Jintegrate, dx), (state.Jdiff, x)):
        for arguments in ((bad, second), (x, bad)):
            with pytest.raises(InputError, match="x|dx|x0|x1"):
                function(*arguments)
    for make, name in ((StateMultibody, "model"), (ProductState, "states")):
        with pytest.raises(InputError, match=name):
            make(bad)
