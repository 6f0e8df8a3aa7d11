from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest

from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.ocp import OcpQp, ShootingProblem, SubproblemFunctions
from lgmpc.proxqp import proxqp
from lgmpc.solvers.qp import QP_SOLVERS, ActiveSetSolver, PiqpSolver, make_qp_solver
from lgmpc.status import Status

# Largest residual of the optimality conditions that a solver's standard settings may leave on the problems below, and
# largest error of the controls in the first of them (its control weights are 1e-3: a small gradient is a large error).
ACCURACY = {"active_set": 1e-5, "piqp": 1e-5, "osqp": 1e-3}
FORCE_ACCURACY = {"active_set": 1e-5, "piqp": 1e-5, "osqp": 1.0}


def expand(problem: ShootingProblem) -> OcpQp:
    """Expand around standing still at the first state, with its gaps."""
    functions = SubproblemFunctions(problem)
    functions.linearize()
    return functions.qp


def dense_solution(qp: OcpQp, dx0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and controls by a dense solver on plainly assembled matrices, dx_0 .. dx_N among the variables."""
    s = qp.structure
    n, nx, nu, ng = s.nodes, s.ndx, s.nu, s.ng
    size = (n + 1) * nx + n * nu
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    equality, rhs = np.zeros(((n + 1) * nx, size)), np.zeros((n + 1) * nx)
    rows, lower, upper = np.zeros((n * ng, size)), np.zeros(n * ng), np.zeros(n * ng)
    m = {name: qp.dense(name) for name in ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "lower", "upper")}
    equality[:nx, :nx], rhs[:nx] = np.eye(nx), dx0
    for k in range(n):
        x, u = slice(k * nx, (k + 1) * nx), slice((n + 1) * nx + k * nu, (n + 1) * nx + (k + 1) * nu)
        after, g = slice((k + 1) * nx, (k + 2) * nx), slice(k * ng, (k + 1) * ng)
        hessian[x, x], hessian[u, u] = m["Q"][k], m["R"][k]
        hessian[u, x], hessian[x, u] = m["S"][k], m["S"][k].T
        gradient[x], gradient[u] = m["q"][k][:, 0], m["r"][k][:, 0]
        equality[after, x], equality[after, u], equality[after, after] = m["A"][k], m["B"][k], -np.eye(nx)
        rhs[after] = -m["b"][k][:, 0]
        rows[g, x], rows[g, u] = m["C"][k], m["D"][k]
        lower[g], upper[g] = m["lower"][k][:, 0], m["upper"][k][:, 0]
    last = slice(n * nx, (n + 1) * nx)
    hessian[last, last], gradient[last] = qp.dense_terminal("Q"), qp.dense_terminal("q")[:, 0]
    result = proxqp.dense.solve(
        hessian, gradient, equality, rhs, rows, np.maximum(lower, -1e20), np.minimum(upper, 1e20), eps_abs=1e-10
    )
    assert result.info.status.name == "PROXQP_SOLVED"
    return result.x[: (n + 1) * nx].reshape(n + 1, nx), result.x[(n + 1) * nx :].reshape(n, nu)


@pytest.mark.parametrize("name", QP_SOLVERS)
def test_solution_is_that_of_the_dense_problem(name: str, centroidal: Callable[..., ShootingProblem]) -> None:
    problem = centroidal(nodes=8, facets=4)
    problem.view("contact_flags")[3:6, 1] = 0.0
    problem.set_initial_state([0.0, 0.0, 0.24, 0.6, 1.2, -0.2, 0.05, 0.0, 0.02])
    qp = expand(problem)
    dx0 = np.array([0.01, -0.01, 0.0, 0.2, 0.3, 0.0, 0.01, 0.0, 0.0])
    solver = make_qp_solver(name, qp)
    for _ in range(2):  # cold, then warm
        solver.prepare()
        assert solver.solve(dx0) is Status.CONVERGED
        assert solver.iterations > 0
        assert solver.solution.residual().largest < ACCURACY[name]
        xs, us = dense_solution(qp, dx0)
        active = np.abs(solver.solution.multipliers) > 1e-3
        assert active.sum() > 10
        np.testing.assert_array_equal(solver.solution.dxs[0], dx0)
        np.testing.assert_allclose(solver.solution.dxs, xs, atol=10 * ACCURACY[name])
        np.testing.assert_allclose(solver.solution.dus, us, atol=FORCE_ACCURACY[name])


@pytest.mark.parametrize("name", QP_SOLVERS)
def test_coupled_costs_and_rows_on_states(name: str, cart: ShootingProblem) -> None:
    qp = expand(cart)
    assert qp.structure.blocks["S"].rows.size and qp.structure.blocks["C"].rows.size
    dx0 = np.array([-0.05, 0.1])
    solver = make_qp_solver(name, qp)
    solver.prepare()
    assert solver.solve(dx0) is Status.CONVERGED
    assert solver.solution.residual().largest < ACCURACY[name]
    xs, us = dense_solution(qp, dx0)
    assert (np.abs(solver.solution.multipliers) > 1e-2).sum() >= 3
    np.testing.assert_allclose(solver.solution.dxs, xs, atol=10 * ACCURACY[name])
    np.testing.assert_allclose(solver.solution.dus, us, atol=2 * ACCURACY[name])


@pytest.mark.parametrize("name", QP_SOLVERS)
def test_same_inputs_give_the_same_bits(name: str, centroidal: Callable[..., ShootingProblem]) -> None:
    problem = centroidal(nodes=6, facets=4)
    qp = expand(problem)
    rng = np.random.default_rng(0)
    starts = [0.2 * rng.standard_normal(9) for _ in range(4)]

    def run(solver) -> list[np.ndarray]:
        answers = []
        for dx0 in starts:
            solver.prepare()
            solver.solve(dx0)
            answers.append(np.concatenate([array.ravel() for array in solver.solution.arrays]))
        return answers

    solver = make_qp_solver(name, qp)
    first = run(solver)
    solver.reset()
    for again in (run(solver), run(make_qp_solver(name, qp))):
        for one, other in zip(first, again, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", QP_SOLVERS)
def test_contradicting_bounds_are_infeasible_and_leave_the_solution(name: str, cart: ShootingProblem) -> None:
    qp = expand(cart)
    solver = make_qp_solver(name, qp)
    solver.prepare()
    assert solver.solve(np.zeros(2)) is Status.CONVERGED
    before = solver.solution.dus.copy()
    cart.set("limit", [2.0, 0.6, -5.0])  # the third row bounds u by -5 from above, the first one by -2 from below
    expanded = expand(cart)
    qp.values[:] = expanded.values
    solver.prepare()
    assert solver.solve(np.zeros(2)) is Status.INFEASIBLE
    np.testing.assert_array_equal(solver.solution.dus, before)
    assert "bounds" in Status.INFEASIBLE.value


@pytest.mark.parametrize("name", QP_SOLVERS)
@pytest.mark.parametrize("block", ["A", "q", "upper", "terminal", "dx0"])
def test_nan_is_refused_and_has_no_later_effect(name: str, block: str, cart: ShootingProblem) -> None:
    qp = expand(cart)
    solver = make_qp_solver(name, qp)
    solver.prepare()
    assert solver.solve(np.zeros(2)) is Status.CONVERGED
    values, terminal, before = qp.values.copy(), qp.terminal_values.copy(), solver.solution.dus.copy()
    dx0 = np.zeros(2)
    if block == "dx0":
        dx0[1] = np.nan
    elif block == "terminal":
        qp.terminal_values[0] = np.nan
    else:
        qp.values[3, qp.structure.blocks[block].where.start] = np.nan
    solver.prepare()
    assert solver.solve(dx0) is Status.NOT_FINITE
    np.testing.assert_array_equal(solver.solution.dus, before)
    qp.values[:], qp.terminal_values[:] = values, terminal
    solver.prepare()
    assert solver.solve(np.zeros(2)) is Status.CONVERGED
    assert solver.solution.residual().largest < ACCURACY[name]


HARD = np.array([0.1, 0.1, 0.05, 4.0, 5.0, -1.0, 0.3, 0.2, 0.1])
"""First step of a robot that falls: a hundred rows are at their bounds."""


@pytest.fixture
def moving(centroidal: Callable[..., ShootingProblem]) -> OcpQp:
    problem = centroidal()
    problem.set_initial_state([0.0, 0.0, 0.24, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0])
    return expand(problem)


def test_right_active_set_takes_one_sweep(moving: OcpQp) -> None:
    solver = ActiveSetSolver(moving)
    solver.prepare()
    assert solver.solve(np.zeros(9)) is Status.CONVERGED and not solver.took_over
    solver.prepare()
    assert solver.solve(np.zeros(9)) is Status.CONVERGED and not solver.took_over
    assert solver.iterations <= 2  # the multipliers identify the active rows


@pytest.mark.parametrize("share", [0.05, 0.1, 0.15])
def test_steps_that_raise_the_augmented_lagrangian_are_shortened(moving: OcpQp, share: float) -> None:
    """The same point as an interior point method's, where full steps alone do not converge."""
    solver, other = ActiveSetSolver(moving), PiqpSolver(moving, 1e-9)
    for each in (solver, other):
        each.prepare()
        assert each.solve(share * HARD) is Status.CONVERGED
    assert not solver.took_over
    assert np.count_nonzero(solver.solution.multipliers) > 5
    assert solver.solution.residual().largest < ACCURACY["active_set"]
    np.testing.assert_allclose(solver.solution.dus, other.solution.dus, atol=1e-4)


def test_guesses_that_are_far_off_are_given_up_soon(moving: OcpQp) -> None:
    """From one hard step to another: 12.3 factorisations on average, 14.6 if sweeps may change as many rows again."""
    rng, solver, counts = np.random.default_rng(0), ActiveSetSolver(moving), []
    for _ in range(20):
        solver.prepare()
        assert solver.solve(0.1 * HARD * rng.standard_normal(9)) is Status.CONVERGED and not solver.took_over
        counts.append(solver.iterations)
    assert np.mean(counts) < 13.5


def test_another_solver_takes_over_where_the_sweeps_are_used_up(moving: OcpQp) -> None:
    for most in (0, 3):
        other = PiqpSolver(moving)
        # No interior point method of its own.
        solver = ActiveSetSolver(moving, max_sweeps=most, max_iterations=0, fallbacks=[other])
        solver.prepare()
        assert solver.solve(HARD) is Status.CONVERGED and solver.took_over
        assert solver.iterations > other.iterations + (most > 0)
        assert solver.solution.residual().largest < ACCURACY["piqp"]


def test_unknown_names_are_named(cart: ShootingProblem) -> None:
    with pytest.raises(InputError, match="Did you mean osqp"):
        make_qp_solver("oqsp", expand(cart))
    with pytest.raises(InputError, match="kkt_solver: got dense"):
        PiqpSolver(expand(cart), kkt_solver="dense")


@pytest.mark.parametrize(
    ("name", "package", "line"),
    [
        ("osqp", "osqp.ext_builtin", "pip install .osqp"),
        ("piqp", "piqp", "pip install .piqp"),
        ("active_set", "piqp", "pip install .piqp"),
    ],
)
def test_missing_backend_names_the_command_that_installs_it(
    name: str, package: str, line: str, cart: ShootingProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    qp = expand(cart)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependencyError, match=line):
        make_qp_solver(name, qp)
