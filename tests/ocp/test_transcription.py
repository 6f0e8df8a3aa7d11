from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from lgmpc.ocp import ShootingProblem, Trajectory, transcribe


@pytest.mark.parametrize("base_is_solution", [True, False])
def test_programme_states_the_problem(problem: ShootingProblem, base_is_solution: bool) -> None:
    rng = np.random.default_rng(0)
    us = np.tile([0.0, 0.0, 6.0], (5, 4)) + rng.standard_normal((5, 12))
    truth = problem.rollout(us)
    if base_is_solution:
        base = truth
    else:
        base = Trajectory(rng.standard_normal((6, 9)), rng.standard_normal((5, 12)))
    shooting = transcribe(problem)
    p = shooting.pack_parameters(problem, base)
    z = np.hstack([us - base.us, truth.xs[1:] - base.xs[1:]]).ravel()
    parts = shooting.programme
    evaluate = ca.Function("evaluate", [parts["x"], parts["p"]], [parts["f"], parts["g"]])
    cost, rows = (v.full().ravel() for v in evaluate(z, p))
    stages = [problem.action.evaluate(truth.xs[k], us[k], problem.parameters[k]) for k in range(5)]
    terminal = float(problem.action.terminal_value_function(truth.xs[5], problem.parameters[5]))
    assert cost[0] == pytest.approx(sum(stage.cost for stage in stages) + terminal, rel=1e-12)
    gaps = np.array(shooting.equalities)
    assert gaps.sum() == 45
    np.testing.assert_allclose(rows[gaps], 0.0, atol=1e-12)
    np.testing.assert_allclose(rows[~gaps], np.concatenate([stage.constraint for stage in stages]), atol=1e-12)
    lower, upper = (v.full().ravel() for v in shooting.bounds(p))
    np.testing.assert_array_equal(lower[gaps], 0.0)
    np.testing.assert_array_equal(upper[gaps], 0.0)
    np.testing.assert_array_equal(lower[~gaps], np.concatenate([stage.lower for stage in stages]))
    np.testing.assert_array_equal(upper[~gaps], np.concatenate([stage.upper for stage in stages]))
    found = shooting.unpack(z, p)
    np.testing.assert_allclose(found.xs, truth.xs, atol=1e-14)
    np.testing.assert_allclose(found.us, us, atol=1e-14)
