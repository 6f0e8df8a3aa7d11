from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from samples import Unicycle

from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import NlpSettings, NlpSolver, RealTimeSqp, Solution, Status
from lgmpc.solvers.qp import ActiveSetSolver, PiqpSolver

Make = Callable[..., ShootingProblem]
PUSHES = {
    "none": [0, 0, 0, 0, 0, 0, 0, 0, 0],
    "sideways": [0.0, 0.01, 0.0, 0.0, 1.5, 0.0, 0.05, 0.0, 0.0],
    "oblique and turning": [0.02, -0.01, -0.02, 1.2, 1.2, -0.3, -0.05, 0.1, 0.08],
    "beyond the friction": [0.0, 0.05, -0.03, 2.5, -4.0, 0.5, 0.2, 0.1, -0.1],
}
# Tighter than their standard settings: the forces' weights are small, so that a gradient of 1e-6 is 1e-3 N.
ACCURATE = {
    "active_set": lambda qp: ActiveSetSolver(qp, 1e-9, fallbacks=[ACCURATE["piqp"](qp)]),
    "piqp": lambda qp: PiqpSolver(qp, 1e-10),
}


def standing(problem: ShootingProblem) -> Trajectory:
    us = problem.view("u_reference")[:-1].copy()
    return Trajectory(np.tile(problem.x0, (problem.nodes + 1, 1)), us)


@pytest.fixture(scope="module", params=PUSHES)
def pushed(centroidal: Make, request: pytest.FixtureRequest) -> tuple[ShootingProblem, Trajectory, Solution]:
    """A problem, a guess and the solution of ipopt."""
    problem = centroidal()
    problem.view("contact_flags")[8:12, 2] = 0.0
    problem.view("external_wrench")[:6] = [0.0, 4.0, 0.0, 0.1, 0.0, 0.0]
    problem.set_initial_state(problem.x0 + PUSHES[request.param])
    guess = standing(problem)
    reference = NlpSolver(problem, NlpSettings(tolerance=1e-10)).solve(guess)
    assert reference.status is Status.CONVERGED
    return problem, guess, reference


@pytest.mark.parametrize("qp_solver", ACCURATE)
def test_iterations_converge_to_the_solution_of_ipopt(
    pushed: tuple[ShootingProblem, Trajectory, Solution], qp_solver: str
) -> None:
    problem, guess, reference = pushed
    solver = RealTimeSqp(problem, ACCURATE[qp_solver])
    solver.set_guess(guess)
    for _ in range(30):
        solver.prepare()
        result = solver.feedback(problem.x0)
        assert result.status is Status.STEPPED
    np.testing.assert_allclose(result.trajectory.xs, reference.trajectory.xs, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.trajectory.us, reference.trajectory.us, rtol=0, atol=1e-5)
    np.testing.assert_allclose(result.costates, reference.costates, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(result.multipliers, reference.multipliers, rtol=0, atol=1e-6)


def converged(solver: RealTimeSqp, iterations: int = 15) -> Solution:
    for _ in range(iterations):
        solver.prepare()
        result = solver.feedback(solver.problem.x0)
    return result


def test_real_time_iteration_follows_the_converged_controller_in_closed_loop(centroidal: Make) -> None:
    problem = centroidal()
    action, period = problem.action, 0.01

    def run(iterations: int) -> np.ndarray:
        problem.set_initial_state(problem.x0)
        x, states = problem.x0.copy(), []
        solver = RealTimeSqp(problem)
        solver.set_guess(standing(problem))
        for i in range(80):
            problem.set("external_wrench", [10.5, 10.5, 0.0, 0.0, 0.0, 0.1] if 10 <= i < 30 else 0.0)
            if i > 0:
                solver.shift(period / 0.02)
            for _ in range(iterations):
                solver.prepare()
                result = solver.feedback(x)
            p = problem.parameters[0].copy()
            p[action.parameters["duration"]] = period
            x = action.evaluate(x, result.trajectory.us[0], p).x_next
            states.append(x)
        return np.array(states)

    real_time, converged = run(1), run(12)
    moved = np.abs(converged - problem.x0).max(axis=0)
    assert (moved[:3] > 4e-3).all() and (moved[3:6] > 0.1).all()  # friction saturates: the push is felt
    assert (np.abs(real_time - converged).max(axis=0) < 0.03 * moved).all()


def test_shift_moves_trajectory_and_multipliers_ahead(centroidal: Make) -> None:
    problem = centroidal(nodes=6)
    problem.set_initial_state(problem.x0 + PUSHES["sideways"])
    solver = RealTimeSqp(problem)
    solver.set_guess(standing(problem))
    before = converged(solver)
    solver.shift(1.0)
    np.testing.assert_allclose(solver.xs[:-1], before.trajectory.xs[1:], atol=1e-14)
    np.testing.assert_allclose(solver.us[:-1], before.trajectory.us[1:], atol=1e-14)
    np.testing.assert_array_equal(solver.us[-1], before.trajectory.us[-1])
    point = solver.qp_solver.solution
    np.testing.assert_allclose(point.multipliers[:-1], before.multipliers[1:], atol=1e-14)
    np.testing.assert_allclose(point.costates[:-1], before.costates[1:], atol=1e-10)


def test_failed_subproblem_leaves_the_trajectory(centroidal: Make) -> None:
    problem = centroidal(nodes=6)
    solver = RealTimeSqp(problem)
    solver.set_guess(standing(problem))
    converged(solver)
    xs = solver.xs.copy()
    solver.prepare()
    bad = problem.x0.copy()
    bad[1] = np.nan
    result = solver.feedback(bad)
    assert result.status is Status.NOT_FINITE and not result.status.usable
    assert np.isnan(result.kkt.largest)
    np.testing.assert_array_equal(solver.xs, xs)
    problem.x0[0] = np.inf
    assert converged(solver, 1).status is Status.NOT_FINITE


def test_wrong_shapes_are_named(centroidal: Make) -> None:
    solver = RealTimeSqp(centroidal(nodes=6))
    with pytest.raises(InputError, match="xs: got shape"):
        solver.set_guess(Trajectory(np.zeros((6, 9)), np.zeros((6, 12))))
    with pytest.raises(InputError, match="us: got shape"):
        solver.set_guess(Trajectory(np.zeros((7, 9)), np.zeros((6, 3))))


def test_states_on_a_manifold_need_nothing_special(satellite: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    problem = satellite(bounded=True)
    guess = problem.hold()
    reference = NlpSolver(problem, NlpSettings(tolerance=1e-10)).solve(guess)
    assert reference.status is Status.CONVERGED
    solver = RealTimeSqp(problem)
    assert not solver.compiled
    solver.set_guess(guess)
    result = converged(solver, 60)
    assert result.residual().largest < 1e-6
    assert (np.abs(result.multipliers) > 1e-3).any()
    np.testing.assert_allclose(result.trajectory.xs, reference.trajectory.xs, atol=1e-5)
    np.testing.assert_allclose(result.trajectory.us, reference.trajectory.us, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(result.trajectory.xs[:, 3:7], axis=1), 1.0, atol=1e-12)
    solver.shift(0.5)  # along geodesics
    np.testing.assert_allclose(np.linalg.norm(solver.xs[:, 3:7], axis=1), 1.0, atol=1e-12)


def test_another_horizon_compiles_nothing(empty_cache: Path) -> None:
    def libraries(nodes: int) -> set[str]:
        assert RealTimeSqp(ShootingProblem(Unicycle(), nodes)).compiled
        return {path.name for path in empty_cache.glob("*.so")}

    assert libraries(3) == libraries(5)
