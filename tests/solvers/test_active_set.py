"""lgmpc's own solver, on random problems, against PIQP, OSQP and a dense solution of its equations."""

from __future__ import annotations

import numpy as np
import pytest
from bench_optimiser import constrained
from paired_problems import Stance

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp, OcpQpStructure, StoredBlock, Trajectory
from lgmpc.solvers import LineSearchSqp, Status
from lgmpc.solvers.qp import (
    LARGE_STAGE,
    ActiveSetSolver,
    DenseRiccati,
    OsqpSolver,
    PiqpSolver,
    QpSolution,
    QpSolver,
    SparseRiccati,
)
from lgmpc.solvers.qp.active_set import riccati_for
from lgmpc.solvers.sweep import penalised_feedback

NX, NU, NG, NODES = 9, 4, 6, 7
Kind = type[DenseRiccati] | type[SparseRiccati]


def structure(nx: int = NX, nu: int = NU, ng: int = NG, nodes: int = NODES) -> OcpQpStructure:
    """All blocks dense, but D, of which every other entry is left out."""
    shapes = {
        "A": (nx, nx), "B": (nx, nu), "b": (nx, 1), "Q": (nx, nx), "S": (nu, nx), "R": (nu, nu), "q": (nx, 1),
        "r": (nu, 1), "C": (ng, nx), "D": (ng, nu), "lower": (ng, 1), "upper": (ng, 1), "cost": (1, 1),
    }  # fmt: skip
    blocks, start = {}, 0
    for name, shape in shapes.items():
        rows, columns = (index.ravel(order="F") for index in np.indices(shape))
        kept = (rows + columns) % 2 == 0 if name == "D" else np.ones(rows.size, dtype=bool)
        rows, columns = rows[kept], columns[kept]
        blocks[name] = StoredBlock(shape, rows, columns, slice(start, start + rows.size))
        start += rows.size
    last, end = {}, 0
    for name in ("Q", "q", "cost"):
        rows, columns = (index.ravel(order="F") for index in np.indices(shapes[name]))
        last[name] = StoredBlock(shapes[name], rows, columns, slice(end, end + rows.size))
        end += rows.size
    return OcpQpStructure(nodes, nx, nu, ng, blocks, last, start, end)


def put(qp: OcpQp, name: str, node: int, value: np.ndarray) -> None:
    block = qp.structure.blocks[name]
    qp.values[node, block.where] = np.reshape(value, block.shape)[block.rows, block.columns]


def random_problem(rng: np.random.Generator, tightness: float, equalities: int = 0) -> OcpQp:
    """A feasible problem: a random trajectory satisfies the bounds, most of them closely if ``tightness`` is large."""
    s = structure()
    qp = OcpQp(s)
    x = rng.standard_normal(NX)
    for k in range(NODES):
        root = rng.standard_normal((NX + NU, NX + NU))
        hessian = root @ root.T / (NX + NU) + 0.1 * np.eye(NX + NU)
        a, b = 0.4 * rng.standard_normal((NX, NX)), rng.standard_normal((NX, NU))
        c, d = rng.standard_normal((NG, NX)), rng.standard_normal((NG, NU))
        d[np.add.outer(np.arange(NG), np.arange(NU)) % 2 == 1] = 0.0
        u, gap = rng.standard_normal(NU), rng.standard_normal(NX)
        row = c @ x + d @ u
        lower = row - rng.exponential(1.0 / tightness, NG)
        upper = row + rng.exponential(1.0 / tightness, NG)
        lower[rng.random(NG) < 0.3], upper[rng.random(NG) < 0.3] = -np.inf, np.inf
        lower[:equalities] = upper[:equalities] = row[:equalities]
        for name, value in {
            "A": a, "B": b, "b": gap, "Q": hessian[:NX, :NX], "S": hessian[NX:, :NX], "R": hessian[NX:, NX:],
            "q": rng.standard_normal(NX), "r": rng.standard_normal(NU), "C": c, "D": d, "lower": lower, "upper": upper,
        }.items():  # fmt: skip
            put(qp, name, k, value)
        if k == 0:
            qp_x0 = x.copy()
        x = a @ x + b @ u + gap
    last = rng.standard_normal((NX, NX))
    blocks = s.terminal_blocks
    qp.terminal_values[blocks["Q"].where] = (last @ last.T / NX).ravel(order="F")
    qp.terminal_values[blocks["q"].where] = rng.standard_normal(NX)
    qp.x0 = qp_x0  # type: ignore[attr-defined]
    return qp


@pytest.fixture(params=[DenseRiccati, SparseRiccati], ids=["dense", "sparse"])
def kind(request: pytest.FixtureRequest) -> Kind:
    return request.param


def solved(solver: QpSolver, dx0: np.ndarray) -> QpSolution:
    solver.prepare()
    assert solver.solve(dx0) is Status.CONVERGED
    return solver.solution


@pytest.mark.parametrize(("tightness", "equalities"), [(0.3, 0), (0.3, 2), (3.0, 0), (3.0, 2), (10.0, 0)])
def test_random_problems_have_the_solution_of_piqp_and_osqp(kind: Kind, tightness: float, equalities: int) -> None:
    tolerance = 1e-9 if kind is DenseRiccati else 1e-7  # which corrects rounding
    for seed in range(6):
        qp = random_problem(np.random.default_rng(seed), tightness, equalities)
        solver = ActiveSetSolver(qp, tolerance, riccati=kind(qp))
        mine = solved(solver, qp.x0)
        assert not solver.took_over or (kind is SparseRiccati and equalities)  # a smaller penalty: too many rounds
        assert mine.residual().largest < 2 * tolerance
        if tightness > 1.0:
            assert (np.abs(mine.multipliers) > 1e-6).sum() >= 5
        other = solved(PiqpSolver(qp, 1e-11), qp.x0)
        close = max(1e-6, 1e2 * tolerance)  # a gradient over the least curvature, 0.1, along the dynamics
        np.testing.assert_allclose(mine.dus, other.dus, atol=close)
        np.testing.assert_allclose(mine.dxs, other.dxs, atol=close)
        if not equalities and tightness < 3.0:  # else OSQP does not get that far
            split = solved(OsqpSolver(qp, 1e-7, 20000), qp.x0)
            np.testing.assert_allclose(mine.dus, split.dus, atol=1e-4)
        again = solved(solver, qp.x0)
        assert solver.iterations == 1  # the multipliers identify the active rows
        np.testing.assert_allclose(again.dus, other.dus, atol=close)


def test_nearby_problems_take_few_sweeps(kind: Kind) -> None:
    rng = np.random.default_rng(0)
    qp = random_problem(rng, 3.0)
    solver = ActiveSetSolver(qp, riccati=kind(qp))
    solved(solver, qp.x0)
    cold = solver.iterations
    most = 3 if kind is DenseRiccati else 6  # a smaller penalty: more rounds of multipliers
    for _ in range(5):
        solved(solver, qp.x0 + 1e-3 * rng.standard_normal(NX))
        assert solver.iterations <= most < cold and not solver.took_over


@pytest.mark.parametrize("fault", ["bounds", "rows", "nan", "no control weight"])
def test_unsolvable_problems_have_a_status_and_no_later_effect(kind: Kind, fault: str) -> None:
    qp = random_problem(np.random.default_rng(1), 3.0)
    solver = ActiveSetSolver(qp, riccati=kind(qp))
    expected = solved(solver, qp.x0).dus.copy()
    values = qp.values.copy()
    if fault == "bounds":
        qp.vector("lower")[2, 1], qp.vector("upper")[2, 1] = 1.0, -1.0
    elif fault == "rows":  # the same row twice, between bounds that contradict each other
        for name in ("C", "D"):
            full = qp.dense(name)[2]
            full[3] = full[1]
            put(qp, name, 2, full)
        qp.vector("lower")[2, [1, 3]], qp.vector("upper")[2, [1, 3]] = [1.0, -9.0], [2.0, -8.0]
    elif fault == "nan":
        qp.vector("b")[3, 0] = np.nan
    else:
        for k in range(NODES):
            put(qp, "R", k, np.zeros((NU, NU)))
            put(qp, "S", k, np.zeros((NU, NX)))
    solver.prepare()
    status = solver.solve(qp.x0)
    outcome = {"nan": Status.NOT_FINITE, "no control weight": Status.CONVERGED}.get(fault, Status.INFEASIBLE)
    assert status is outcome and solver.took_over is (fault != "bounds")
    if status is not Status.CONVERGED:
        np.testing.assert_array_equal(solver.solution.dus, expected)
    qp.values[...] = values
    np.testing.assert_allclose(solved(solver, qp.x0).dus, expected, atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_only_infeasible_problems_are_called_so(kind: Kind, seed: int) -> None:
    """PIQP with many iterations judges problems whose bounds are moved until some contradict each other."""
    rng = np.random.default_rng(seed)
    qp = random_problem(rng, 3.0)
    shift = 3.0 * rng.standard_normal(qp.vector("lower").shape)
    for share in (0.0, 0.05, 0.1, 0.3, 1.0):
        qp.vector("lower")[...] += share * shift
        qp.vector("upper")[...] += share * shift
        solver, judge = ActiveSetSolver(qp, riccati=kind(qp)), PiqpSolver(qp, max_iterations=300)
        found = []
        for each in (solver, judge):
            each.prepare()
            found.append(each.solve(qp.x0))
        assert found[0] is found[1], share


def test_the_active_rows_of_another_solver_are_solved_exactly() -> None:
    """An interior point method leaves multipliers and distances whose products are small, not they themselves."""
    qp = random_problem(np.random.default_rng(0), 10.0)
    # No interior point method of its own, and a first fallback that does not get anywhere.
    fallbacks = PiqpSolver(qp, max_iterations=2), PiqpSolver(qp, 1e-6)
    solver = ActiveSetSolver(qp, 1e-9, max_iterations=0, fallbacks=fallbacks)
    solution = solved(solver, qp.x0)
    assert solver.took_over
    assert solver.iterations > 2 + fallbacks[1].iterations
    assert solved(PiqpSolver(qp, 1e-6), qp.x0).residual().largest > 1e-9
    assert solution.residual().largest < 2e-9


def test_riccati_solver_solves_the_equations_of_its_minimum(kind: Kind) -> None:
    """Against one dense system of the penalised problem; the second solve with the factors of the first."""
    rng = np.random.default_rng(2)
    qp = random_problem(rng, 1.0)
    riccati = kind(qp)
    riccati.load()
    riccati.weights[...] = rng.uniform(0.0, 5.0, (NODES, NG)) * (rng.random((NODES, NG)) < 0.6)
    riccati.dx0[...] = qp.x0
    for again in (False, True):
        riccati.targets[...] = rng.standard_normal((NODES, NG))
        assert riccati.factor() if not again else riccati.solve() is None
        penalty = riccati.weights * (riccati.rows - riccati.targets)
        point = QpSolution(qp, riccati.dxs, riccati.dus, riccati.costates, penalty)
        found = point.residual()
        assert found.stationarity < 1e-9 and found.dynamics < 1e-12
        rows = qp.dense("C") @ riccati.dxs[:-1, :, None] + qp.dense("D") @ riccati.dus[:, :, None]
        np.testing.assert_allclose(riccati.rows, rows[..., 0], atol=1e-10)
    cost = 0.0
    for k in range(NODES):
        x, u = riccati.dxs[k], riccati.dus[k]
        m = {name: qp.dense(name)[k] for name in "QSRqr"}
        cost += 0.5 * (x @ m["Q"] @ x + u @ m["R"] @ u) + u @ m["S"] @ x + m["q"][:, 0] @ x + m["r"][:, 0] @ u
    x = riccati.dxs[-1]
    cost += 0.5 * x @ qp.dense_terminal("Q") @ x + qp.dense_terminal("q")[:, 0] @ x
    assert riccati.cost == pytest.approx(cost, rel=1e-10)
    put(qp, "R", 3, -100.0 * np.eye(NU))
    riccati.load()
    assert not riccati.factor()


def test_same_inputs_give_the_same_bits(kind: Kind) -> None:
    qp = random_problem(np.random.default_rng(3), 3.0)
    solver = ActiveSetSolver(qp, riccati=kind(qp))
    first = [array.copy() for array in solved(solver, qp.x0).arrays]
    solver.reset()
    for other in (solver, ActiveSetSolver(qp, riccati=kind(qp))):
        for one, two in zip(first, solved(other, qp.x0).arrays, strict=True):
            np.testing.assert_array_equal(one, two)


def test_without_compiler_it_is_piqp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    qp = random_problem(np.random.default_rng(4), 3.0)
    solver = ActiveSetSolver(qp)
    assert solved(solver, qp.x0).residual().largest < 1e-6
    assert solver.took_over


def test_the_code_depends_on_the_size() -> None:
    assert isinstance(riccati_for(OcpQp(structure())), SparseRiccati)
    assert isinstance(riccati_for(OcpQp(structure(nx=LARGE_STAGE))), DenseRiccati)


def test_gains_are_the_slope_of_the_solution_while_rows_stay_at_their_bounds(kind: Kind) -> None:
    rng = np.random.default_rng(5)
    qp = random_problem(rng, 3.0)
    solver = ActiveSetSolver(qp, 1e-9, riccati=kind(qp))
    first = solved(solver, qp.x0)
    us, multipliers = first.dus.copy(), first.multipliers.copy()
    gains, step = solver.feedback(multipliers), 1e-5 * rng.standard_normal(NX)
    moved = solved(solver, qp.x0 + step)
    assert ((np.abs(moved.multipliers) > 1e-9) == (np.abs(multipliers) > 1e-9)).all()
    # Penalties hold rows as firmly as they are large.
    np.testing.assert_allclose(moved.dus[0] - us[0], -gains[0] @ step, atol=1e-8)
    assert np.abs(penalised_feedback(qp)[0] - gains[0]).max() > 1e-2  # those without any row
    for k in range(NODES):
        put(qp, "R", k, -np.eye(NU))
    assert len(penalised_feedback(qp)) == 0


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(InputError, match="tolerance"):
        ActiveSetSolver(OcpQp(structure()), 0.0)


@pytest.mark.slow
def test_a_pushed_quadruped_with_friction_and_torque_limits_is_solved_as_with_piqp() -> None:
    stance = Stance()
    problem = constrained(stance)
    guess = Trajectory(np.tile(problem.x0, (21, 1)), stance.guess().us)
    sqp = LineSearchSqp(problem)
    assert isinstance(sqp.qp_solver, ActiveSetSolver)
    taken: list[int] = []
    solution = sqp.solve(guess, callback=lambda _: taken.append(sqp.qp_solver.iterations))
    assert solution.status is Status.CONVERGED and not sqp.qp_solver.took_over
    assert solution.residual().largest <= 1e-6
    assert (np.abs(solution.multipliers) > 1e-6).sum() > 80
    assert max(taken) <= 20 and taken[-3:] == [1, 1, 1]
    other = LineSearchSqp(problem, qp_solver=lambda qp: PiqpSolver(qp, 1e-11, 200)).solve(guess)
    assert other.iterations == solution.iterations
    assert solution.cost == pytest.approx(other.cost, rel=1e-8)
    np.testing.assert_allclose(solution.us, other.us, atol=1e-6)
