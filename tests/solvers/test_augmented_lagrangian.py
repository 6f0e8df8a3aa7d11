"""FDDP on an augmented Lagrangian, alone and as what the SQP falls back on."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from samples import Constrained

from lgmpc.actions import Action, FreeForwardDynamics, HoldAction, MultibodyAction, PenalizedAction, thrusters
from lgmpc.costs import Activation, Bounded, ConstraintItem, Cost, CostItem, CostTerm, LeastSquares, ParameterLayout
from lgmpc.costs.library import Control, FrameTranslation, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import (
    AugmentedLagrangianFddp,
    AugmentedLagrangianSettings,
    BoxFddp,
    Fddp,
    History,
    IterativeSolver,
    LineSearchSqp,
    NlpSolver,
    Status,
)
from lgmpc.state import StateVector

Make = Callable[..., ShootingProblem]


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("which", ["cart", "satellite"])
def test_it_finds_the_solution_of_ipopt_with_its_multipliers(
    cart: ShootingProblem, satellite: Make, which: str
) -> None:
    problem = cart if which == "cart" else satellite(bounded=True)
    solution = AugmentedLagrangianFddp(problem, AugmentedLagrangianSettings(tolerance=1e-8)).solve()
    assert solution.status is Status.CONVERGED
    reference = NlpSolver(problem).solve()
    assert solution.cost == pytest.approx(reference.cost, rel=1e-7)
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-4)
    np.testing.assert_allclose(solution.multipliers, reference.multipliers, atol=1e-3)
    recomputed = solution.residual()
    assert recomputed.largest < 1e-6
    assert recomputed.constraint == pytest.approx(solution.kkt.constraint, abs=1e-10)
    assert recomputed.complementarity == pytest.approx(solution.kkt.complementarity, abs=1e-10)


@pytest.mark.parametrize("make", [LineSearchSqp, AugmentedLagrangianFddp])
def test_gains_do_not_use_controls_at_their_bounds(satellite: Make, make: Callable[..., IterativeSolver]) -> None:
    """They are those of the free controls: a disturbance of the state changes no control that is held at its bound."""
    problem = satellite(bounded=True)
    solution, reference = make(problem).solve(), BoxFddp(problem).solve()
    assert solution.feedback.shape == (10, 6, 12)
    held = np.abs(solution.multipliers) > 1e-2
    assert held.any() and not held.all()
    assert np.abs(solution.feedback[held]).max() < 1e-2 < np.abs(solution.feedback[~held]).max()
    free = ~held.any(axis=1)
    np.testing.assert_allclose(solution.feedback[free], reference.feedback[free], rtol=1e-3, atol=1e-3)


def test_the_penalised_action_is_the_augmented_lagrangian(cart: ShootingProblem) -> None:
    action = PenalizedAction(cart.action)
    rng = np.random.default_rng(4)
    x, u, mu, rho = rng.standard_normal(2), 3.0 * rng.standard_normal(1), rng.standard_normal(3), 7.0
    own = cart.parameters[0]
    point = cart.action.evaluate(x, u, own)
    shifted = point.constraint + mu / rho
    apart = shifted - np.clip(shifted, point.lower, point.upper)
    found = action.evaluate(x, u, np.concatenate([own, mu, [rho]]))
    assert found.cost == pytest.approx(point.cost + 0.5 * rho * apart @ apart)
    assert found.constraint.size == 0 and np.count_nonzero(apart) > 0
    np.testing.assert_array_equal(found.x_next, point.x_next)


@pytest.mark.usefixtures("interpreted")
def test_without_constraints_it_is_fddp(unicycle: ShootingProblem) -> None:
    solution, reference = AugmentedLagrangianFddp(unicycle).solve(), Fddp(unicycle).solve()
    assert solution.status is Status.CONVERGED
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-5)


@pytest.mark.usefixtures("interpreted")
def test_contradictory_bounds_and_nan_are_known_at_once(cart: ShootingProblem) -> None:
    solver = AugmentedLagrangianFddp(cart)
    cart.set("limit", [-2.0, 0.6, 1.5])
    assert solver.solve().status is Status.INFEASIBLE and solver.solve().iterations == 0
    cart.set("limit", [2.0, 0.6, -5.0])
    assert solver.solve().status is Status.INFEASIBLE
    cart.parameters[3] = np.nan
    assert solver.solve().status is Status.NOT_FINITE
    with pytest.raises(InputError, match="tolerance"):
        AugmentedLagrangianSettings(tolerance=0.0)


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize(("low", "high"), [(1.0, 6.0), pytest.param(2.0, 5.0, marks=pytest.mark.slow), (3.0, 4.5)])
def test_a_guess_within_all_bounds_takes_few_iterations(low: float, high: float) -> None:
    """A quadrotor that hovers far from where it must be: a hundred iterations, and two from the solution."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(1, pin.Inertia(1.5, np.zeros(3), np.diag([0.03, 0.03, 0.05])), pin.SE3.Identity())
    arms = 0.2 * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    dynamics = FreeForwardDynamics(model, thrusters(model, arms, up, [0.05, -0.05, 0.05, -0.05]))
    state, weights = dynamics.state, np.repeat([5.0, 2.0, 0.5], [3, 3, 6])
    turn = state.integrate(state.neutral(), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0, *np.zeros(6)]))
    goal = np.concatenate([[1.0, -0.5, 0.8], turn[3:]])
    costs = [CostItem("goal", StateError(state, goal), weights), CostItem("thrust", Control(4), 1e-2)]
    limits = [ConstraintItem("limits", Control(4), low, high)]
    problem = ShootingProblem(MultibodyAction("quadrotor", dynamics, costs, limits), 30)
    problem.set("duration", 0.03)
    problem.set_initial_state(state.neutral())
    guess = Trajectory(problem.hold().xs, np.full((30, 4), 1.5 * 9.81 / 4))
    solver, box = AugmentedLagrangianFddp(problem), BoxFddp(problem).solve(guess)
    solution = solver.solve(guess)
    assert solution.status is Status.CONVERGED and solution.iterations <= 100
    assert solution.cost == pytest.approx(box.cost, rel=1e-6)
    assert solver.solve(solution).iterations <= 2


class Concave(Activation):
    def value(self, r):
        return -0.5 * r * r

    def gradient(self, r):
        return -r

    def curvature(self, r):
        return -type(r).ones(*r.shape)


class Spread(Action):
    """A cost that falls with the square of the control, which only bounds end."""

    name, nu = "spread", 1

    def __init__(self) -> None:
        self.state, self.parameters = StateVector(1), ParameterLayout()

    def step(self, x, u, p):
        return 0.9 * x + 0.1 * u

    def cost(self, x, u, p):
        return Cost((CostTerm(u, Concave(), 1.0),))

    def terminal_cost(self, x, p):
        return LeastSquares(x, 0.1)

    def constraint(self, x, u, p):
        return Bounded(u, -3.0, 3.0)


@pytest.mark.usefixtures("interpreted")
def test_bounds_may_be_all_that_gives_the_cost_a_minimum() -> None:
    problem = ShootingProblem(Spread(), 4)
    guess = Trajectory(np.zeros((5, 1)), np.array([[1.0], [-1.0], [1.0], [-1.0]]))
    solution = AugmentedLagrangianFddp(problem).solve(guess)
    assert solution.status is Status.CONVERGED, solution.explain()
    np.testing.assert_allclose(np.abs(solution.us), 3.0, atol=1e-6)


class Loop(Constrained):
    """A step that makes the linearised constraint ``x1 = 0`` contradict the bounds on u far from the solution."""

    name = "loop"

    def constraint(self, x, u, p):
        bounded = self.base.constraint(x, u, p)
        return type(bounded)(
            ca.vertcat(bounded.value, ca.sin(3 * x[0]) + 0.1 * u[0]),
            ca.vertcat(bounded.lower, -0.999),
            ca.vertcat(bounded.upper, 0.999),
        )


@pytest.mark.usefixtures("interpreted")
def test_the_sqp_continues_where_its_steps_fail(cart: ShootingProblem) -> None:
    problem = ShootingProblem(Loop(cart.action), 8)
    problem.parameters[...], problem.x0[...] = cart.parameters, cart.x0
    rng = np.random.default_rng(5)
    solver = LineSearchSqp(problem)
    for _ in range(5):
        history = History()
        guess = Trajectory(4.0 * rng.standard_normal((9, 2)), 10.0 * rng.standard_normal((8, 1)))
        solution = solver.solve(guess, callback=history)
        assert solution.status is Status.CONVERGED, solution.explain()
        assert solution.residual().largest < 1e-6
        assert solution.iterations == len(history.reports)


@pytest.fixture(scope="module")
def arm() -> ShootingProblem:
    """Crocoddyl's arm with bounded motors, whose hand must be at a far point after two seconds, at rest."""
    import example_robot_data as erd

    model = erd.load("talos_arm").model
    dynamics, nv = FreeForwardDynamics(model), int(model.nv)
    x0 = np.concatenate([[0.173046, 1.0, -0.52366, 0.0, 0.0, 0.1, -0.005], np.zeros(nv)])
    still = StateError(dynamics.state, x0)
    costs = [CostItem("posture", still, np.repeat([0.01, 0.1], nv)), CostItem("effort", Control(nv), 1e-3)]
    motors = ConstraintItem("motors", Control(nv), -model.effortLimit, model.effortLimit)
    free, zero = np.full(nv, np.inf), np.zeros(nv)
    arrive = [
        ConstraintItem("hand", FrameTranslation("gripper_left_joint", [0.0, 0.6, 0.4])),
        ConstraintItem("rest", still, np.concatenate([-free, zero]), np.concatenate([free, zero])),
    ]
    move = MultibodyAction("far_reach", dynamics, costs, [motors])
    problem = ShootingProblem([move] * 200 + [HoldAction("far_reach_end", model, (), arrive)])
    problem.set("duration", 0.01)
    problem.set_initial_state(x0)
    return problem


def wild(problem: ShootingProblem, count: int) -> Iterator[Trajectory]:
    """Random states within some radians and rad/s, and random efforts."""
    rng, hold = np.random.default_rng(0), problem.hold()
    for _ in range(count):
        xs = [problem.state.integrate(x, 4.0 * rng.standard_normal(problem.state.ndx)) for x in hold.xs]
        yield Trajectory(np.array(xs), 10.0 * rng.standard_normal(hold.us.shape))


@pytest.mark.slow
@pytest.mark.parametrize("make", [LineSearchSqp, AugmentedLagrangianFddp])
def test_hard_constraints_are_met_from_random_guesses(
    arm: ShootingProblem, make: Callable[..., IterativeSolver]
) -> None:
    """The SQP's own steps solve 5 of the first 10 from guesses a quarter as wild."""
    solver = make(arm)
    for guess in wild(arm, 5):
        solution = solver.solve(guess, max_iterations=600)
        assert solution.status is Status.CONVERGED, solution.explain()
        assert max(solution.kkt.constraint, solution.kkt.dynamics, solution.kkt.complementarity) < 1e-6
