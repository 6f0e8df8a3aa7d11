"""Equations of motion from energies, against Pinocchio's recursions, which share nothing with them but the models."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from example_robot_data import load

from lgmpc.errors import InputError, ModelError
from lgmpc.mechanics.multibody.articulated import ArticulatedBody
from lgmpc.mechanics.multibody.centroidal import centroidal_terms, wrench_about
from lgmpc.mechanics.multibody.floating_base import FloatingBaseDynamics

TALOS = pytest.param("talos", marks=pytest.mark.slow)
NAMES = ("two_link", "solo12", "talos_arm", TALOS)


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


@pytest.fixture(scope="module", autouse=True)
def interpreted():
    """Numbers are the same without machine code, and nothing here is called often enough to be worth compiling."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LGMPC_JIT", "0")
        yield


@pytest.fixture(scope="module", params=NAMES)
def case(request):
    model = two_link() if request.param == "two_link" else load(request.param).model
    return model, FloatingBaseDynamics(model)


def states(model: pin.Model, count: int = 4):
    rng = np.random.default_rng(7)
    for _ in range(count):
        # The free-flyer's own limits are unbounded: draw on the tangent.
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2.0, 2.0, model.nv))
        yield q, rng.normal(size=model.nv), rng.normal(size=model.nv)


def relative(got: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(got - expected).max() / max(np.abs(expected).max(), 1.0))


def test_inverse_dynamics_is_rnea(case) -> None:
    model, dynamics = case
    data = model.createData()
    for q, v, a in states(model):
        assert relative(dynamics.inverse_dynamics(q, v, a), pin.rnea(model, data, q, v, a)) < 1e-13


def test_every_term_is_pinocchios(case) -> None:
    model, dynamics = case
    data = model.createData()
    for q, v, _ in states(model):
        terms = dynamics.equations(q, v)
        upper = np.triu(pin.crba(model, data, q))
        assert relative(terms.mass, upper + np.triu(upper, 1).T) < 1e-13
        assert relative(terms.coriolis, pin.computeCoriolisMatrix(model, data, q, v)) < 1e-13
        assert relative(terms.gravity, pin.computeGeneralizedGravity(model, data, q)) < 1e-13


def test_the_mass_rate_minus_twice_coriolis_is_skew(case) -> None:
    model, dynamics = case
    for q, v, _ in states(model, 2):
        step = 1e-5
        ahead, behind = (dynamics.equations(pin.integrate(model, q, s * step * v), v).mass for s in (1, -1))
        skew = (ahead - behind) / (2 * step) - 2 * dynamics.equations(q, v).coriolis
        assert relative(skew, -skew.T) < 1e-8


def test_forward_dynamics_is_aba_and_takes_contact_forces(case) -> None:
    model, dynamics = case
    data = model.createData()
    rng = np.random.default_rng(3)
    frame = model.nframes - 1
    for q, v, _ in states(model, 2):
        tau, force = rng.normal(size=dynamics.nv - 6 * dynamics.body.floating), rng.normal(size=6)
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        load_on = np.concatenate([np.zeros(dynamics.nv - len(tau)), tau]) + jacobian.T @ force
        got = dynamics.forward_dynamics(q, v, tau, jacobian, force)
        assert relative(got, pin.aba(model, data, q, v, load_on)) < 1e-9


def test_blocks_of_the_mass_matrix_are_those_of_the_chapter() -> None:
    model = two_link()
    dynamics = FloatingBaseDynamics(model)
    (q, v, _), *_ = states(model)
    terms = dynamics.equations(q, v)
    data = model.createData()
    pin.ccrba(model, data, q, v)
    # The locked robot is one rigid body: its inertia about the base, moved there from the centre of mass.
    world_from_base = pin.XYZQUATToSE3(q[:7])
    at_com = pin.SE3(np.eye(3), data.com[0])
    locked = data.Ig.se3Action(world_from_base.actInv(at_com)).matrix()
    assert relative(terms.locked_inertia, locked) < 1e-12
    assert terms.coupling.shape == (6, 2) and terms.joint_inertia.shape == (2, 2)
    assert np.linalg.eigvalsh(terms.mass)[0] > 0


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

    dynamics, rng = FloatingBaseDynamics(two_link()), np.random.default_rng(3)
    for _ in range(4):
        point, torque = rng.uniform(-1.2, 1.2, 8), rng.normal(size=2)
        rotation, v, expected = (value.full() for value in by_lagrange(point, rng.normal(size=8), torque))
        q = np.concatenate((pin.SE3ToXYZQUAT(pin.SE3(rotation, point[:3])), point[6:]))
        found = dynamics.forward_dynamics(q, v.ravel(), torque)
        np.testing.assert_allclose(found, expected.ravel(), rtol=0, atol=1e-10)


def test_lifting_a_leg_pushes_the_trunk() -> None:
    """Chapter 4.12.5, in free fall and at rest, where the coupling is all there is."""
    model = load("solo12").model
    dynamics = FloatingBaseDynamics(model)
    data = model.createData()
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[7:] = np.tile([0.0, 0.8, -1.6], 4)
    terms = dynamics.equations(q, v)
    lift = np.zeros(12)
    lift[0:3] = [0.0, 40.0, -80.0]
    recoil = terms.recoil(lift)
    # Such torques that the joints move like that while no wrench but gravity acts: the base recoils and falls.
    force = terms.mass @ np.concatenate([recoil, lift])
    assert np.abs(force[:6]).max() < 1e-12
    fall = np.concatenate([pin.XYZQUATToSE3(q[:7]).rotation.T @ model.gravity.linear, np.zeros(3)])
    acceleration = pin.aba(model, data, q, v, force)
    assert relative(acceleration, np.concatenate([recoil + fall, lift])) < 1e-12
    # The foreleg swings up: the trunk goes down and its nose too (positive pitch).
    assert recoil[2] < 0 and recoil[4] != 0


@pytest.mark.parametrize("name", ["two_link", "solo12", TALOS])
def test_centroidal_terms_are_pinocchios(name: str) -> None:
    model = two_link() if name == "two_link" else load(name).model
    dynamics, data = FloatingBaseDynamics(model), model.createData()
    for q, v, _ in states(model, 3):
        equations = dynamics.equations(q, v)
        terms = centroidal_terms(equations, q, v)
        pin.dccrba(model, data, q, v)
        assert relative(terms.matrix, data.Ag) < 1e-12
        assert relative(terms.rate, data.dAg) < 1e-12
        assert relative(terms.momentum(v), data.hg.vector) < 1e-12
        assert relative(terms.com, pin.centerOfMass(model, data, q)) < 1e-12
        assert terms.mass == pytest.approx(pin.computeTotalMass(model), rel=1e-13)
        assert relative(terms.gravity, np.r_[terms.mass * model.gravity.linear, np.zeros(3)]) < 1e-12


def test_rows_of_c_give_the_rate_only_after_multiplication_by_v() -> None:
    """The chapter's 4.8.3 writes dA_G/dt = Phi^T C_b; as matrices they differ."""
    model = load("solo12").model
    dynamics = FloatingBaseDynamics(model)
    (q, v, _), *_ = states(model)
    equations = dynamics.equations(q, v)
    terms = centroidal_terms(equations, q, v)
    carry = terms.matrix[:, :6] @ np.linalg.inv(equations.locked_inertia)
    rows = carry @ equations.coriolis[:6]
    assert relative(rows @ v, terms.rate @ v) < 1e-12
    assert np.abs(rows - terms.rate).max() > 1e-3


@pytest.mark.parametrize("name", ["solo12", TALOS])
def test_momentum_changes_by_all_external_wrenches(name: str) -> None:
    """Exercise 1 of chapter 4.8: known forces on two feet or hands, and gravity; the joints' torques do not matter."""
    model = load(name).model
    dynamics, data = FloatingBaseDynamics(model), model.createData()
    rng = np.random.default_rng(11)
    tips = [
        model.getFrameId(f) for f in {"solo12": ("FL_FOOT", "HR_FOOT"), "talos": ("gripper_right_base_link",)}[name]
    ]
    for q, v, _ in states(model, 2):
        pin.framesForwardKinematics(model, data, q)
        points = np.array([data.oMf[tip].translation for tip in tips])
        forces, tau = 30.0 * rng.normal(size=(len(tips), 3)), rng.normal(size=model.nv - 6)
        rows = [pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)[:3] for tip in tips]
        load_on = np.r_[np.zeros(6), tau] + np.vstack(rows).T @ forces.ravel()
        acceleration = pin.aba(model, data, q, v, load_on)
        terms = centroidal_terms(dynamics.equations(q, v), q, v)
        expected = wrench_about(terms.com, points, forces) + terms.gravity
        assert relative(terms.momentum_rate(v, acceleration), expected) < 1e-9
        # And so it does over a small step of a simulation.
        step = 1e-6
        ahead, behind = (
            pin.computeCentroidalMomentum(
                model, data, pin.integrate(model, q, s * step * v), v + s * step * acceleration
            ).vector.copy()
            for s in (1, -1)
        )
        assert relative((ahead - behind) / (2 * step), expected) < 1e-6


def test_bad_input_is_refused() -> None:
    model = two_link()
    dynamics = FloatingBaseDynamics(model)
    q, v = pin.neutral(model), np.zeros(model.nv)
    with pytest.raises(InputError, match=r"q: got shape \(8,\)"):
        dynamics.equations(q[:-1], v)
    with pytest.raises(InputError, match="v: .*finite"):
        dynamics.equations(q, np.full(model.nv, np.nan))
    with pytest.raises(InputError, match="quaternion|norm"):
        dynamics.equations(2.0 * q + 0.1, v)
    with pytest.raises(InputError, match="jacobian"):
        dynamics.forward_dynamics(q, v, np.zeros(2), np.zeros((3, 4)), np.zeros(3))
    with pytest.raises(InputError, match="force"):
        dynamics.forward_dynamics(q, v, np.zeros(2), np.zeros((3, 8)), np.zeros(2))
    equations = dynamics.equations(q, v)
    with pytest.raises(InputError, match="q: got shape"):
        centroidal_terms(equations, q[:-1], v)
    with pytest.raises(InputError, match="v: got shape"):
        centroidal_terms(equations, q, v[:-1])
    with pytest.raises(InputError, match="points"):
        wrench_about(np.zeros(3), np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match="com"):
        wrench_about(np.full(3, np.inf), np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="joint_acceleration"):
        equations.recoil(np.zeros(3))
    with pytest.raises(InputError, match="acceleration"):
        centroidal_terms(equations, q, v).momentum_rate(v, np.full(model.nv, np.nan))
    with pytest.raises(InputError, match="forces"):
        wrench_about(np.zeros(3), np.zeros((2, 3)), np.zeros((1, 3)))
    for moments in (np.ones(3), np.ones((1, 3))):  # would be added once for each point
        with pytest.raises(InputError, match="moments: got shape"):
            wrench_about(np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3)), moments)
    terms = FloatingBaseDynamics(load("talos_arm").model).equations(np.zeros(7), np.zeros(7))
    with pytest.raises(InputError, match="fixed base"):
        centroidal_terms(terms, np.zeros(7), np.zeros(7))
    assert terms.locked_inertia.size == terms.coupling.size == 0
    np.testing.assert_array_equal(terms.joint_inertia, terms.mass)
    ball = pin.Model()
    ball.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(ModelError, match="'ball' is a JointModelSpherical"):
        ArticulatedBody.from_model(ball)
