"""Robot states: against Pinocchio and the matrix exponential, near half a turn, and for both signs of quaternions."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings, strategies as st
from scipy.linalg import expm

from lgmpc.errors import ModelError
from lgmpc.state import StateMultibody, difference_symbolic, integrate_configuration_symbolic

# 1e-4 .. 1e-2 is where Pinocchio's own Jacobians of the free-flyer lose up to eleven digits.
ANGLES = (0.0, 1e-12, 1e-8, 1e-4, 2e-4, 1e-3, 1e-2, 1.0, 3.0, math.pi - 1e-6)
ROTATIONS = {"root": 3, "ball": 0, "second_root": 3}
GRID = pytest.mark.parametrize("angle", ANGLES, ids=lambda angle: f"{angle:.10g}")


def tangent(state: StateMultibody, angle: float, seed: int) -> np.ndarray:
    """A random tangent vector that turns every rotation and every continuous joint by ``angle``."""
    dx = np.random.default_rng(seed).normal(size=state.ndx)
    for name, joint in zip(state.model.names, state.model.joints, strict=True):
        if name in ROTATIONS:
            i = slice(joint.idx_v + ROTATIONS[name], joint.idx_v + joint.nv)
            dx[i] *= angle / np.linalg.norm(dx[i])
        elif name.startswith("continuous"):
            dx[joint.idx_v] = angle
    return dx


def start(state: StateMultibody, seed: int) -> np.ndarray:
    return state.integrate(state.neutral(), np.random.default_rng(100 + seed).normal(size=state.ndx))


def quaternions(state: StateMultibody) -> list[slice]:
    joints = [state.model.joints[state.model.getJointId(name)] for name in ROTATIONS]
    return [slice(joint.idx_q + joint.nq - 4, joint.idx_q + joint.nq) for joint in joints]


def ad(state: StateMultibody, dx: np.ndarray) -> np.ndarray:
    """The bracket of the whole space: block-diagonal, zero for everything that only adds."""
    result = np.zeros((state.ndx, state.ndx))
    for name in ROTATIONS:
        joint = state.model.joints[state.model.getJointId(name)]
        i = slice(joint.idx_v, joint.idx_v + joint.nv)
        result[i, i] = pin.skew(dx[i]) if joint.nv == 3 else pin.Motion(dx[i]).action
    return result


def right_jacobian(bracket: np.ndarray) -> np.ndarray:
    n = len(bracket)
    return expm(np.block([[-bracket, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]


def test_sizes_and_layout(multibody) -> None:
    model = multibody.model
    assert (multibody.nx, multibody.ndx) == (model.nq + model.nv, 2 * model.nv)
    assert np.array_equal(multibody.neutral(), np.r_[pin.neutral(model), np.zeros(model.nv)])
    x = start(multibody, 0)
    dx = tangent(multibody, 1.0, 0)
    moved = multibody.integrate(x, dx)
    np.testing.assert_allclose(moved[: model.nq], pin.integrate(model, x[: model.nq], dx[: model.nv]), atol=0)
    np.testing.assert_allclose(moved[model.nq :], x[model.nq :] + dx[model.nv :], atol=0)


@GRID
def test_single_and_batch_agree_with_pinocchio(multibody, angle) -> None:
    model, nq, nv = multibody.model, multibody.nq, multibody.nv
    for seed in range(5):
        x, dx = start(multibody, seed), tangent(multibody, angle, seed)
        expected = pin.integrate(model, x[:nq], dx[:nv])
        for got in (multibody.integrate(x, dx), multibody.integrate(x[None], dx[None])[0]):
            np.testing.assert_allclose(got[:nq], expected, atol=3e-14)
        y = multibody.integrate(x, dx)
        # Pinocchio's difference of continuous joints is good to 2e-8 only, at 0 and near half a turn.
        tolerance = np.full(nv, 5e-14)
        tolerance[[7, 14]] = 2e-8
        expected = pin.difference(model, x[:nq], y[:nq])
        for got in (multibody.diff(x, y), multibody.diff(x[None], y[None])[0]):
            assert np.all(np.abs(got[:nv] - expected) <= tolerance)
            np.testing.assert_allclose(got, dx, atol=2e-14)


@GRID
def test_jacobians_equal_those_of_the_matrix_exponential(multibody, angle) -> None:
    for seed in range(3):
        x, dx = start(multibody, seed), tangent(multibody, angle, seed)
        bracket = ad(multibody, dx)
        right = right_jacobian(bracket)
        jx, jdx = multibody.Jintegrate(x, dx)
        np.testing.assert_allclose(jx, expm(-bracket), atol=2e-14)
        np.testing.assert_allclose(jdx, right, atol=2e-14)
        j0, j1 = multibody.Jdiff(x, multibody.integrate(x, dx))
        inverse = np.linalg.inv(right)
        np.testing.assert_allclose(j1, inverse, atol=5e-14)
        np.testing.assert_allclose(j0, -inverse @ expm(-bracket), atol=5e-14)


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_jdiff_against_central_differences_near_half_a_turn(multibody, gap) -> None:
    x0 = start(multibody, 0)
    x1 = multibody.integrate(x0, tangent(multibody, math.pi - gap, 0))
    step = 0.02 * gap  # the stencil must not cross half a turn
    for flipped in quaternions(multibody):
        x1[flipped] *= -1.0
        j0, j1 = multibody.Jdiff(x0, x1)
        for k in range(multibody.nv):
            e = np.zeros(multibody.ndx)
            e[k] = step
            from0 = multibody.diff(multibody.integrate(x0, e), x1) - multibody.diff(multibody.integrate(x0, -e), x1)
            from1 = multibody.diff(x0, multibody.integrate(x1, e)) - multibody.diff(x0, multibody.integrate(x1, -e))
            tolerance = 1e-8 + 1e-14 / step + 10.0 * step**2
            np.testing.assert_allclose(j0[:, k], from0 / (2.0 * step), atol=tolerance)
            np.testing.assert_allclose(j1[:, k], from1 / (2.0 * step), atol=tolerance)


@GRID
def test_both_signs_of_quaternions_are_the_same_state(multibody, angle) -> None:
    x, y = start(multibody, 1), multibody.integrate(start(multibody, 1), tangent(multibody, angle, 1))
    expected, jacobians = multibody.diff(x, y), multibody.Jdiff(x, y)
    a, b = ca.SX.sym("a", multibody.nx), ca.SX.sym("b", multibody.nx)
    twin = ca.Function("diff", [a, b], [multibody.diff_symbolic(a, b)])
    for i in quaternions(multibody):
        x[i] *= -1.0
        for first, second in ((x, y), (y, x)):
            sign = 1.0 if first is x else -1.0
            for got in (
                multibody.diff(first, second),
                multibody.diff(first[None], second[None])[0],
                twin(first, second).full().ravel(),
            ):
                turn = [slice(j.idx_v, j.idx_v + j.nv) for j in multibody.model.joints[1:] if j.nv in (1, 3)]
                for k in turn:  # vectors and rotations: the reverse difference is the negative
                    np.testing.assert_allclose(got[k], sign * expected[k], atol=3e-14)
                if sign > 0:
                    np.testing.assert_allclose(got, expected, atol=3e-14)
        for got, wanted in zip(multibody.Jdiff(x, y), jacobians, strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-13)


def test_exactly_half_a_turn_has_one_documented_answer(multibody) -> None:
    """First non-zero entry positive, whatever the signs of the quaternions, in all three implementations."""
    a, b = ca.SX.sym("a", multibody.nx), ca.SX.sym("b", multibody.nx)
    twin = ca.Function("diff", [a, b], [multibody.diff_symbolic(a, b)])
    x = multibody.neutral()
    for axis in ((1, 0, 0), (0, -1, 0), (0, 0, -1), (-1, 1, 0)):
        u = np.array(axis) / np.linalg.norm(axis)
        expected = math.pi * u * np.sign(u[np.flatnonzero(u)[0]])
        for sign in (1.0, -1.0):
            y = multibody.neutral()
            for i in quaternions(multibody):
                y[i] = sign * np.r_[u, 0.0]
            for got in (multibody.diff(x, y), multibody.diff(x[None], y[None])[0], twin(x, y).full().ravel()):
                for i in (slice(3, 6), slice(10, 13), slice(19, 22)):
                    np.testing.assert_allclose(got[i], expected, rtol=4e-16)


def test_continuous_joints_keep_all_digits_up_to_half_a_turn(make_model) -> None:
    state = StateMultibody(make_model(continuous=pin.JointModelRUBX()))
    x = np.r_[np.cos(0.3), np.sin(0.3), 0.0]
    for gap in (1e-3, 1e-6, 1e-8, 1e-12):
        for sign in (1.0, -1.0):
            dx = np.array([sign * (math.pi - gap), 0.0])
            np.testing.assert_allclose(state.diff(x, state.integrate(x, dx)), dx, atol=1e-15)


def test_long_rollouts_stay_on_the_manifold(multibody) -> None:
    x, rng = multibody.neutral(), np.random.default_rng(0)
    batch = x[None]
    for _ in range(2000):
        dx = 0.1 * rng.normal(size=multibody.ndx)
        x, batch = multibody.integrate(x, dx), multibody.integrate(batch, dx[None])
    for i in quaternions(multibody):
        assert abs(np.linalg.norm(x[i]) - 1.0) < 1e-14
        assert abs(np.linalg.norm(batch[0, i]) - 1.0) < 1e-14
    np.testing.assert_allclose(multibody.diff(x, batch[0]), np.zeros(multibody.ndx), atol=1e-10)


def test_integrate_pulls_drifted_states_back_onto_the_manifold(multibody) -> None:
    x = start(multibody, 0)
    units = [*quaternions(multibody), slice(8, 10), slice(17, 19)]
    for i in units:
        assert np.linalg.norm(x[i]) == pytest.approx(1.0, abs=1e-14)
        x[i] *= 1.0 + 1e-4
    dx = tangent(multibody, 1.0, 0)
    for got in (multibody.integrate(x, dx), multibody.integrate(x[None], dx[None])[0]):
        for i in units:
            assert abs(np.linalg.norm(got[i]) - 1.0) < 2e-8  # Pinocchio takes one Newton step


scalars = st.floats(-3.0, 3.0, allow_subnormal=False)


vectors = st.lists(scalars, min_size=22, max_size=22).map(np.array)


def one_of_each_group() -> StateMultibody:
    model = pin.Model()
    for joint in (pin.JointModelFreeFlyer(), pin.JointModelSpherical(), pin.JointModelRUBZ(), pin.JointModelRX()):
        model.addJoint(model.njoints - 1, joint, pin.SE3.Identity(), f"joint {model.njoints}")
    return StateMultibody(model)


SMALL = one_of_each_group()


@settings(deadline=None)  # a loaded machine is no failure
@given(vectors, vectors)
def test_integrating_the_difference_reaches_the_target(first: np.ndarray, second: np.ndarray) -> None:
    state = SMALL
    x0, x1 = state.integrate(state.neutral(), first), state.integrate(state.neutral(), second)
    d = state.diff(x0, x1)
    assert np.linalg.norm(d[3:6]) <= math.pi + 1e-15 and np.linalg.norm(d[6:9]) <= math.pi + 1e-15
    np.testing.assert_allclose(state.diff(x1, state.integrate(x0, d)), np.zeros(state.ndx), atol=1e-13)


def test_limits_come_from_the_model(multibody) -> None:
    model, nv = multibody.model, multibody.nv
    unlimited = np.zeros(nv, dtype=bool)
    for name in ("root", "continuous_y", "ball", "continuous_oblique", "second_root"):
        joint = model.joints[model.getJointId(name)]
        unlimited[joint.idx_v : joint.idx_v + joint.nv] = True
    assert np.array_equal(multibody.lower[:nv], np.where(unlimited, -np.inf, -2.0))
    assert np.array_equal(multibody.upper[:nv], np.where(unlimited, np.inf, 2.0))
    assert np.array_equal(multibody.lower[nv:], np.full(nv, -3.0))
    assert np.array_equal(multibody.upper[nv:], np.full(nv, 3.0))
    with pytest.raises(ValueError, match="read-only"):
        multibody.lower[0] = 0.0


def test_the_largest_float_means_no_limit() -> None:
    state = StateMultibody(pin.buildSampleModelHumanoid())
    assert not np.any(np.abs(state.lower) > 1e300, where=np.isfinite(state.lower))
    assert np.all(np.isinf(state.upper[:6]))


def test_velocity_limits_of_a_urdf_are_symmetric() -> None:
    """Pinocchio 4.1 writes the same positive number into the lower velocity limit."""
    urdf = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>
    <child link="b"/><axis xyz="1 0 0"/><limit lower="-1" upper="2" effort="3" velocity="4"/></joint></robot>"""
    state = StateMultibody(pin.buildModelFromXML(urdf))
    assert np.array_equal(state.lower, [-1.0, -4.0])
    assert np.array_equal(state.upper, [2.0, 4.0])


def test_unsupported_joints_are_all_named(make_model) -> None:
    model = make_model(
        floor=pin.JointModelPlanar(),
        knee=pin.JointModelRX(),
        screw=pin.JointModelHX(0.1),
        hub=pin.JointModelUniversal(),
    )
    q, v = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv)
    for attempt in (
        lambda: StateMultibody(model),
        lambda: integrate_configuration_symbolic(model, q, v),
        lambda: difference_symbolic(model, q, q),
    ):
        with pytest.raises(ModelError, match="free-flyer, spherical, revolute, continuous") as caught:
            attempt()
        assert caught.value.robot == "chain"
        assert [problem.split("'")[1] for problem in caught.value.problems] == ["floor", "screw", "hub"]


def test_symbolic_configuration_functions_are_pinocchios(multibody) -> None:
    """Including the hemisphere of quaternions that turn by more than pi."""
    model = multibody.model
    q, r, v = ca.SX.sym("q", model.nq), ca.SX.sym("r", model.nq), ca.SX.sym("v", model.nv)
    integrate = ca.Function("integrate", [q, v], [integrate_configuration_symbolic(model, q, v)])
    difference = ca.Function("difference", [q, r], [difference_symbolic(model, q, r)])
    for seed, angle in enumerate((0.0, 1e-9, 1.0, 3.0, 3.3, 5.0, 7.0, 12.0)):
        q0, step = start(multibody, seed)[: model.nq], tangent(multibody, angle, seed)[: model.nv]
        q1 = pin.integrate(model, q0, step)
        np.testing.assert_allclose(integrate(q0, step).full().ravel(), q1, atol=3e-14)
        np.testing.assert_allclose(difference(q0, q1).full().ravel(), pin.difference(model, q0, q1), atol=1e-13)


@pytest.mark.parametrize("step", [math.inf, -math.inf, math.nan])
def test_steps_that_are_no_numbers_give_nan(step: float) -> None:
    """A diverging roll-out has a result that a solver can reject."""
    state = StateMultibody(pin.buildSampleModelHumanoid())
    dx = np.zeros(state.ndx)
    dx[:6] = step
    with np.errstate(invalid="ignore"):
        assert np.isnan(state.integrate(state.neutral(), dx)).any()
        assert np.isnan(state.Jintegrate(state.neutral(), dx)[1]).any()
        assert np.isnan(state.integrate(np.tile(state.neutral(), (2, 1)), np.tile(dx, (2, 1)))).any()
