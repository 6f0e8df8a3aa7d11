"""Quaternions and rotations: the double cover, half turns, both conversions."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.lie.symbolic import quaternion as symbolic

AXES = [np.array(axis) / np.linalg.norm(axis) for axis in ((1, 0, 0), (0, -1, 0), (0, 0, -1), (-1, 2, 3), (1, -1, 0))]
unhurried = settings(deadline=None)  # a loaded machine is no failure
entries = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(entries, entries, entries, entries)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
vectors = st.tuples(*[st.floats(-10.0, 10.0)] * 3).map(np.array)


@unhurried
@given(quaternions)
def test_both_signs_are_the_same_rotation(q: np.ndarray) -> None:
    assert np.array_equal(quaternion.log(q), quaternion.log(-q))
    assert np.array_equal(quaternion.canonical(q), quaternion.canonical(-q))
    assert np.array_equal(quaternion.to_matrix(q), quaternion.to_matrix(-q))


@unhurried
@given(quaternions, quaternions, vectors)
def test_the_double_cover_is_a_homomorphism(p: np.ndarray, q: np.ndarray, point: np.ndarray) -> None:
    product = quaternion.compose(p, q)
    np.testing.assert_allclose(
        so3.from_quaternion(product), so3.from_quaternion(p) @ so3.from_quaternion(q), atol=4e-15
    )
    np.testing.assert_allclose(quaternion.act(q, point), so3.from_quaternion(q) @ point, atol=1e-13)
    np.testing.assert_allclose(quaternion.compose(q, quaternion.inverse(q)), quaternion.identity(), atol=1e-15)


@unhurried
@given(quaternions)
def test_matrix_and_back(q: np.ndarray) -> None:
    matrix = so3.from_quaternion(q)
    np.testing.assert_allclose(matrix, Rotation.from_quat(q).as_matrix(), atol=2e-15)
    back = so3.to_quaternion(matrix)
    assert abs(np.linalg.norm(back) - 1.0) < 1e-15
    assert abs(abs(back @ q) - 1.0) < 1e-15
    np.testing.assert_allclose(so3.from_quaternion(back), matrix, atol=3e-15)


@unhurried
@given(vectors)
def test_exp_through_quaternions_is_exp(phi: np.ndarray) -> None:
    np.testing.assert_allclose(quaternion.to_matrix(quaternion.exp(phi)), so3.exp(phi), atol=1e-14)


@unhurried
@given(vectors)
def test_log_is_the_shortest_rotation_vector(phi: np.ndarray) -> None:
    angle = np.linalg.norm(phi)
    wrapped = angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))
    got = so3.log(so3.exp(phi))
    assert np.linalg.norm(got) == pytest.approx(abs(wrapped), abs=1e-14)
    np.testing.assert_allclose(so3.exp(got), so3.exp(phi), atol=2e-14)


@pytest.mark.parametrize("angle", np.geomspace(1e-15, 3.0, 40))
def test_log_keeps_relative_accuracy(angle: float) -> None:
    for axis in AXES:
        phi = angle * axis
        for got in (so3.log(so3.exp(phi)), quaternion.log(quaternion.exp(phi))):
            assert np.linalg.norm(got - phi) <= 1e-15 * angle


@pytest.mark.parametrize("axis", AXES, ids=str)
def test_sign_at_exactly_half_a_turn(axis: np.ndarray) -> None:
    """Documented: of the two equally near vectors, the one whose first non-zero entry is positive."""
    leading = axis[np.flatnonzero(axis)[0]]
    expected = math.pi * axis * np.sign(leading)
    q = np.r_[axis, 0.0]
    batch = np.stack([q, -q, np.r_[axis, -0.0]])
    for got in (*map(quaternion.log, batch), *quaternion.log(batch)):
        np.testing.assert_allclose(got, expected, rtol=4e-16)
    half_turn = 2.0 * np.outer(axis, axis) - np.eye(3)
    np.testing.assert_allclose(so3.log(half_turn), expected, atol=1e-15)
    x = ca.SX.sym("x", 4)
    twin = ca.Function("log", [x], [symbolic.log(x)])
    for value in batch:
        np.testing.assert_allclose(twin(value).full().ravel(), expected, rtol=4e-16)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_log_follows_the_axis_up_to_half_a_turn(gap: float) -> None:
    for axis in AXES:
        phi = (math.pi - gap) * axis
        for sign in (1.0, -1.0):
            np.testing.assert_allclose(quaternion.log(sign * quaternion.exp(phi)), phi, atol=2e-15)
            beyond = quaternion.exp((math.pi + gap) * axis)
            np.testing.assert_allclose(quaternion.log(sign * beyond), -(math.pi - gap) * axis, atol=2e-15)


def test_exp_is_continuous_beyond_half_a_turn() -> None:
    angles = np.linspace(0.0, 4.0 * math.pi, 1000)
    steps = np.diff(quaternion.exp(angles[:, None] * AXES[3]), axis=0)
    assert np.linalg.norm(steps, axis=1).max() < 0.0064


def test_every_column_of_the_matrix_can_be_the_longest() -> None:
    """Half turns about each axis, and none, select each entry of the quaternion as the largest."""
    for k in range(4):
        q = np.full(4, 0.1)
        q[k] = 1.0
        q /= np.linalg.norm(q)
        np.testing.assert_allclose(so3.to_quaternion(so3.from_quaternion(q)), q, atol=2e-16)
        np.testing.assert_allclose(so3.to_quaternion(so3.from_quaternion(q)[None])[0], q, atol=2e-16)


@unhurried
@given(quaternions, quaternions, vectors)
def test_casadi_functions(p: np.ndarray, q: np.ndarray, phi: np.ndarray) -> None:
    np.testing.assert_allclose(TWINS["compose"](p, q).full().ravel(), quaternion.compose(p, q), atol=2e-15)
    np.testing.assert_allclose(TWINS["act"](q, phi).full().ravel(), quaternion.act(q, phi), atol=1e-13)
    np.testing.assert_allclose(TWINS["exp"](phi).full().ravel(), quaternion.exp(phi), atol=4e-15)
    np.testing.assert_allclose(TWINS["canonical"](q).full().ravel(), quaternion.canonical(q), atol=0)
    np.testing.assert_allclose(TWINS["inverse"](q).full().ravel(), quaternion.inverse(q), atol=0)
    np.testing.assert_allclose(TWINS["to_matrix"](q).full(), quaternion.to_matrix(q), atol=2e-15)
    np.testing.assert_allclose(TWINS["log"](q).full().ravel(), quaternion.log(q), atol=4e-15)
    rotation = quaternion.to_matrix(q)
    if abs(q[3]) > 1e-12:  # at half a turn the sign depends on rounding
        np.testing.assert_allclose(
            TWINS["from_matrix"](rotation).full().ravel(), so3.to_quaternion(rotation), atol=2e-15
        )


def _twins() -> dict[str, ca.Function]:
    p, q, v, r = ca.SX.sym("p", 4), ca.SX.sym("q", 4), ca.SX.sym("v", 3), ca.SX.sym("r", 3, 3)
    unary = ("canonical", "inverse", "to_matrix", "log")
    twins = {name: ca.Function(name, [q], [getattr(symbolic, name)(q)]) for name in unary}
    twins["compose"] = ca.Function("compose", [p, q], [symbolic.compose(p, q)])
    twins["act"] = ca.Function("act", [q, v], [symbolic.act(q, v)])
    twins["exp"] = ca.Function("exp", [v], [symbolic.exp(v)])
    twins["from_matrix"] = ca.Function("from_matrix", [r], [symbolic.from_matrix(r)])
    return twins


TWINS = _twins()


@unhurried
@given(quaternions, vectors)
def test_project_returns_the_nearest_rotation(q: np.ndarray, noise: np.ndarray) -> None:
    rotation = so3.from_quaternion(q)
    stretched = rotation @ (np.eye(3) + 0.02 * np.diag(noise) + 0.01 * (np.ones((3, 3)) - np.eye(3)))
    # A positive definite stretch is what the polar decomposition removes.
    np.testing.assert_allclose(so3.project(stretched), rotation, atol=1e-13)
    np.testing.assert_allclose(so3.project(rotation), rotation, atol=3e-15)


def test_project_refuses_matrices_far_from_every_rotation() -> None:
    for matrix in (np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3))):
        with pytest.raises(InputError, match="determinant"):
            so3.project(matrix)
    with pytest.raises(InputError, match="approximate"):
        so3.project(np.full((3, 3), np.nan))
