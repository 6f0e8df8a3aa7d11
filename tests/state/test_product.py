"""Products and Euclidean spaces."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.state import ProductState, StateMultibody, StateVector


@pytest.fixture
def ball(make_model) -> StateMultibody:
    return StateMultibody(make_model(ball=pin.JointModelSpherical()))


def test_factors_sit_side_by_side(ball) -> None:
    product = ProductState(StateVector(2), ball, StateVector(1))
    assert (product.nx, product.ndx) == (2 + 7 + 1, 2 + 6 + 1)
    assert product.x_slices == (slice(0, 2), slice(2, 9), slice(9, 10))
    assert product.dx_slices == (slice(0, 2), slice(2, 8), slice(8, 9))
    assert np.array_equal(product.neutral(), np.r_[0.0, 0.0, ball.neutral(), 0.0])
    x, dx = product.neutral(), np.arange(9.0) / 10.0
    moved = product.integrate(x, dx)
    assert np.array_equal(moved[2:9], ball.integrate(ball.neutral(), dx[2:8]))
    assert np.array_equal(moved[[0, 1, 9]], dx[[0, 1, 8]])


def test_jacobians_are_block_diagonal(ball) -> None:
    product = ProductState(ball, StateVector(3))
    x, dx = product.neutral(), np.linspace(0.1, 0.9, 9)
    expected = np.zeros((9, 9))
    expected[:6, :6] = ball.Jintegrate(ball.neutral(), dx[:6])[1]
    expected[6:, 6:] = np.eye(3)
    assert np.array_equal(product.Jintegrate(x, dx)[1], expected)


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="states: got none"):
        ProductState()
    assert StateVector(np.int64(2)).nx == 2  # type: ignore[arg-type]
    with pytest.raises(InputError, match="n: got 0"):
        StateVector(0)
    with pytest.raises(InputError, match="n: got 2.5; expected a whole number"):
        StateVector(2.5)
