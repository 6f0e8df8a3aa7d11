"""Exact Hessians: quadratic convergence where Gauss-Newton crawls, and safety where they are not convex.

An arm is to reach for a place beyond its reach. The residual stays large, so its curvature, which Gauss-Newton leaves
out, is what the cost's Hessian mostly consists of.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import FreeForwardDynamics, MultibodyAction
from lgmpc.compile import find_compiler
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameTranslation, StateError
from lgmpc.ocp import LagrangianHessians, ShootingProblem, SubproblemFunctions, Trajectory
from lgmpc.solvers import (
    BoxFddp,
    Fddp,
    FddpSettings,
    History,
    LineSearchSqp,
    LineSearchSqpSettings,
    Progress,
    Solution,
    Status,
)
from lgmpc.solvers.curvature import is_convex

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


@lru_cache
def arm() -> pin.Model:
    """Two links of 1 m in a vertical plane."""
    model, parent = pin.Model(), 0
    for name, place in (("shoulder", 0.0), ("elbow", 1.0)):
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([place, 0.0, 0.0])), name)
        link = pin.Inertia(1.0, np.array([0.5, 0.0, 0.0]), 0.02 * np.eye(3))
        model.appendBodyToJoint(parent, link, pin.SE3.Identity())
    model.addFrame(pin.Frame("hand", parent, 0, pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])), pin.FrameType.OP_FRAME))
    return model


def beyond_reach(limit: float | None = None) -> ShootingProblem:
    """A place 4 m away, by motors with or without limits."""
    dynamics = FreeForwardDynamics(arm())
    x0 = np.array([1.2, 0.5, 0.0, 0.0])
    costs = [
        CostItem("hand", FrameTranslation("hand", np.array([3.0, 0.0, 2.6])), 10.0),
        CostItem("rest", StateError(dynamics.state, x0), [0.0, 0.0, 0.1, 0.1]),
        CostItem("effort", Control(2), 0.1),
    ]
    rows = [] if limit is None else [ConstraintItem("motors", Control(2), -limit, limit)]
    action = MultibodyAction("beyond_reach" if limit is None else "beyond_reach_bounded", dynamics, costs, rows)
    problem = ShootingProblem(action, 30)
    problem.set("duration", 0.03)
    problem.set_initial_state(x0)
    return problem


class Iterates:
    """A callback that keeps states and controls of every iteration."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []

    def __call__(self, progress: Progress) -> None:
        assert progress.iterate is not None
        self.points.append(np.concatenate([progress.iterate.xs.ravel(), progress.iterate.us.ravel()]))

    def assert_quadratic(self, solution: Solution) -> None:
        """Check that at least three errors below 3, down to rounding, are each below the last one's square."""
        end = np.concatenate([solution.xs.ravel(), solution.us.ravel()])
        errors = np.array([np.abs(point - end).max() for point in self.points])
        errors = errors[np.flatnonzero(errors > 3.0).max() + 1 :]
        assert len(errors) >= 3
        assert (errors[1:] < np.maximum(errors[:-1] ** 2, 1e-7)).all(), errors


@pytest.mark.usefixtures("interpreted")
def test_both_solvers_converge_quadratically_where_gauss_newton_crawls() -> None:
    """Each is compared with the solution of the other."""
    fddp, sqp = (FddpSettings, LineSearchSqpSettings)
    slow = Fddp(beyond_reach(), fddp(max_iterations=500)).solve()
    stuck = LineSearchSqp(beyond_reach(), sqp(tolerance=1e-8)).solve(max_iterations=200)
    first, second = Iterates(), Iterates()
    one = Fddp(beyond_reach(), fddp(hessian="exact", stationarity=1e-10)).solve(callback=first)
    other = LineSearchSqp(beyond_reach(), sqp(hessian="exact", tolerance=1e-9)).solve(callback=second)
    assert one.status is other.status is Status.CONVERGED
    assert one.iterations <= 20 and other.iterations <= 20
    assert slow.iterations > 100 and stuck.status is not Status.CONVERGED
    assert one.cost == pytest.approx(slow.cost, rel=1e-7)
    first.assert_quadratic(other)
    second.assert_quadratic(one)


def assert_faster_than_gauss_newton(found: Solution) -> None:
    """Where motors reach their limits."""
    slow = BoxFddp(beyond_reach(15.0), FddpSettings(max_iterations=500)).solve()
    assert slow.status is Status.CONVERGED
    assert found.status is Status.CONVERGED and 3 * found.iterations < slow.iterations
    assert (np.abs(found.us) > 15.0 - 1e-6).sum() >= 10
    assert found.cost == pytest.approx(slow.cost, rel=1e-8)


@pytest.mark.usefixtures("interpreted")
def test_with_bounds_the_solution_is_that_of_gauss_newton() -> None:
    assert_faster_than_gauss_newton(BoxFddp(beyond_reach(15.0), FddpSettings(hessian="exact")).solve())


@pytest.mark.slow
def test_with_bounds_the_sqp_finds_it_too() -> None:
    """By active sets, which are compiled."""
    assert_faster_than_gauss_newton(LineSearchSqp(beyond_reach(15.0), LineSearchSqpSettings(hessian="exact")).solve())


@pytest.mark.usefixtures("interpreted")
def test_steps_descend_where_they_are_not_convex() -> None:
    """Around an arm that is stretched out the other way the cost is concave in the joints."""
    problem = beyond_reach()
    x0 = np.array([np.pi + 0.7, 0.0, 0.0, 0.0])
    problem.set_initial_state(x0)
    guess = Trajectory(np.tile(x0, (31, 1)), np.zeros((30, 2)))
    exact = LagrangianHessians(problem, guess.xs, guess.us)
    exact.evaluate()
    assert np.linalg.eigvalsh(exact.hessian).min() < -0.1
    history = History()
    found = Fddp(problem, FddpSettings(hessian="exact")).solve(guess, callback=history)
    costs = history.column("cost")
    assert found.status is Status.CONVERGED and found.iterations < 60
    assert (np.diff(costs[history.column("gap") == 0.0]) < 1e-9 * costs[-1]).all()


@pytest.mark.parametrize("qp_solver", ["piqp", None])
def test_the_sqp_takes_other_qp_solvers_and_needs_no_compiler(
    qp_solver: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are given models that are convex along the dynamics."""
    monkeypatch.setenv("LGMPC_JIT", "0")
    expected = Fddp(beyond_reach(), FddpSettings(hessian="exact")).solve()
    found = LineSearchSqp(beyond_reach(), LineSearchSqpSettings(hessian="exact"), qp_solver).solve()
    assert found.status is expected.status is Status.CONVERGED and found.iterations < 20
    assert found.cost == pytest.approx(expected.cost, rel=1e-8)


@pytest.mark.usefixtures("interpreted")
def test_convexity_along_the_dynamics_is_that_of_the_reduced_hessian() -> None:
    """The smallest eigenvalue in the controls alone, states eliminated, changes its sign with the weight of them."""
    action = MultibodyAction("convexity", FreeForwardDynamics(arm()), [CostItem("effort", Control(2), 1.0)])
    qp = SubproblemFunctions(ShootingProblem(action, 3), exact=True).qp
    rng, ndx, nu = np.random.default_rng(0), 4, 2
    verdicts = []
    for _ in range(20):
        blocks = {name: rng.standard_normal((3, *qp.structure.blocks[name].shape)) for name in "ABQSR"}
        blocks["Q"] = blocks["Q"] + np.swapaxes(blocks["Q"], 1, 2)
        blocks["R"] = blocks["R"] + np.swapaxes(blocks["R"], 1, 2) + 60.0 * rng.uniform() * np.eye(nu)
        last = rng.standard_normal((ndx, ndx))
        for name, block in qp.structure.blocks.items():
            if name in blocks:
                mask = np.zeros(block.shape)
                mask[block.rows, block.columns] = 1.0
                blocks[name] = blocks[name] * mask
                qp.values[:, block.where] = blocks[name][:, block.rows, block.columns]
        block = qp.structure.terminal_blocks["Q"]
        qp.terminal_values[block.where] = (last + last.T)[block.rows, block.columns]
        onto, reduced = np.zeros((ndx, 3 * nu)), np.zeros((3 * nu, 3 * nu))
        for k in range(3):
            pick = np.zeros((nu, 3 * nu))
            pick[:, nu * k : nu * k + nu] = np.eye(nu)
            cross = pick.T @ blocks["S"][k] @ onto
            reduced += onto.T @ blocks["Q"][k] @ onto + cross + cross.T + pick.T @ blocks["R"][k] @ pick
            onto = blocks["A"][k] @ onto + blocks["B"][k] @ pick
        reduced += onto.T @ (last + last.T) @ onto
        verdicts.append(bool(np.linalg.eigvalsh(reduced).min() > 0.0))
        assert is_convex(qp) == verdicts[-1]
    assert 3 < sum(verdicts) < 17
