"""Pinocchio's recursions, and with them ours, against equations of motion derived from energies."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from energies import Energies, centroidal_matrices
from example_robot_data import load

from lgmpc.robot.symbolic import SymbolicModel

TALOS = pytest.param("talos", marks=pytest.mark.slow)


def two_link() -> pin.Model:
    """A trunk, an upper and a lower limb, joints about y and z: exercise H.2."""
    model = pin.Model()
    model.name = "two_link"
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    upper = model.addJoint(base, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.2, 0.1, -0.1])), "upper")
    lower = model.addJoint(upper, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([0.0, 0.05, -0.3])), "lower")
    for joint, mass, lever, moments in (
        (base, 4.0, [0.03, -0.02, 0.05], [0.05, 0.08, 0.1]),
        (upper, 1.2, [0.0, 0.01, -0.15], [0.02, 0.021, 0.004]),
        (lower, 0.7, [0.02, 0.0, -0.12], [0.009, 0.01, 0.002]),
    ):
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.array(lever), np.diag(moments)), pin.SE3.Identity())
    return model


@pytest.fixture(scope="module", params=("two_link", "solo12", "talos_arm", TALOS))
def case(request):
    model = two_link() if request.param == "two_link" else load(request.param).model
    return model, Energies(model)


def states(model: pin.Model, count: int = 4):
    rng = np.random.default_rng(7)
    for _ in range(count):
        # The free-flyer's own limits are unbounded: draw on the tangent.
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2.0, 2.0, model.nv))
        yield q, rng.normal(size=model.nv), rng.normal(size=model.nv)


def relative(got: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(got - expected).max() / max(np.abs(expected).max(), 1.0))


def test_every_term_is_pinocchios(case) -> None:
    model, energies = case
    data = model.createData()
    for q, v, a in states(model):
        terms = energies(q, v)
        upper = np.triu(pin.crba(model, data, q))
        assert relative(terms.mass, upper + np.triu(upper, 1).T) < 1e-13
        assert relative(terms.coriolis, pin.computeCoriolisMatrix(model, data, q, v)) < 1e-13
        assert relative(terms.gravity.ravel(), pin.computeGeneralizedGravity(model, data, q)) < 1e-13
        total = terms.mass @ a + terms.coriolis @ v + terms.gravity.ravel()
        assert relative(total, pin.rnea(model, data, q, v, a)) < 1e-13


def test_the_symbolic_model_has_these_terms(case) -> None:
    model, energies = case
    symbolic = SymbolicModel(model)
    q, v, a = (ca.SX.sym("x", size) for size in (model.nq, model.nv, model.nv))
    function = ca.Function("f", [q, v, a], [symbolic.crba(q), symbolic.rnea(q, v, a)])
    for at, moving, rate in states(model, 2):
        terms = energies(at, moving)
        mass, force = (value.full() for value in function(at, moving, rate))
        assert relative(mass, terms.mass) < 1e-13
        total = terms.mass @ rate + terms.coriolis @ moving + terms.gravity.ravel()
        assert relative(force.ravel(), total) < 1e-13


def test_the_mass_rate_minus_twice_coriolis_is_skew(case) -> None:
    model, energies = case
    for q, v, _ in states(model, 2):
        step = 1e-5
        ahead, behind = (energies(pin.integrate(model, q, s * step * v), v).mass for s in (1, -1))
        skew = (ahead - behind) / (2 * step) - 2 * energies(q, v).coriolis
        assert relative(skew, -skew.T) < 1e-8


def test_the_two_link_robot_moves_as_by_lagranges_equations_in_euler_angles() -> None:
    """Exercises H.2 and 4.4.2: eight coordinates, Lagrange's equations, no group and no body velocity in them."""
    x, rate = ca.SX.sym("x", 8), ca.SX.sym("rate", 8)

    def turn(axis: int, angle: ca.SX) -> ca.SX:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        matrix = ca.SX.eye(3)
        matrix[i, i] = matrix[j, j] = ca.cos(angle)
        matrix[j, i], matrix[i, j] = ca.sin(angle), -ca.sin(angle)
        return matrix

    def along(expression: ca.SX) -> ca.SX:
        return ca.reshape(ca.jtimes(ca.vec(expression), x, rate), expression.shape)

    def spin(rotation: ca.SX) -> ca.SX:
        omega = rotation.T @ along(rotation)
        return ca.vertcat(omega[2, 1], omega[0, 2], omega[1, 0])

    base = turn(2, x[5]) @ turn(1, x[4]) @ turn(0, x[3])
    upper = base @ turn(1, x[6])
    lower = upper @ turn(2, x[7])
    hip = x[:3] + base @ ca.DM([0.2, 0.1, -0.1])
    knee = hip + upper @ ca.DM([0.0, 0.05, -0.3])
    lagrangian = 0
    for mass, rotation, center, moments in (
        (4.0, base, x[:3] + base @ ca.DM([0.03, -0.02, 0.05]), [0.05, 0.08, 0.1]),
        (1.2, upper, hip + upper @ ca.DM([0.0, 0.01, -0.15]), [0.02, 0.021, 0.004]),
        (0.7, lower, knee + lower @ ca.DM([0.02, 0.0, -0.12]), [0.009, 0.01, 0.002]),
    ):
        lagrangian += 0.5 * mass * ca.sumsqr(along(center)) + 0.5 * ca.dot(ca.DM(moments), spin(rotation) ** 2)
        lagrangian -= mass * 9.81 * center[2]
    tau, momentum = ca.SX.sym("tau", 2), ca.gradient(lagrangian, rate)
    force = ca.gradient(lagrangian, x) - along(momentum) + ca.vertcat(ca.SX.zeros(6), tau)
    second = ca.solve(ca.jacobian(momentum, rate), force)
    velocity = ca.vertcat(base.T @ rate[:3], spin(base), rate[6:])
    slope = along(velocity) + ca.jacobian(velocity, rate) @ second
    by_lagrange = ca.Function("by_lagrange", [x, rate, tau], [base, velocity, slope])

    energies, rng = Energies(two_link()), np.random.default_rng(3)
    for _ in range(4):
        point, torque = rng.uniform(-1.2, 1.2, 8), rng.normal(size=2)
        rotation, v, expected = (value.full() for value in by_lagrange(point, rng.normal(size=8), torque))
        q = np.concatenate((pin.SE3ToXYZQUAT(pin.SE3(rotation, point[:3])), point[6:]))
        terms = energies(q, v.ravel())
        load_on = np.r_[np.zeros(6), torque][:, None] - terms.coriolis @ v - terms.gravity
        found = np.linalg.solve(terms.mass, load_on).ravel()
        np.testing.assert_allclose(found, expected.ravel(), rtol=0, atol=1e-10)


def test_lifting_a_leg_pushes_the_trunk() -> None:
    """Chapter 4.12.5, in free fall and at rest, where the coupling is all there is."""
    model = load("solo12").model
    q, v, lift = pin.neutral(model), np.zeros(model.nv), np.zeros(12)
    q[7:] = np.tile([0.0, 0.8, -1.6], 4)
    lift[0:3] = [0.0, 40.0, -80.0]
    mass = Energies(model)(q, v).mass
    recoil = -np.linalg.solve(mass[:6, :6], mass[:6, 6:] @ lift)
    fall = np.concatenate([pin.XYZQUATToSE3(q[:7]).rotation.T @ model.gravity.linear, np.zeros(3)])
    acceleration = pin.aba(model, model.createData(), q, v, mass @ np.concatenate([recoil, lift]))
    assert relative(acceleration, np.concatenate([recoil + fall, lift])) < 1e-12
    # The foreleg swings up: the trunk goes down and its nose too (positive pitch).
    assert recoil[2] < 0 and recoil[4] != 0


@pytest.mark.parametrize("name", ["two_link", "solo12", TALOS])
def test_centroidal_matrices_are_pinocchios(name: str) -> None:
    """And the chapter's dA_G/dt = Phi^T C_b (4.8.3) holds only after multiplication by v."""
    model = two_link() if name == "two_link" else load(name).model
    energies, data = Energies(model), model.createData()
    for q, v, _ in states(model, 3):
        terms = energies(q, v)
        matrix, rate, carry = centroidal_matrices(terms, q, v)
        pin.dccrba(model, data, q, v)
        assert relative(matrix, data.Ag) < 1e-12
        assert relative(rate, data.dAg) < 1e-12
        rows = carry @ terms.coriolis[:6]
        assert relative(rows @ v, rate @ v) < 1e-12
        assert np.abs(rows - rate).max() > 1e-3
