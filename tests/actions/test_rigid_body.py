"""A rigid body on SE(3): against Newton and Euler, closed-form motions, conservation laws and differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from rigid_body import RigidBody, RigidBodyAction
from scipy.integrate import solve_ivp

from lgmpc.actions import Integrator, MultibodyAction, RungeKutta4, SemiImplicitEuler, Variational, thrusters
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control, FramePlacement, StateError
from lgmpc.lie import so3
from lgmpc.ocp import ShootingProblem, check_derivatives
from lgmpc.solvers import Fddp, NlpSolver, Status

pytestmark = pytest.mark.usefixtures("interpreted")
MASS, INERTIA, ARM = 1.5, np.diag([0.1, 0.2, 0.25]), np.array([0.1, 0.05, -0.02])
GRAVITY = np.array([0.0, 0.0, -9.81])
INTEGRATORS = (SemiImplicitEuler(), Variational(), RungeKutta4())


def offset(**more: object) -> RigidBody:
    return RigidBody(MASS, INERTIA, ARM, **more)


def rolled(action: MultibodyAction, x: np.ndarray, us: np.ndarray, step: float) -> np.ndarray:
    p = action.parameters.default.copy()
    p[action.parameters["duration"]] = step
    xs = [x]
    for u in us:
        xs.append(action.value_function(xs[-1], u, p)[0].full().ravel())
    return np.array(xs)


def state(rotation: np.ndarray, v: np.ndarray, position: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate([position, pin.Quaternion(rotation).coeffs(), v])


def newton_euler(x: np.ndarray, wrench: np.ndarray, drag: np.ndarray) -> np.ndarray:
    """Acceleration (6,) of the origin, body axes, from the textbook's equations at the centre of mass."""
    rotation, v, w = pin.Quaternion(x[3:7]).toRotationMatrix(), x[7:10], x[10:13]
    wrench = wrench - drag * x[7:]
    force, moment = wrench[:3], wrench[3:]
    turning = np.linalg.solve(INERTIA, moment - np.cross(ARM, force) - np.cross(w, INERTIA @ w))
    center = rotation.T @ GRAVITY + force / MASS  # of the centre of mass, inertial, body axes
    origin = center - np.cross(turning, ARM) - np.cross(w, np.cross(w, ARM))
    return np.concatenate([origin - np.cross(w, v), turning])


def test_accelerations_are_newtons_and_eulers() -> None:
    body, rng = offset(), np.random.default_rng(0)
    action = RigidBodyAction("newton", body, integrator=SemiImplicitEuler())
    p, h = action.parameters.default.copy(), 1e-3
    drag = rng.uniform(0.1, 1.0, 6)
    p[action.parameters["duration"]], p[action.parameters["drag_linear"]] = h, drag
    for _ in range(5):
        x = state(so3.exp(rng.standard_normal(3)), rng.standard_normal(6))
        u = rng.standard_normal(6)
        found = (action.evaluate(x, u, p).x_next[7:] - x[7:]) / h
        np.testing.assert_allclose(found, newton_euler(x, u, drag), rtol=0, atol=1e-10)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda value: type(value).__name__)
def test_a_body_that_spins_about_a_principal_axis_does_so_exactly(integrator: Integrator) -> None:
    """Rotation about z at a constant rate, through rotation pi between two nodes."""
    body = RigidBody(MASS, INERTIA, gravity=(0.0, 0.0, 0.0))
    rate, step, steps = 1.3, 0.4, 20
    v = np.array([0.0, 0.0, 0.0, 0.0, 0.0, rate])
    action = RigidBodyAction("spin", body, integrator=integrator)
    xs = rolled(action, state(np.eye(3), v), np.zeros((steps, 6)), step)
    for k, x in enumerate(xs):
        np.testing.assert_allclose(so3.exp(np.array([0, 0, k * step * rate])), matrix(x), rtol=0, atol=1e-12)
        np.testing.assert_allclose(x[7:], v, rtol=0, atol=1e-12)


def test_a_throw_is_a_parabola() -> None:
    """The variational step of a body that does not turn is the parabola itself, at any step."""
    action = RigidBodyAction("throw", RigidBody(MASS, INERTIA), integrator=Variational())
    v = np.array([1.0, -2.0, 3.0, 0.0, 0.0, 0.0])
    xs = rolled(action, state(np.eye(3), v), np.zeros((4, 6)), 0.25)
    for k, x in enumerate(xs):
        t = 0.25 * k
        np.testing.assert_allclose(x[:3], v[:3] * t + GRAVITY * t**2 / 2, rtol=0, atol=1e-12)


def test_a_symmetric_top_precesses_as_in_the_textbook() -> None:
    """I1 = I2: the angular velocity turns about the body's axis at (I3 - I1) / I1 w3, in closed form."""
    body = RigidBody(1.0, [0.2, 0.2, 0.3], gravity=(0.0, 0.0, 0.0))
    action = RigidBodyAction("top", body, integrator=RungeKutta4())
    w, time, steps = np.array([1.0, 0.0, 4.0]), 2.0, 400
    x = rolled(action, state(np.eye(3), np.concatenate([np.zeros(3), w])), np.zeros((steps, 6)), time / steps)[-1]
    angle = (0.3 - 0.2) / 0.2 * w[2] * time
    np.testing.assert_allclose(x[10:], [np.cos(angle), np.sin(angle), 4.0], rtol=0, atol=1e-8)
    # In space the body's axis turns about the angular momentum L at |L| / I1.
    momentum = np.array([0.2, 0.0, 1.2])
    turned = so3.exp(momentum / 0.2 * time) @ np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(matrix(x)[:, 2], turned, rtol=0, atol=1e-8)


def matrix(x: np.ndarray) -> np.ndarray:
    return np.array(pin.Quaternion(x[3:7]).toRotationMatrix())


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda value: type(value).__name__)
def test_a_free_body_conserves_momentum_and_energy_as_its_method_does(integrator: Integrator) -> None:
    """Tumbling about its middle axis for 20 s with the origin off the centre of mass, through many half turns."""
    body = offset(gravity=(0.0, 0.0, 0.0))
    spatial = body.model.inertias[1].matrix()
    action = RigidBodyAction("tumble", body, integrator=integrator)
    start = state(so3.exp(np.array([0.3, 3.0, -0.2])), np.array([0.2, -0.1, 0.3, 0.05, 1.5, 0.1]))
    xs = rolled(action, start, np.zeros((1000, 6)), 0.02)
    energy = np.einsum("ki,ij,kj->k", xs[:, 7:], spatial, xs[:, 7:]) / 2
    momenta = np.array([pin.XYZQUATToSE3(x[:7]).act(pin.Force(spatial @ x[7:])).vector for x in xs])
    momentum_drift = np.abs(momenta - momenta[0]).max()
    energy_drift = np.abs(energy / energy[0] - 1).max()
    if isinstance(integrator, SemiImplicitEuler):  # what the others are measured by
        assert momentum_drift > 0.01 and energy_drift > 0.1
        return
    momentum_limit, energy_limit = (1e-12, 1e-3) if isinstance(integrator, Variational) else (1e-6, 1e-6)
    assert momentum_drift < momentum_limit and energy_drift < energy_limit
    if isinstance(integrator, Variational):  # bounded, not growing
        first, last = (np.abs(part / energy[0] - 1).max() for part in np.array_split(energy, 2))
        assert last < 1.5 * first
    np.testing.assert_allclose(np.linalg.norm(xs[:, 3:7], axis=1), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("integrator", "order"), list(zip(INTEGRATORS, (1, 2, 4), strict=True)))
def test_order_is_the_slope_of_the_error(integrator: Integrator, order: int) -> None:
    """Against Newton and Euler integrated by another method (DOP853 on rotation matrices), with a wrench."""
    wrench, rng = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.1]), np.random.default_rng(2)
    start = state(so3.exp(np.array([0.0, np.pi - 1e-3, 0.0])), rng.standard_normal(6))

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        rotation, v = y[3:12].reshape(3, 3), y[12:]
        x = np.concatenate([y[:3], pin.Quaternion(rotation).coeffs(), v])
        spin = np.array(pin.skew(v[3:]))
        return np.concatenate([rotation @ v[:3], (rotation @ spin).ravel(), newton_euler(x, wrench, np.zeros(6))])

    time = 0.4
    y0 = np.concatenate([start[:3], matrix(start).ravel(), start[7:]])
    y = solve_ivp(rate, (0.0, time), y0, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    u, _, vt = np.linalg.svd(y[3:12].reshape(3, 3))
    truth = np.concatenate([y[:3], pin.Quaternion(u @ vt).coeffs(), y[12:]])
    action = RigidBodyAction("slope", offset(), integrator=integrator)
    errors = [
        np.linalg.norm(action.state.diff(truth, rolled(action, start, np.tile(wrench, (n, 1)), time / n)[-1]))
        for n in (8, 16)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda value: type(value).__name__)
def test_derivatives_are_right_near_rotation_pi_too(integrator: Integrator) -> None:
    body, rng = offset(), np.random.default_rng(1)
    costs = [
        CostItem("goal", StateError(body.state)),
        CostItem("place", FramePlacement("body", (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0))),
        CostItem("effort", Control(6), 1e-2),
    ]
    action = RigidBodyAction("near_pi", body, costs, integrator=integrator)
    problem = ShootingProblem(action, 3)
    problem.set("duration", 0.1)
    for angle in (0.0, 1e-9, np.pi - 0.05, np.pi + 0.05):
        axis = rng.standard_normal(3)
        problem.set_initial_state(state(so3.exp(angle * axis / np.linalg.norm(axis)), rng.standard_normal(6)))
        report = check_derivatives(problem, trajectory=problem.rollout(rng.standard_normal((3, 6))))
        assert report.passed, str(report)


def test_thrusters_and_wrenches_are_controls() -> None:
    body = offset()
    places, up = np.array([[0.2, 0.1, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.2, 0.0]]), np.tile([0.0, 0.0, 1.0], (3, 1))
    matrix_b = thrusters(body.model, places, up, 0.05)
    driven = RigidBodyAction("thrusters", offset(actuation=matrix_b))
    plain = RigidBodyAction("wrench", body)
    x, u = state(so3.exp(np.array([0.1, 0.2, 0.3])), np.linspace(-1, 1, 6)), np.array([1.0, 2.0, 3.0])
    p = plain.parameters.default
    np.testing.assert_allclose(driven.evaluate(x, u, p).x_next, plain.evaluate(x, matrix_b @ u, p).x_next, atol=1e-14)


def test_solvers_agree_on_turning_a_body_over() -> None:
    """Upside down to upright in one second: FDDP and ipopt find the same optimum, which does not move the position."""
    body = RigidBody(MASS, INERTIA, gravity=(0.0, 0.0, 0.0))
    goal = state(so3.exp(np.array([np.pi - 0.1, 0.0, 0.0])), np.zeros(6))
    costs = [CostItem("goal", StateError(body.state, goal), 10.0), CostItem("effort", Control(6), 1e-2)]
    problem = ShootingProblem(RigidBodyAction("turn_over", body, costs), 20)
    problem.set("duration", 0.05)
    ours, theirs = Fddp(problem).solve(), NlpSolver(problem).solve()
    assert ours.status is Status.CONVERGED and theirs.status is Status.CONVERGED
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-8)
    # The turn is about x alone, whose equation is linear: a double integrator's.
    np.testing.assert_allclose(ours.us[:, [0, 1, 2, 4, 5]], 0.0, atol=1e-7)
    assert np.abs(ours.us[:, 3]).max() > 0.1
