"""The variational integrator of robots: its defining properties. Its order is tested with that of the others."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import example_robot_data as erd
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import ContactForwardDynamics, FreeForwardDynamics, MultibodyAction, RungeKutta4, Variational
from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.ocp import check_derivatives
from lgmpc.state import difference_symbolic


def robot(shoulder: pin.JointModel, gravity: float = 9.81) -> pin.Model:
    """A free body with a limb: ``shoulder``, then a hinge."""
    model = pin.Model()
    model.gravity = pin.Motion(np.r_[0.0, 0.0, -gravity, 0.0, 0.0, 0.0])
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    body = pin.Inertia(1.5, np.array([0.1, 0.05, -0.02]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(root, body, pin.SE3.Identity())
    parent = root
    for name, joint, place in (("hip", shoulder, [0.1, 0.2, 0.0]), ("knee", pin.JointModelRY(), [0.0, 0.3, 0.0])):
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(place, dtype=float)), name)
        limb = pin.Inertia(0.4, np.array([0.0, 0.1, -0.1]), np.diag([0.01, 0.02, 0.015]))
        model.appendBodyToJoint(parent, limb, pin.SE3.Identity())
    model.armature[-1] = 0.01
    return model


HINGES = robot(pin.JointModelRX())
BALL = robot(pin.JointModelSpherical())
ROBOTS = pytest.mark.parametrize(
    "model", [pytest.param(HINGES, id="hinges", marks=pytest.mark.slow), pytest.param(BALL, id="ball")]
)


@lru_cache
def variational(model: pin.Model) -> MultibodyAction:
    """One action for all tests: to write its functions takes longer than to evaluate them."""
    return MultibodyAction("robot", FreeForwardDynamics(model, np.eye(model.nv)), integrator=Variational(8))


def stepper(model: pin.Model, h: float, **more: object) -> tuple[MultibodyAction, np.ndarray]:
    action = variational(model)
    p = action.parameters.default.copy()
    p[action.parameters["duration"]] = h
    for name, value in more.items():
        p[action.parameters[name]] = value
    return action, p


def start(model: pin.Model, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return pin.integrate(model, pin.neutral(model), 0.5 * rng.normal(size=model.nv)), rng.normal(size=model.nv)


def mass(model: pin.Model, q: np.ndarray) -> np.ndarray:
    matrix = pin.crba(model, model.createData(), q)
    return np.triu(matrix) + np.triu(matrix, 1).T


def momentum(model: pin.Model, x: np.ndarray) -> np.ndarray:
    """[linear; angular about the world's origin], world axes."""
    q, data = x[: model.nq], model.createData()
    inside = pin.computeCentroidalMomentum(model, data, q, x[model.nq :])
    return np.r_[inside.linear, inside.angular + np.cross(pin.centerOfMass(model, data, q), inside.linear)]


def run(action: MultibodyAction, p: np.ndarray, x: np.ndarray, steps: int) -> np.ndarray:
    loop = action.value_function
    for _ in range(steps):
        x = loop(x, np.zeros(action.nu), p)[0].full().ravel()
    return x


@ROBOTS
def test_steps_solve_the_discrete_euler_lagrange_equations(model: pin.Model) -> None:
    """p = -D1 L_d and p+ = D2 L_d, for the discrete Lagrangian by Pinocchio's energies, differentiated numerically."""
    h = 0.04
    action, p = stepper(model, h)
    data, (q, v) = model.createData(), start(model)
    x = run(action, p, np.r_[q, v], 1)
    q_next, v_next = x[: model.nq], x[model.nq :]

    def lagrangian(first: np.ndarray, last: np.ndarray) -> float:
        xi = pin.difference(model, first, last) / h
        middle = pin.integrate(model, first, h / 2 * xi)
        kinetic = 0.5 * xi @ mass(model, middle) @ xi
        ends = pin.computePotentialEnergy(model, data, first) + pin.computePotentialEnergy(model, data, last)
        return float(h * kinetic - h / 2 * ends)

    e = 1e-5
    for i in range(model.nv):
        nudge = e * np.eye(model.nv)[i]
        ahead, back = (pin.integrate(model, q, sign * nudge) for sign in (1, -1))
        slope = (lagrangian(ahead, q_next) - lagrangian(back, q_next)) / (2 * e)
        assert -slope == pytest.approx((mass(model, q) @ v)[i], abs=2e-9)
        ahead, back = (pin.integrate(model, q_next, sign * nudge) for sign in (1, -1))
        slope = (lagrangian(q, ahead) - lagrangian(q, back)) / (2 * e)
        assert slope == pytest.approx((mass(model, q_next) @ v_next)[i], abs=2e-9)


@pytest.mark.parametrize(
    "shoulder",
    [
        pytest.param(pin.JointModelRX(), id="hinges", marks=pytest.mark.slow),
        pytest.param(pin.JointModelSpherical(), id="ball"),
    ],
)
def test_momentum_is_kept_to_rounding_and_energy_within_bounds(shoulder: pin.JointModel) -> None:
    model = robot(shoulder, gravity=0.0)
    data, (q, v) = model.createData(), start(model)

    def energy(x: np.ndarray) -> float:
        return float(pin.computeKineticEnergy(model, data, x[: model.nq], x[model.nq :]))

    action, p = stepper(model, 0.02)
    x = begun = np.r_[q, v]
    errors = []
    for _ in range(10):
        x = run(action, p, x, 50)
        np.testing.assert_allclose(momentum(model, x), momentum(model, begun), rtol=0, atol=2e-12)
        errors.append(abs(energy(x) / energy(begun) - 1))
    assert max(errors) < 5e-3
    # The Runge-Kutta method loses momentum in the same time.
    other = MultibodyAction("robot", action.dynamics, integrator=RungeKutta4())
    assert np.abs(momentum(model, run(other, p, begun, 500)) - momentum(model, begun)).max() > 1e-10


@ROBOTS
def test_a_step_back_undoes_a_step(model: pin.Model) -> None:
    begun = np.concatenate(start(model))
    action, p = stepper(model, 0.03)
    backwards = p.copy()
    backwards[action.parameters["duration"]] = -0.03
    back = run(action, backwards, run(action, p, begun, 1), 1)
    np.testing.assert_allclose(action.state.diff(begun, back), 0.0, atol=1e-12)


@ROBOTS
def test_the_step_is_symplectic(model: pin.Model) -> None:
    """D^T Omega D = Omega on the left-trivialised cotangent bundle, Omega = [[p.[.,.], I], [-I, 0]]."""
    action, values = stepper(model, 0.03)
    q0, v0 = start(model)
    nv, nq, symbolic = model.nv, model.nq, action.robot
    q1 = run(action, values, np.r_[q0, v0], 1)[:nq]
    eta, p = ca.SX.sym("eta", nv), ca.SX.sym("p", nv)
    q = symbolic.integrate(ca.DM(q0), eta)
    x = action.step(ca.vertcat(q, ca.solve(symbolic.crba(q), p)), ca.SX.zeros(nv), ca.DM(values))
    out = ca.vertcat(difference_symbolic(model, ca.DM(q1), x[:nq]), symbolic.crba(x[:nq]) @ x[nq:])
    function = ca.Function("D", [eta, p], [ca.jacobian(out, ca.vertcat(eta, p)), out[nv:]])
    before = mass(model, q0) @ v0
    slope, after = (value.full() for value in function(np.zeros(nv), before))

    def form(momentum: np.ndarray) -> np.ndarray:
        bracket = np.zeros((nv, nv))
        groups = [(se3, slice(0, 6))] + ([(so3, slice(6, 9))] if nv > 8 else [])
        for group, part in groups:
            bracket[part, part] = [group.ad(e).T @ momentum[part] for e in np.eye(part.stop - part.start)]
        return np.block([[bracket, np.eye(nv)], [-np.eye(nv), np.zeros((nv, nv))]])

    np.testing.assert_allclose(slope.T @ form(after.ravel()) @ slope, form(before), rtol=0, atol=1e-11)


@ROBOTS
def test_order_two_with_drag_whose_force_depends_on_the_velocity(model: pin.Model) -> None:
    more = {"drag_linear": np.full(model.nv, 0.5), "drag_quadratic": np.full(model.nv, 0.3)}
    action, p = stepper(model, 0.2 / 256, **more)
    begun = np.concatenate(start(model))
    truth = run(MultibodyAction("robot", action.dynamics, integrator=RungeKutta4()), p, begun, 256)
    errors = []
    for n in (8, 16):
        p[action.parameters["duration"]] = 0.2 / n
        errors.append(np.linalg.norm(action.state.diff(truth, run(action, p, begun, n))))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


@ROBOTS
def test_derivatives(model: pin.Model) -> None:
    action, p = stepper(model, 0.05)
    report = check_derivatives(action, np.random.default_rng(1), parameters=p, points=2, spread=0.7)
    assert report.passed, str(report)


@pytest.mark.slow
def test_solo12_conserves_momenta_in_flight_under_gravity() -> None:
    model = erd.load("solo12").model
    action = MultibodyAction("solo12", FreeForwardDynamics(model), integrator=Variational())
    p = action.parameters.default.copy()
    p[action.parameters["duration"]] = 0.005
    begun = np.concatenate(start(model))
    end = run(action, p, begun, 200)
    # Gravity changes the vertical momentum and, about the world's origin, the two horizontal moments.
    weight = pin.computeTotalMass(model) * 9.81
    expected = momentum(model, begun) - np.r_[0.0, 0.0, weight * 1.0, np.zeros(3)]
    kept = [0, 1, 2, 5]
    np.testing.assert_allclose(momentum(model, end)[kept], expected[kept], rtol=0, atol=1e-12 * weight)


def test_contacts_are_refused() -> None:
    model = erd.load("solo12").model
    action = MultibodyAction("solo12", ContactForwardDynamics(model, ["FL_FOOT"]), integrator=Variational())
    with pytest.raises(InputError, match="integrator: got Variational"):
        action.value_function  # noqa: B018
    with pytest.raises(InputError, match="iterations: got 0"):
        Variational(0)
