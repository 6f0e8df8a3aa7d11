"""ProxQP's answers against a second solver and against the optimality conditions, recomputed here."""

import numpy as np
import piqp
import pytest
from scipy.optimize import lsq_linear

from lgmpc.wbc import (
    QpAssembly,
    QpStatus,
    TaskStack,
    WholeBodySettings,
    WholeBodySolver,
    WholeBodyTerms,
    standing_tasks,
)


class Problem:
    """Terms, tasks, assembly and solver, as the controller strings them together."""

    def __init__(self, robot, tolerance):
        settings = WholeBodySettings()
        self.terms = WholeBodyTerms(robot)
        self.stack = TaskStack(standing_tasks(robot, settings), robot.nv)
        self.qp = QpAssembly(robot, self.stack, settings.limits, settings.force_weight, settings.acceleration_weight)
        self.solver = WholeBodySolver(self.qp, tolerance)

    def write(self, q, v, reference):
        self.terms.update(q, v)
        self.stack.update(self.terms, reference)
        self.qp.update(self.terms, reference)

    def cost(self, z):
        return 0.5 * z @ self.qp.hessian @ z + self.qp.gradient @ z


def solve_by_interior_point(qp):
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-8
    solver.settings.eps_rel = 0.0
    bounds = [np.where(np.abs(b) > 1e19, np.copysign(np.inf, b), b) for b in (qp.box_lower, qp.box_upper)]
    lower = np.where(qp.lower < -1e19, -np.inf, qp.lower)
    solver.setup(
        qp.hessian, qp.gradient, qp.equality, qp.equality_rhs, qp.inequality, lower, qp.upper, bounds[0], bounds[1]
    )
    assert solver.solve() == piqp.PIQP_SOLVED
    return solver.result.x.copy()


@pytest.fixture
def trials(solo12, random_state, standing, randomise):
    """Ten QPs, each written into the problem just before it is given."""

    def write_each(problem):
        rng = np.random.default_rng(30)
        for trial in range(10):
            q, v = random_state(rng)
            problem.terms.update(q, v)
            randomise(standing, problem.terms, rng)
            standing.stance[:] = True
            standing.stance[trial % 4] = trial % 3 > 0
            problem.write(q, v, standing)
            yield problem.qp

    return write_each


def violation(qp, z):
    rows = qp.inequality @ z
    return max(
        np.abs(qp.equality @ z - qp.equality_rhs).max(),
        (rows - qp.upper).max(),
        (qp.lower - rows).max(),
        (z - qp.box_upper).max(),
        (qp.box_lower - z).max(),
    )


def test_same_solution_as_an_interior_point_method(solo12, trials):
    problem = Problem(solo12, 1e-9)
    for qp in trials(problem):
        problem.solver.reset()
        assert problem.solver.solve() is QpStatus.SOLVED
        other = solve_by_interior_point(qp)
        z = problem.solver.solution
        assert violation(qp, z) < 1e-8
        assert problem.cost(z) == pytest.approx(problem.cost(other), rel=1e-7, abs=1e-8)
        np.testing.assert_allclose(z[18:], other[18:], atol=1e-4)  # forces, N
        np.testing.assert_allclose(z[:18], other[:18], atol=1e-3)  # accelerations, up to 1e3 rad/s2


def test_solutions_are_optimal(solo12, trials):
    """-gradient lies in the cone of the active constraints' normals: multipliers found here, not the solver's."""
    problem = Problem(solo12, 1e-8)
    for qp in trials(problem):
        problem.solver.reset()
        assert problem.solver.solve() is QpStatus.SOLVED
        z = problem.solver.solution
        rows, identity, near = qp.inequality @ z, np.eye(z.size), 1e-5
        normals = np.vstack(
            [
                qp.inequality[rows > qp.upper - near],
                -qp.inequality[rows < qp.lower + near],
                identity[z > qp.box_upper - near],
                -identity[z < qp.box_lower + near],
            ]
        )
        slope = qp.hessian @ z + qp.gradient
        free = np.full(qp.equality.shape[0], -np.inf)
        multipliers = lsq_linear(
            np.vstack([qp.equality, normals]).T,
            -slope,
            (np.concatenate([free, np.zeros(len(normals))]), np.inf),
            method="bvls",
            tol=1e-14,
        )
        assert np.abs(multipliers.fun).max() < 1e-5 * max(1.0, np.abs(qp.gradient).max())


def test_warm_and_cold_starts_agree(solo12, random_state, standing, randomise):
    """Along a motion with a sudden push in it, where the active set changes from tick to tick."""
    warm, cold = Problem(solo12, 1e-8), Problem(solo12, 1e-8)
    rng = np.random.default_rng(31)
    q, v = solo12.q_reference.copy(), np.zeros(solo12.nv)
    iterations = {"warm": 0, "cold": 0}
    for tick in range(120):
        standing.external_wrench[1] = 12.0 if 40 <= tick < 80 else 0.0
        standing.com_acceleration[:] = 3.0 * np.sin(0.1 * tick + np.arange(3))
        v[6:] = 0.2 * np.sin(0.2 * tick + np.arange(12)) + 1e-3 * rng.normal(size=12)
        for problem in (warm, cold):
            problem.write(q, v, standing)
        cold.solver.reset()
        assert warm.solver.solve() is QpStatus.SOLVED and cold.solver.solve() is QpStatus.SOLVED
        iterations["warm"] += warm.solver.iterations
        iterations["cold"] += cold.solver.iterations
        np.testing.assert_allclose(warm.solver.solution[18:], cold.solver.solution[18:], atol=1e-3)
        np.testing.assert_allclose(warm.solver.solution[:18], cold.solver.solution[:18], atol=1e-2)
    assert iterations["warm"] < iterations["cold"]


def test_numbers_that_are_not_finite_are_seen_wherever_they_are(solo12, standing):
    problem = Problem(solo12, 1e-6)
    at_rest = np.zeros(solo12.nv)
    problem.write(solo12.q_reference, at_rest, standing)
    assert problem.solver.solve() is QpStatus.SOLVED
    for name in ("com", "com_velocity", "base_rotation", "joint_position", "contact_forces", "external_wrench"):
        target = getattr(standing, name)
        kept = target.copy()
        target.flat[-1] = np.nan
        problem.write(solo12.q_reference, at_rest, standing)
        assert problem.solver.solve() is QpStatus.NOT_FINITE, name
        target[...] = kept
        problem.write(solo12.q_reference, at_rest, standing)
        assert problem.solver.solve() is QpStatus.SOLVED, name
