"""Crocoddyl's own kinds of problems from a plain guess and from perturbed ones: equal cost or lower, no more work."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from paired_problems import ANYMAL_GAITS, anymal_gait
from paired_robots import Pair, arm, paired, quadrotor, talos

from lgmpc.ocp import Trajectory
from lgmpc.solvers import BoxFddp, Fddp, FddpSettings, Status

pytestmark = pytest.mark.crocoddyl

JUMP_LIMIT = 60.0
"""N.m; without it the jump takes 79."""


def gait(name: str, limit: float = np.inf) -> Pair:
    return paired(anymal_gait(name, limit))


PROBLEMS: dict[str, Callable[[], Pair]] = {
    **{f"anymal {name}": partial(gait, name) for name in ANYMAL_GAITS},
    "anymal jump, limited": partial(gait, "jump", JUMP_LIMIT),
    "quadrotor, limited": partial(quadrotor, bounds=(1.0, 6.0)),
    "arm": arm,
    "talos": talos,
}
LIMITED = {"anymal jump, limited": JUMP_LIMIT, "quadrotor, limited": 6.0}


def guesses(pair: Pair) -> list[Trajectory]:
    """The plain guess and five about it: states off by 0.02 in tangent coordinates, controls by 2 % of the largest."""
    plain, state, rng = pair.guess, pair.ours.state, np.random.default_rng(0)
    found = [plain]
    for _ in range(5):
        away = 0.02 * rng.standard_normal((len(plain.xs), state.ndx))
        away[0] = 0.0
        us = plain.us + 0.02 * np.abs(plain.us).max() * rng.standard_normal(plain.us.shape)
        found.append(Trajectory(state.integrate(plain.xs, away), us))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_higher_cost_in_no_more_than_three_iterations_more(name: str) -> None:
    """With Crocoddyl's own stopping. Some solves take up to ten iterations fewer."""
    crocoddyl = pytest.importorskip("crocoddyl")
    pair, limited = PROBLEMS[name](), name in LIMITED
    solver = (crocoddyl.SolverBoxFDDP if limited else crocoddyl.SolverFDDP)(pair.theirs)
    mine = (BoxFddp if limited else Fddp)(pair.ours, FddpSettings(stationarity=np.inf))
    for guess in guesses(pair):
        assert solver.solve(list(guess.xs), pair.their_us(guess.us), 300, False)
        solution = mine.solve(guess, max_iterations=300)
        assert solution.status is Status.CONVERGED
        assert solution.cost <= solver.cost * (1.0 + 1e-8)
        # Its box solver stops with active bounds not settled: up to 4e-6 above.
        assert solution.cost == pytest.approx(solver.cost, rel=1e-5 if limited else 1e-8)
        assert solution.iterations <= solver.iter + 1 + 3
        if limited:
            assert np.abs(solution.us).max() == LIMITED[name]
