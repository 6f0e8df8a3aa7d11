from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lgmpc.solvers import BoxFddp, Fddp, FddpSettings, Progress, Status

pytestmark = pytest.mark.crocoddyl


def test_same_optimum_in_as_many_iterations(pair: Any) -> None:
    import crocoddyl

    solver = crocoddyl.SolverFDDP(pair.theirs)
    done = solver.solve(list(pair.guess.xs), pair.their_us(pair.guess.us), 200, False)
    solution = Fddp(pair.ours).solve(pair.guess, max_iterations=200)
    assert done and solution.status is Status.CONVERGED
    assert abs(solution.iterations - (solver.iter + 1)) <= 2
    assert solution.cost == pytest.approx(solver.cost, rel=1e-6)
    as_theirs = Fddp(pair.ours, FddpSettings(stationarity=np.inf)).solve(pair.guess, max_iterations=200)
    assert as_theirs.iterations == solver.iter + 1
    # Where the cost hardly changes any more, trajectories still do: they are compared at the optimum itself.
    solver.th_stop = 1e-13
    solver.solve(list(pair.guess.xs), pair.their_us(pair.guess.us), 200, False)
    solution = Fddp(pair.ours, FddpSettings(tolerance=1e-13)).solve(pair.guess, max_iterations=200)
    state = pair.ours.state
    for x, theirs in zip(solution.xs, solver.xs, strict=True):
        np.testing.assert_allclose(state.diff(np.array(theirs), x), 0.0, atol=1e-5)
    scale = max(1.0, np.abs(solution.us).max())
    for u, theirs in zip(pair.their_us(solution.us), solver.us, strict=True):
        np.testing.assert_allclose(u, theirs, atol=1e-5 * scale)


def test_gaits_have_the_same_optimum_in_as_many_iterations(gait: Any) -> None:
    """With Crocoddyl's own stopping; a stationary solution takes up to a few iterations more, and costs no more."""
    import crocoddyl

    solver = crocoddyl.SolverFDDP(gait.theirs)
    done = solver.solve(list(gait.guess.xs), gait.their_us(gait.guess.us), 100, False)
    as_theirs = Fddp(gait.ours, FddpSettings(stationarity=np.inf)).solve(gait.guess, max_iterations=100)
    assert done and as_theirs.status is Status.CONVERGED
    assert abs(as_theirs.iterations - (solver.iter + 1)) <= 1
    assert as_theirs.cost == pytest.approx(solver.cost, rel=1e-8)
    solution = Fddp(gait.ours).solve(gait.guess, max_iterations=100)
    assert solution.status is Status.CONVERGED
    assert solution.cost <= solver.cost * (1.0 + 1e-9)


def test_same_first_iteration_from_a_feasible_guess(tame_pair: Any) -> None:
    """Away from the optimum as well. (With gaps they differ: Crocoddyl leaves out the gaps' own derivatives.)"""
    import crocoddyl

    pair = tame_pair
    rolled = pair.ours.rollout(pair.guess.us)
    solver = crocoddyl.SolverFDDP(pair.theirs)
    solver.solve(list(rolled.xs), pair.their_us(rolled.us), 1, True)
    reports: list[Progress] = []
    Fddp(pair.ours).solve(rolled, max_iterations=1, callback=reports.append)
    assert reports[0].step_length == solver.stepLength
    assert reports[0].cost == pytest.approx(solver.cost, rel=1e-7)
    assert reports[0].criterion == pytest.approx(solver.stop, rel=1e-7)


def test_solutions_are_stationary_by_differences_of_their_own_roll_out(tame_pair: Any) -> None:
    """Along random changes of all controls, against the same derivative at the guess."""
    pair = tame_pair
    solution = Fddp(pair.ours, FddpSettings(tolerance=1e-12)).solve(pair.guess, max_iterations=200)
    assert solution.status is Status.CONVERGED

    def slope(us: np.ndarray, direction: np.ndarray, h: float) -> float:
        costs = []
        for step in (h, -h):
            controls = pair.their_us(us + step * direction)
            costs.append(pair.theirs.calc(pair.theirs.rollout(controls), controls))
        return float(costs[0] - costs[1]) / (2 * h)

    rng = np.random.default_rng(0)
    for _ in range(5):
        direction = rng.standard_normal(solution.us.shape)
        direction /= np.linalg.norm(direction)
        there, before = slope(solution.us, direction, 1e-4), slope(pair.guess.us, direction, 1e-4)
        assert abs(there) < 1e-6 * (abs(before) + solution.cost)  # a hundred times as much with controls off by 1 %


def test_a_roll_out_costs_the_same(tame_pair: Any) -> None:
    pair = tame_pair
    rolled = pair.ours.rollout(pair.guess.us)
    theirs = pair.theirs.rollout(pair.their_us(pair.guess.us))
    for x, other in zip(rolled.xs, theirs, strict=True):
        np.testing.assert_allclose(pair.ours.state.diff(np.array(other), x), 0.0, atol=1e-9)
    cost = pair.theirs.calc(theirs, pair.their_us(pair.guess.us))
    assert Fddp(pair.ours).solve(rolled, max_iterations=0).cost == pytest.approx(cost, rel=1e-10)


def test_same_optimum_with_bounds_on_the_controls_in_no_more_iterations(bounded_quadrotor: Any) -> None:
    import crocoddyl

    pair = bounded_quadrotor
    solver = crocoddyl.SolverBoxFDDP(pair.theirs)
    solver.th_stop = 1e-13
    solver.solve(list(pair.guess.xs), list(pair.guess.us), 300, False)
    solution = BoxFddp(pair.ours, FddpSettings(tolerance=1e-13)).solve(pair.guess, max_iterations=300)
    assert solution.status is Status.CONVERGED
    assert (solution.us.min(), solution.us.max()) == (1.0, 6.0)
    assert solution.cost == pytest.approx(solver.cost, rel=1e-6)
    for x, theirs in zip(solution.xs, solver.xs, strict=True):
        np.testing.assert_allclose(pair.ours.state.diff(np.array(theirs), x), 0.0, atol=1e-5)
    assert solution.iterations <= solver.iter + 1
