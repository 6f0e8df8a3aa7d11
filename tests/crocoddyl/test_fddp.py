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
