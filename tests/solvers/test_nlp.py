from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lgmpc.actions import Action
from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import Fddp, NlpSettings, NlpSolver, Progress, Status


def test_costs_and_conditions_of_the_solution(cart: ShootingProblem) -> None:
    guess = Trajectory(np.zeros((9, 2)), np.zeros((8, 1)))
    result = NlpSolver(cart).solve(guess)
    assert result.status is Status.CONVERGED
    xs, us = result.trajectory.xs, result.trajectory.us
    np.testing.assert_array_equal(xs[0], cart.x0)
    np.testing.assert_allclose(xs, cart.rollout(us).xs, atol=1e-9)
    action = cart.action
    total = sum(action.evaluate(xs[k], us[k], cart.parameters[k]).cost for k in range(8))
    total += float(action.terminal_value_function(xs[8], cart.parameters[8]))
    assert result.cost == pytest.approx(total, rel=1e-9)
    # Any small feasible change of a control that no row holds back costs more.
    free = [k for k in range(8) if np.abs(result.multipliers[k]).max() < 1e-6]
    assert free
    for k in free:
        for sign in (-1.0, 1.0):
            other = us.copy()
            other[k] += 1e-3 * sign
            moved = cart.rollout(other).xs
            cost = sum(action.evaluate(moved[j], other[j], cart.parameters[j]).cost for j in range(8))
            violation = max(action.evaluate(moved[j], other[j], cart.parameters[j]).violation for j in range(8))
            multipliers = np.abs(result.multipliers).sum()
            cost += float(action.terminal_value_function(moved[8], cart.parameters[8]))
            assert cost + multipliers * violation > total


def test_statuses_name_what_happened(cart: ShootingProblem, centroidal: Callable[..., ShootingProblem]) -> None:
    guess = Trajectory(np.zeros((9, 2)), np.zeros((8, 1)))
    assert NlpSolver(cart, NlpSettings(max_iterations=2)).solve(guess).status is Status.ITERATION_LIMIT
    stopped = NlpSolver(cart).solve(guess, max_iterations=2)
    assert stopped.status is Status.ITERATION_LIMIT and stopped.iterations == 2
    assert NlpSolver(cart).solve(guess, max_iterations=200).status is Status.CONVERGED
    with pytest.raises(InputError, match="max_iterations: got -1; expected at least 0"):
        NlpSolver(cart).solve(guess, max_iterations=-1)
    for limit in (-1.0, float("nan")):
        with pytest.raises(InputError, match=f"time_limit: got {limit}; expected at least 0 s"):
            NlpSolver(cart).solve(guess, time_limit=limit)
    cart.set("limit", [2.0, 0.6, -5.0])
    assert NlpSolver(cart).solve(guess).status is Status.INFEASIBLE
    cart.x0[0] = np.nan
    result = NlpSolver(cart).solve(guess)
    assert result.status is Status.NOT_FINITE
    assert "first state contains NaN" in result.explain()


def test_fatrop_finds_the_same(satellite: Callable[..., ShootingProblem]) -> None:
    problem = satellite(bounded=True)
    reference = NlpSolver(problem).solve()
    solution = NlpSolver(problem, NlpSettings(method="fatrop")).solve()
    for each in (reference, solution):
        assert each.status is Status.CONVERGED
        assert each.kkt.largest < 1e-7 and each.residual() == each.kkt
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-6)
    np.testing.assert_allclose(solution.costates, reference.costates, atol=1e-5)
    np.testing.assert_allclose(solution.multipliers, reference.multipliers, atol=1e-5)


@pytest.mark.usefixtures("interpreted")
def test_intervals_may_differ(linear: Callable[..., Action]) -> None:
    rng = np.random.default_rng(0)
    one, other, jump = (
        linear(np.eye(3), rng.standard_normal((3, nu)), rng.standard_normal(3), f"of_{nu}") for nu in (1, 2, 0)
    )
    problem = ShootingProblem([one, one, jump, other, one], terminal=other)
    problem.set("goal", 1.0)
    problem.set("weight", 0.1)
    solution, swept = NlpSolver(problem).solve(), Fddp(problem).solve()
    assert solution.status is Status.CONVERGED and solution.kkt.largest < 1e-9
    np.testing.assert_allclose(solution.us, swept.us, atol=1e-6)
    np.testing.assert_allclose(solution.costates, swept.costates, atol=1e-5)


def test_ipopt_reports_its_progress_and_can_be_stopped(cart: ShootingProblem) -> None:
    solver = NlpSolver(cart)
    reports: list[Progress] = []
    solution = solver.solve(callback=reports.append)
    assert [p.iteration for p in reports] == list(range(1, solution.iterations + 1))
    assert reports[-1].cost == pytest.approx(solution.cost)
    stopped = solver.solve(callback=lambda progress: progress.iteration == 2)
    assert stopped.status is Status.STOPPED and stopped.iterations == 2
    assert solver.solve(time_limit=0.0).status is Status.TIME_LIMIT

    def fail(progress: Progress) -> None:
        raise RuntimeError("my own")

    with pytest.raises(RuntimeError, match="my own"):
        solver.solve(callback=fail)
    with pytest.raises(SolverError, match="iteration_limit"):
        NlpSolver(cart, NlpSettings(max_iterations=1)).solve(throw=True)
    with pytest.raises(InputError, match="cannot be interrupted"):
        NlpSolver(cart, NlpSettings(method="fatrop")).solve(time_limit=1.0)
    unknown: dict[str, Any] = {"method": "ipop"}
    with pytest.raises(InputError, match="Did you mean ipopt"):
        NlpSettings(**unknown)
