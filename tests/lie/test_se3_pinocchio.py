"""SE(3) and SO(3) against Pinocchio, at the angles where Pinocchio is accurate."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.lie import se3, sek3, so3

# Pinocchio 4.1 switches to short series near 1.2e-4 and cancels just above it: Jexp6 is off by 3e-5 at 2e-4.
ACCURATE = (0.0, 1e-12, 1e-8, 1e-5, 0.3, 1.0, 2.5, math.pi - 1e-6)


def twist(angle: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xi = rng.normal(size=6)
    xi[3:] *= angle / np.linalg.norm(xi[3:])
    return xi


@pytest.mark.parametrize("angle", ACCURATE)
def test_exp_log_and_their_jacobians(angle: float) -> None:
    for seed in range(10):
        xi = twist(angle, seed)
        placement = pin.exp6(xi)
        np.testing.assert_allclose(se3.exp(xi), placement.homogeneous, atol=1e-14)
        np.testing.assert_allclose(se3.log(placement.homogeneous), pin.log6(placement).vector, atol=2e-14)
        np.testing.assert_allclose(se3.right_jacobian(xi), pin.Jexp6(xi), atol=2e-12)
        np.testing.assert_allclose(se3.right_jacobian_inverse(xi), pin.Jlog6(placement), atol=2e-12)
        np.testing.assert_allclose(so3.exp(xi[3:]), pin.exp3(xi[3:]), atol=1e-15)
        np.testing.assert_allclose(so3.log(placement.rotation), pin.log3(placement.rotation), atol=2e-15)
        np.testing.assert_allclose(so3.right_jacobian(xi[3:]), pin.Jexp3(xi[3:]), atol=2e-14)
        np.testing.assert_allclose(so3.right_jacobian_inverse(xi[3:]), pin.Jlog3(placement.rotation), atol=2e-14)


def test_adjoints_and_crosses() -> None:
    rng = np.random.default_rng(0)
    for seed in range(10):
        placement = pin.exp6(twist(2.0, seed))
        x, y, f = rng.normal(size=(3, 6))
        matrix = placement.homogeneous
        np.testing.assert_allclose(se3.adjoint(matrix), placement.action, atol=1e-15)
        np.testing.assert_allclose(se3.adjoint(matrix) @ x, placement.act(pin.Motion(x)).vector, atol=1e-14)
        np.testing.assert_allclose(se3.ad(x), pin.Motion(x).action, atol=0)
        np.testing.assert_allclose(se3.ad(x) @ y, pin.Motion(x).cross(pin.Motion(y)).vector, atol=1e-14)
        np.testing.assert_allclose(se3.force_cross(x) @ f, pin.Motion(x).cross(pin.Force(f)).vector, atol=1e-14)
        np.testing.assert_allclose(se3.inverse(matrix), placement.inverse().homogeneous, atol=1e-15)
        np.testing.assert_allclose(se3.act(matrix, x[:3]), placement.act(x[:3]), atol=1e-14)


def test_se1_is_se3_with_the_halves_swapped() -> None:
    for angle in ACCURATE:
        xi = twist(angle, 3)
        swapped = np.r_[xi[3:], xi[:3]]
        order = np.r_[3:6, 0:3]
        np.testing.assert_allclose(sek3.exp(swapped), se3.exp(xi), atol=1e-15)
        np.testing.assert_allclose(sek3.left_jacobian(swapped), se3.left_jacobian(xi)[np.ix_(order, order)], atol=0)
        np.testing.assert_allclose(sek3.ad(swapped), se3.ad(xi)[np.ix_(order, order)], atol=0)
