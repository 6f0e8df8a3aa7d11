from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import IpoptSolver, NlpStatus


def test_costs_and_conditions_of_the_solution(cart: ShootingProblem) -> None:
    guess = Trajectory(np.zeros((9, 2)), np.zeros((8, 1)))
    result = IpoptSolver(cart).solve(guess)
    assert result.status is NlpStatus.CONVERGED
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


def test_statuses_say_what_happened(cart: ShootingProblem, centroidal: Callable[..., ShootingProblem]) -> None:
    guess = Trajectory(np.zeros((9, 2)), np.zeros((8, 1)))
    assert IpoptSolver(cart, max_iterations=2).solve(guess).status is NlpStatus.ITERATION_LIMIT
    cart.set("limit", [2.0, 0.6, -5.0])
    assert IpoptSolver(cart).solve(guess).status is NlpStatus.INFEASIBLE
    cart.x0[0] = np.nan
    assert IpoptSolver(cart).solve(guess).status is NlpStatus.FAILED
