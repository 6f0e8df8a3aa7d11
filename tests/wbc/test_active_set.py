"""Active sets on QPs drawn at random, against an interior point method and the optimality conditions."""

import numpy as np
import pytest

from lgmpc.wbc.solver import DualActiveSet

N, E, M = 12, 3, 20


class Problem:
    """A QP with a point that satisfies its constraints, at some of the limits."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        root = 10.0 ** rng.uniform(-1.0, 1.0, (N, 1)) * rng.normal(size=(N, N))
        self.hessian = root.T @ root + 1e-2 * np.eye(N)
        self.gradient = 10.0 * rng.normal(size=N)
        self.equality, self.inequality = rng.normal(size=(E, N)), rng.normal(size=(M, N))
        self.inside = inside = rng.normal(size=N)
        self.equality_rhs, rows = self.equality @ inside, self.inequality @ inside
        loose = rng.uniform(0.0, 1.0, (2, M)) * (rng.random((2, M)) < 0.9)
        self.lower, self.upper = rows - loose[0], rows + loose[1] + 1e-3
        self.box_lower, self.box_upper = inside - rng.uniform(0.01, 1.0, N), inside + rng.uniform(0.01, 1.0, N)

    def solver(self, tolerance=1e-8):
        return DualActiveSet(
            self.hessian, self.gradient, self.equality, self.equality_rhs, self.inequality, self.lower, self.upper,
            self.box_lower, self.box_upper, tolerance,
        )  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_the_solution_is_the_minimiser(seed, measures):
    problem = Problem(seed)
    solver = problem.solver()
    assert solver.solve()
    x = solver.solution
    assert measures.violation(problem, x) < 1e-8
    assert measures.stationarity(problem, x) < 1e-6
    np.testing.assert_allclose(x, measures.solve_by_interior_point(problem), atol=1e-5)
    np.testing.assert_allclose(solver.values, problem.inequality @ x, atol=1e-12)
    assert 0 < solver.active <= N - E and solver.steps >= solver.active


def test_a_change_of_the_data_is_followed_from_the_last_active_limits(measures):
    """In fewer steps than from none, to the same point; after a reset the bits are those of a first solve."""
    problem, rng = Problem(3), np.random.default_rng(50)
    warm, cold = problem.solver(), problem.solver()
    steps = np.zeros(2, dtype=int)
    first = None
    for k in range(40):
        problem.gradient += (20.0 if k == 20 else 0.3) * rng.normal(size=N)
        problem.upper[:] += 0.01 * rng.random(M)
        cold.reset()
        assert warm.solve() and cold.solve()
        steps += warm.steps, cold.steps
        np.testing.assert_allclose(warm.solution, cold.solution, atol=1e-9)
        if k == 39:
            first = problem.solver()
            assert first.solve()
            np.testing.assert_array_equal(first.solution, cold.solution)
    assert steps[0] < 0.3 * steps[1]


def test_limits_that_depend_on_each_other_are_no_obstacle(measures):
    """Rows twice, a row that a box bound repeats, and more limits than variables through one point."""
    problem = Problem(5)
    problem.inequality[1:4] = problem.inequality[0] * np.array([[1.0], [2.0], [-1.0]])
    problem.inequality[4] = np.eye(N)[0]
    tip = problem.solver()
    assert not tip.solve()  # the bounds of what were different rows contradict each other
    inside = 0.5 * (problem.box_lower + problem.box_upper)
    problem.equality_rhs[:] = problem.equality @ inside
    problem.lower[:], problem.upper[:] = -1e20, problem.inequality @ inside  # all rows meet at this point
    problem.lower[3] = -problem.upper[0]
    problem.upper[3] = 1e20
    rng = np.random.default_rng(51)
    at_tip = 0
    for _ in range(30):
        problem.gradient[:] = 30.0 * rng.normal(size=N) - problem.hessian @ inside
        problem.gradient -= problem.inequality.T @ rng.uniform(0.0, 30.0, M)
        assert tip.solve()
        assert measures.violation(problem, tip.solution) < 1e-8
        assert measures.stationarity(problem, tip.solution) < 1e-6
        at_tip += np.abs(tip.solution - inside).max() < 1e-8
    assert at_tip > 0


def test_variables_with_equal_bounds_are_fixed(measures):
    """The same solution as with an equality for each, whatever the Hessian says of them."""
    problem, other, fixed = Problem(7), Problem(7), [2, 5, 11]
    values = problem.inside[fixed]
    problem.box_lower[fixed] = problem.box_upper[fixed] = values
    other.equality = np.vstack([other.equality, np.eye(N)[fixed]])
    other.equality_rhs = np.concatenate([other.equality_rhs, values])
    solver, reference = problem.solver(), other.solver()
    assert solver.solve() and reference.solve()
    np.testing.assert_array_equal(solver.solution[fixed], values)
    np.testing.assert_allclose(solver.solution, reference.solution, atol=1e-8)
    problem.hessian[fixed, fixed] = -1.0
    assert solver.solve()
    np.testing.assert_allclose(solver.solution, reference.solution, atol=1e-8)


def break_bounds(problem):
    problem.lower[4] = problem.upper[4] + 1.0


def break_hessian(problem):
    problem.hessian[:, 3] = problem.hessian[3] = 0.0


def break_equalities(problem):
    problem.equality[2] = problem.equality[0] - problem.equality[1]


def break_number(problem):
    problem.gradient[6] = np.nan


@pytest.mark.parametrize("spoil", [break_bounds, break_hessian, break_equalities, break_number])
def test_what_has_no_unique_solution_is_refused_and_leaves_no_trace(spoil):
    problem = Problem(9)
    solver = problem.solver()
    assert solver.solve()
    spoil(problem)
    assert not solver.solve()
    assert solver.active == 0


def test_without_a_compiler_nothing_is_solved(monkeypatch):
    monkeypatch.setenv("LGMPC_JIT", "0")
    solver = Problem(0).solver()
    assert not solver.available and not solver.solve()
