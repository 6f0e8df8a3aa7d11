from __future__ import annotations

import itertools
from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from samples import Constrained

from lgmpc.actions import Action, FreeForwardDynamics, HoldAction, MultibodyAction
from lgmpc.costs import Bounded, ConstraintItem, CostItem, LeastSquares, ParameterLayout, Residual, StageSymbols
from lgmpc.costs.library import Control, FrameTranslation, JointPosition, StateError
from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import BoxFddp, Fddp, FddpSettings, LineSearchSqp, LineSearchSqpSettings, NlpSolver, Progress, Status
from lgmpc.state import StateVector

Make = Callable[..., ShootingProblem]


def guesses(problem: ShootingProblem) -> dict[str, Trajectory]:
    rng = np.random.default_rng(1)
    hold = problem.hold()
    xs = [problem.state.integrate(x, 0.4 * rng.standard_normal(problem.state.ndx)) for x in hold.xs]
    return {"hold": hold, "far": Trajectory(np.array(xs), rng.standard_normal(hold.us.shape))}


@pytest.mark.parametrize("which", ["cart", "satellite", "unicycle"])
@pytest.mark.parametrize("start", ["hold", "far"])
def test_sqp_and_ipopt_find_the_same(
    cart: ShootingProblem, satellite: Make, unicycle: ShootingProblem, which: str, start: str
) -> None:
    problem = {"cart": cart, "satellite": satellite(bounded=True), "unicycle": unicycle}[which]
    guess = guesses(problem)[start]
    solution = LineSearchSqp(problem).solve(guess)
    assert solution.status is Status.CONVERGED
    reference = NlpSolver(problem).solve(guess)
    assert solution.cost == pytest.approx(reference.cost, rel=1e-7)
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-4)
    np.testing.assert_allclose(solution.costates, reference.costates, atol=1e-4)
    np.testing.assert_allclose(solution.multipliers, reference.multipliers, atol=1e-4)
    recomputed = solution.residual()
    assert recomputed.largest <= 1e-6
    for name in ("stationarity", "dynamics", "constraint", "complementarity"):
        assert getattr(recomputed, name) == pytest.approx(getattr(solution.kkt, name), rel=1e-3, abs=1e-10), name


def test_sqp_box_fddp_and_ipopt_agree(satellite: Make) -> None:
    problem = satellite(bounded=True)
    found = [
        LineSearchSqp(problem).solve(),
        BoxFddp(problem, FddpSettings(tolerance=1e-12)).solve(),
        NlpSolver(problem).solve(),
    ]
    for solution in found:
        assert solution.status is Status.CONVERGED
        np.testing.assert_allclose(solution.us, found[0].us, atol=1e-5)
        np.testing.assert_allclose(solution.costates, found[0].costates, atol=1e-5)
        np.testing.assert_allclose(solution.multipliers, found[0].multipliers, atol=1e-5)


class Fenced(Constrained):
    """A unicycle that must stay outside a circle around the origin."""

    name = "fenced"

    def constraint(self, x, u, p):
        distance = (x[0] + 0.5) ** 2 + (x[1] + 0.6) ** 2
        return Bounded(ca.vertcat(distance, u[0]), ca.vertcat(0.16, -ca.inf), ca.vertcat(ca.inf, 4.0))


def test_intervals_with_other_constraints_and_controls(
    unicycle: ShootingProblem, linear: Callable[..., Action]
) -> None:
    """A constraint in the first half only, and one interval without controls."""
    base = unicycle.action
    fenced, jump = Fenced(base), linear(np.diag([1.0, 1.0, 0.5]), np.zeros((3, 0)), np.zeros(3), "jump")
    problem = ShootingProblem([fenced] * 10 + [jump] + [base] * 9)
    problem.set("weights", [3.0, 1.0])
    problem.set("weight", 1.0)
    problem.set_initial_state([-1.0, -1.0, 1.0])
    solution = LineSearchSqp(problem).solve(max_iterations=200)
    assert solution.status is Status.CONVERGED, solution.explain()
    assert (np.abs(solution.multipliers[:10, 0]) > 1e-2).any()  # the constraint is active
    assert not solution.multipliers[10:].any() and not solution.us[10].any()
    assert solution.residual().largest <= 1e-6
    reference = NlpSolver(problem).solve(solution.trajectory)
    assert solution.cost == pytest.approx(reference.cost, rel=1e-6)
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-4)


def test_without_constraints_it_agrees_with_fddp(unicycle: ShootingProblem) -> None:
    swept = Fddp(unicycle, FddpSettings(tolerance=1e-13)).solve()
    solution = LineSearchSqp(unicycle, LineSearchSqpSettings(tolerance=1e-8)).solve()
    np.testing.assert_allclose(solution.xs, swept.xs, atol=1e-6)


def test_infeasible_problems_have_their_status(cart: ShootingProblem) -> None:
    solver = LineSearchSqp(cart)
    assert solver.solve(max_iterations=1).status is Status.ITERATION_LIMIT
    assert solver.solve(time_limit=0.0).status is Status.TIME_LIMIT
    cart.set("limit", [2.0, 0.6, -5.0])
    infeasible = solver.solve()
    assert infeasible.status is Status.INFEASIBLE
    np.testing.assert_allclose(infeasible.gaps, infeasible.defects(), atol=1e-12)
    assert "constraint: largest violation" in infeasible.explain()
    with pytest.raises(SolverError, match="infeasible"):
        solver.solve(throw=True)
    cart.parameters[3] = np.nan
    assert solver.solve().status is Status.NOT_FINITE
    cart.set("limit", [2.0, 0.6, 1.5])
    cart.set("target", 1.0)
    cart.x0[1] = np.inf
    assert solver.solve().status is Status.NOT_FINITE


class Curved(Action):
    """Residuals of positive curvature: the full Gauss-Newton step is three times too long."""

    name, nu = "curved", 1

    def __init__(self) -> None:
        self.state, self.parameters = StateVector(1), ParameterLayout()

    def step(self, x, u, p):
        return x + u

    def cost(self, x, u, p):
        return LeastSquares(ca.vertcat(x - 1.0, u, 1.0 + u**2), ca.vertcat(1.0, 0.5, 0.8))

    def terminal_cost(self, x, p):
        return LeastSquares(x - 1.0, ca.SX(1.0))

    def constraint(self, x, u, p):
        return Bounded.stack()


def test_steps_that_are_too_long_are_shortened() -> None:
    problem = ShootingProblem(Curved(), 6)
    solution = LineSearchSqp(problem).solve()
    assert solution.status is Status.CONVERGED and solution.residual().largest < 1e-6
    assert solution.iterations < 50  # 95 if every point may be worse than the last few
    assert solution.cost == pytest.approx(NlpSolver(problem).solve().cost, rel=1e-8)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_decrease_is_measured_from_the_worst_of_the_last_four_points(start: float) -> None:
    """Without gaps and constraints the penalty function is the cost: steps may raise it, but not above the worst."""
    problem = ShootingProblem(Curved(), 6)
    solver = LineSearchSqp(problem)
    guess = problem.rollout(np.full((6, 1), start))
    reports: list[Progress] = []
    points = [solver.solve(guess, max_iterations=k) for k in range(7)]
    solver.solve(guess, max_iterations=6, callback=reports.append)
    assert any(after.cost > before.cost for before, after in itertools.pairwise(points))
    for k, report in enumerate(reports, start=1):
        worst = max(point.cost for point in points[max(k - 4, 0) : k])
        assert points[k].cost < worst
        if report.step_length < 1.0:  # because one twice as long goes beyond
            step = points[k].us - points[k - 1].us
            longer = solver.solve(problem.rollout(points[k - 1].us + 2.0 * step), max_iterations=0)
            assert longer.cost > worst
    assert min(report.step_length for report in reports) == 0.5


class Bent(Curved):
    """A transition that curves so much that a full step from rest leaves 0.861 of a gap of 1 and costs 0.5."""

    name = "bent"

    def step(self, x, u, p):
        return u + 3.444 * u**2

    def cost(self, x, u, p):
        return LeastSquares(u, ca.SX(2.0))

    def terminal_cost(self, x, p):
        return LeastSquares(x - 1.0, ca.SX(2.0))


@pytest.mark.parametrize(("margin", "length"), [(1.81, 1.0), (1.79, 0.5)])
def test_the_penalty_is_set_to_twice_the_margin(margin: float, length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first subproblem's costate is 1: a penalty of twice the margin outweighs the cost from 0.5 / 0.139 on."""
    guess = Trajectory(np.array([[0.0], [1.0]]), np.zeros((1, 1)))
    reports: list[Progress] = []
    monkeypatch.setattr("lgmpc.solvers.line_search_sqp._MARGIN", margin)
    solver = LineSearchSqp(ShootingProblem(Bent(), 1))
    assert solver.solve(guess, callback=reports.append).status is Status.CONVERGED
    assert reports[0].step_length == length


def test_rounding_is_not_reported_as_infeasible(cart: ShootingProblem, unicycle: ShootingProblem) -> None:
    """The tightest tolerance is either met or beyond the precision; nothing is infeasible."""
    for problem in (cart, unicycle):
        solution = LineSearchSqp(problem, LineSearchSqpSettings(tolerance=1e-13)).solve()
        assert solution.status in (Status.CONVERGED, Status.PRECISION_LIMIT), solution.explain()
        assert solution.residual().largest < 1e-10


def test_solves_are_repeatable_to_the_bit(cart: ShootingProblem) -> None:
    solver = LineSearchSqp(cart)
    first, second = solver.solve(), solver.solve()
    np.testing.assert_array_equal(first.xs, second.xs)
    np.testing.assert_array_equal(first.multipliers, second.multipliers)
    assert first.kkt == second.kkt


@pytest.mark.parametrize(("name", "value"), [("tolerance", 0.0), ("tolerance", 1e-300), ("max_iterations", -1)])
def test_invalid_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        LineSearchSqpSettings(**{name: value})


def test_a_solution_as_the_guess_brings_its_multipliers(cart: ShootingProblem) -> None:
    solver = LineSearchSqp(cart)
    first = solver.solve()
    assert first.status is Status.CONVERGED and (np.abs(first.multipliers) > 1e-3).any()
    again = solver.solve(first)
    assert again.status is Status.CONVERGED and again.iterations == 0
    np.testing.assert_array_equal(again.multipliers, first.multipliers)
    cart.set_initial_state(cart.x0 + 1e-3)
    sweeps: dict[bool, list[int]] = {True: [], False: []}
    found = {}
    for warm, seen in sweeps.items():
        guess = first if warm else first.trajectory
        found[warm] = solver.solve(guess, callback=lambda _, seen=seen: seen.append(solver.qp_solver.iterations))
    assert sweeps[True][0] < sweeps[False][0]  # factorisations of the first quadratic programme
    assert found[True].status is found[False].status is Status.CONVERGED
    np.testing.assert_allclose(found[True].us, found[False].us, atol=1e-6)


class Speed(Residual):
    """Speeds of the joints."""

    nr = 7

    def expression(self, s: StageSymbols) -> object:
        return s.v


def hard_arm(seed: int) -> ShootingProblem:
    """A random arm of seven joints whose hand reaches a place in a second, and rests there, all limits hard."""
    rng, model, parent = np.random.default_rng(seed), pin.Model(), 0
    for _ in range(7):
        axis = rng.standard_normal(3)
        turn = pin.exp3(0.5 * rng.standard_normal(3))
        place = pin.SE3(turn, np.array([0, 0, rng.uniform(0.1, 0.35)]) + 0.05 * rng.standard_normal(3))
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        parent = model.addJoint(parent, joint, place, f"joint_{parent}")
        inertia = pin.Inertia(rng.uniform(0.5, 3.0), np.array([0, 0, 0.1]), 0.02 * rng.uniform(0.5, 2.0) * np.eye(3))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    model.addBodyFrame("hand", parent, pin.SE3(np.eye(3), np.array([0, 0, 0.15])), 0)
    start = rng.uniform(-1.2, 1.2, 7)
    end, data = start + rng.uniform(-1.2, 1.2, 7), model.createData()
    pin.framesForwardKinematics(model, data, end)
    goal = FrameTranslation("hand", data.oMf[model.getFrameId("hand")].translation.copy())
    loads = [np.abs(pin.computeGeneralizedGravity(model, data, q)) for q in (start, end)]
    most, x0 = 1.6 * np.maximum(*loads) + 2.0, np.concatenate([start, np.zeros(7)])
    dynamics = FreeForwardDynamics(model)
    costs = [CostItem("x", StateError(dynamics.state, x0), np.repeat([1e-3, 1e-2], 7)), CostItem("u", Control(7), 1e-3)]
    limits = [
        ConstraintItem("effort", Control(7), -most, most),
        ConstraintItem("speed", Speed(), -3.0, 3.0),
        ConstraintItem("position", JointPosition(7), np.minimum(start, end) - 0.15, np.maximum(start, end) + 0.15),
    ]
    reach = MultibodyAction("reach", dynamics, costs, limits)
    arrive = HoldAction("arrive", model, [], [ConstraintItem("hand", goal), ConstraintItem("rest", Speed())])
    problem = ShootingProblem([reach] * 50 + [arrive], terminal=reach)
    problem.set("duration", 0.02, range(50))
    problem.set_initial_state(x0)
    return problem


@pytest.mark.parametrize(
    ("seed", "cost"),  # by ipopt from the same guess, which takes ten times as long
    [(1006, 1.63247), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((1000, 1.77188), (1008, 3.28152)))],
)
def test_hard_constrained_arms_are_solved_with_default_settings(seed: int, cost: float) -> None:
    """From rest at the beginning, which violates the constraint at the end; SQP steps alone do not converge."""
    solution = LineSearchSqp(hard_arm(seed)).solve()
    assert solution.status is Status.CONVERGED, solution.explain()
    assert solution.residual().largest <= 1.01e-6
    assert solution.cost == pytest.approx(cost, rel=1e-5)
