from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import Action, FreeForwardDynamics, MultibodyAction
from lgmpc.compile import find_compiler, reporting
from lgmpc.costs import Bounded, CostItem
from lgmpc.costs.library import Control, StateError
from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.reach import ReachSettings, build_reach
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.solvers import BoxFddp, Fddp, FddpSettings, LineSearchSqp, NlpSolver, Progress, Solution, Status

Make = Callable[..., ShootingProblem]


def dense_lq(problem: ShootingProblem) -> tuple[np.ndarray, np.ndarray]:
    """Minimiser of a linear-quadratic problem from one dense KKT system."""
    n, nx = problem.nodes, problem.state.nx
    sizes = [action.nu for action in problem.actions]
    starts = np.concatenate([[0], np.cumsum(sizes)]) + nx * (n + 1)
    total = int(starts[-1])
    h, g, rows, right = np.zeros((total, total)), np.zeros(total), [], []
    first = np.zeros((nx, total))
    first[:, :nx] = np.eye(nx)
    rows.append(first)
    right.append(problem.x0)
    for k in range(n + 1):
        action = problem.action_at(k)
        s = action.parameters.split(problem.parameters[k])
        x = slice(nx * k, nx * (k + 1))
        weight = 10.0 if k == n else 1.0
        h[x, x] = weight * np.eye(nx)
        g[x] = -weight * s["goal"]
        if k < n:
            u = slice(int(starts[k]), int(starts[k + 1]))
            h[u, u] = s["weight"] * np.eye(sizes[k])
            row = np.zeros((nx, total))
            row[:, nx * (k + 1) : nx * (k + 2)] = np.eye(nx)
            row[:, x], row[:, u] = -action.a, -action.b
            rows.append(row)
            right.append(action.c)
    c = np.vstack(rows)
    kkt = np.block([[h, c.T], [c, np.zeros((len(c), len(c)))]])
    z = np.linalg.solve(kkt, np.concatenate([-g, np.concatenate(right)]))[:total]
    us = np.zeros((n, problem.nu))
    for k in range(n):
        us[k, : sizes[k]] = z[starts[k] : starts[k + 1]]
    return z[: nx * (n + 1)].reshape(n + 1, nx), us


@pytest.fixture
def linear(linear: Callable[..., Action], interpreted: None) -> Callable[..., Action]:
    """Makes a linear action; many small ones, which are not worth compiling."""
    return linear


def linear_problem(linear: Callable[..., Action], mixed: bool) -> ShootingProblem:
    rng = np.random.default_rng(3)

    def make(nu: int, name: str) -> Action:
        return linear(np.eye(4) + 0.1 * rng.standard_normal((4, 4)), rng.standard_normal((4, nu)),
                      0.1 * rng.standard_normal(4), name)  # fmt: skip

    one = make(2, "one")
    actions = [one] * 9
    if mixed:
        other, impulse = make(3, "other"), make(0, "impulse")
        actions = [one] * 3 + [impulse] + [other] * 2 + [one] * 2 + [other]
    problem = ShootingProblem(actions)
    problem.set("goal", rng.standard_normal((10, 4)))
    problem.set("weight", 0.3)
    problem.set_initial_state(rng.standard_normal(4))
    return problem


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("rolled_out", [False, True])
def test_linear_quadratic_problems_are_solved_in_one_step(
    linear: Callable[..., Action], mixed: bool, rolled_out: bool
) -> None:
    problem = linear_problem(linear, mixed)
    xs, us = dense_lq(problem)
    rng = np.random.default_rng(4)
    guess = Trajectory(rng.standard_normal(xs.shape), rng.standard_normal(us.shape))
    solver = Fddp(problem)
    first = solver.solve(problem.rollout(guess.us) if rolled_out else guess, max_iterations=1)
    np.testing.assert_allclose(first.xs, xs, atol=1e-7)
    np.testing.assert_allclose(first.us, us, atol=1e-7)
    solution = solver.solve(guess)
    assert solution.status is Status.CONVERGED and solution.iterations <= 3
    assert solution.residual().largest < 1e-8
    for k in range(9):
        assert not solution.us[k, problem.actions[k].nu :].any()


def test_feedback_is_that_of_the_closed_form(linear: Callable[..., Action]) -> None:
    problem = linear_problem(linear, mixed=False)
    solution = Fddp(problem).solve()
    moved = problem.copy()
    dx = np.array([0.3, -0.2, 0.5, 0.1])
    moved.set_initial_state(problem.x0 + dx)
    _, us = dense_lq(moved)
    np.testing.assert_allclose(solution.control(0, moved.x0), us[0], atol=1e-7)


@pytest.mark.parametrize("rising", [False, True])
def test_full_steps_are_accepted_by_the_exact_change_of_a_linear_quadratic_cost(
    linear: Callable[..., Action], rising: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the model is exact, a share of the expected change that is a thousandth off decides."""
    problem = linear_problem(linear, mixed=False)
    guess = Trajectory(problem.view("goal").copy(), np.zeros((9, 2)))  # costs nothing, and has gaps
    if not rising:
        guess.xs[...] *= 10.0
    before = Fddp(problem).solve(guess, max_iterations=0).cost
    for share, accepted in ((0.999, not rising), (1.001, rising)):
        for name, value in (("_STEP_LENGTHS", (1.0,)), ("_DESCENT", share), ("_ASCENT", share)):
            monkeypatch.setattr(f"lgmpc.solvers.fddp.{name}", value)
        reports: list[Progress] = []
        after = Fddp(problem).solve(guess, max_iterations=1, callback=reports.append).cost
        assert reports[0].accepted is accepted
        assert np.sign(after - before) == (0 if not accepted else 1 if rising else -1)


def test_shortened_steps_close_their_share_of_the_gaps(
    linear: Callable[..., Action], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lgmpc.solvers.fddp._STEP_LENGTHS", (0.5,))
    problem = linear_problem(linear, mixed=False)
    rng = np.random.default_rng(4)
    guess = Trajectory(rng.standard_normal((10, 4)), rng.standard_normal((9, 2)))
    solver = Fddp(problem)
    gaps = solver.solve(guess, max_iterations=0).gaps
    np.testing.assert_allclose(solver.solve(guess, max_iterations=3).gaps, gaps / 8, atol=1e-12)
    # A trajectory without gaps keeps none, whatever the steps' length, and so can converge.
    assert solver.solve(guess).status is Status.ITERATION_LIMIT
    assert solver.solve(problem.rollout(guess.us)).status is Status.CONVERGED


def check_against_ipopt(solution: Solution, problem: ShootingProblem, guess: Trajectory, atol: float) -> None:
    reference = NlpSolver(problem).solve(guess)
    assert solution.cost == pytest.approx(reference.cost, rel=1e-8)
    np.testing.assert_allclose(solution.us, reference.trajectory.us, atol=atol)
    for x, other in zip(solution.xs, reference.trajectory.xs, strict=True):
        np.testing.assert_allclose(problem.state.diff(x, other), 0.0, atol=atol)


@pytest.mark.parametrize("which", ["unicycle", "satellite"])
@pytest.mark.parametrize("feasible", [True, False])
def test_fddp_finds_the_solution_of_ipopt(
    unicycle: ShootingProblem, satellite: Make, which: str, feasible: bool
) -> None:
    problem = unicycle if which == "unicycle" else satellite(bounded=False)
    rng = np.random.default_rng(0)
    guess = problem.hold()
    if not feasible:
        xs = [problem.state.integrate(x, 0.3 * rng.standard_normal(problem.state.ndx)) for x in guess.xs]
        guess = Trajectory(np.array(xs), rng.standard_normal(guess.us.shape))
    solution = Fddp(problem, FddpSettings(tolerance=1e-13)).solve(guess)
    assert solution.status is Status.CONVERGED
    check_against_ipopt(solution, problem, guess, atol=2e-6)
    residual = solution.residual()
    assert residual.dynamics < 1e-12
    assert residual.stationarity == pytest.approx(solution.kkt.stationarity, rel=1e-3, abs=1e-12)
    assert residual.stationarity < 1e-5
    np.testing.assert_allclose(solution.defects(), solution.gaps, atol=1e-12)


@pytest.mark.parametrize("limit", [4.0, 1.0])
def test_box_fddp_finds_the_solution_of_ipopt(satellite: Make, limit: float) -> None:
    problem = satellite(bounded=True)
    problem.set("limit", limit)
    problem.set("limit", 0.7 * limit, nodes=[3])  # bounds are parameters: they may differ from node to node
    solution = BoxFddp(problem, FddpSettings(tolerance=1e-12)).solve(max_iterations=200)
    assert solution.status is Status.CONVERGED
    check_against_ipopt(solution, problem, problem.hold(), atol=1e-5)
    assert (solution.multipliers != 0.0).any()
    assert solution.constraint_violation().max() == 0.0
    assert solution.complementarity().max() < 1e-12
    assert solution.residual().stationarity < 1e-4


class Boxed(Action):
    """An action whose controls stay within a limit."""

    def __init__(self, base: Action, limit: float) -> None:
        self.name, self.state, self.nu, self.parameters = "boxed", base.state, base.nu, base.parameters
        self.step, self.cost, self.terminal_cost, self.limit = base.step, base.cost, base.terminal_cost, limit

    def step(self, x, u, p):
        raise AssertionError

    cost = terminal_cost = step

    def constraint(self, x, u, p):
        return Bounded(u, ca.repmat(-self.limit, self.nu, 1), ca.repmat(self.limit, self.nu, 1))


def bounded_linear_problem(linear: Callable[..., Action], growth: float, limit: float) -> ShootingProblem:
    rng = np.random.default_rng(5)
    base = linear(growth * np.eye(4) + 0.1 * rng.standard_normal((4, 4)), rng.standard_normal((4, 2)), np.zeros(4))
    problem = ShootingProblem(Boxed(base, limit), 12)
    problem.set("weight", 0.1)
    problem.set_initial_state(0.3 * rng.standard_normal(4))
    return problem


@pytest.mark.parametrize(("growth", "limit"), [(1.0, 0.05), (1.2, 0.6)])
@pytest.mark.parametrize("rolled_out", [False, True])
def test_bounded_linear_quadratic_problems_are_solved_in_one_step(
    linear: Callable[..., Action], growth: float, limit: float, rolled_out: bool
) -> None:
    """Also unstable ones, where feedback moves controls to bounds far from the feedforward steps."""
    problem = bounded_linear_problem(linear, growth, limit)
    guess = problem.hold()
    solution = BoxFddp(problem).solve(problem.rollout(guess.us) if rolled_out else guess, max_iterations=1)
    held = np.abs(solution.us) == limit
    assert 3 <= held.sum() <= 21
    residual = solution.residual()
    assert residual.largest < 1e-7 and residual.constraint == residual.complementarity == 0.0
    assert (solution.multipliers[held] != 0.0).all()


def test_regularisation_makes_the_active_set_converge(linear: Callable[..., Action]) -> None:
    reports: list[Progress] = []
    solution = BoxFddp(bounded_linear_problem(linear, 1.2, 0.25)).solve(callback=reports.append)
    assert reports[0].regularization > 0.1
    assert solution.status is Status.CONVERGED and solution.iterations < 10
    assert solution.residual().largest < 1e-4


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("effort", [2.0, 1.2, 0.8])
@pytest.mark.parametrize("rolled_out", [False, True])
def test_stiff_bounded_problems_take_as_few_iterations_as_the_sqp(effort: float, rolled_out: bool) -> None:
    """Boxes on each node's step alone stall here, or take hundreds of iterations."""
    robot = load_robot(
        RobotSpec(
            model="double_pendulum", effort_limit_nm=effort, velocity_limit_rad_s=20.0, position_limit_rad=(-3.0, 3.0)
        )
    )
    settings = ReachSettings(frame="link2", position_m=(0.0290872, 0.06, 0.115), nodes=20, node_s=0.02)
    problem = build_reach(robot, settings).problem
    guess = problem.hold()
    solution = BoxFddp(problem).solve(problem.rollout(guess.us) if rolled_out else guess)
    reference = LineSearchSqp(problem).solve(guess)
    assert solution.status is Status.CONVERGED, solution.explain()
    assert solution.iterations <= 5
    assert solution.cost == pytest.approx(reference.cost, rel=1e-8)
    np.testing.assert_allclose(solution.us, reference.us, atol=1e-5)


@pytest.mark.parametrize("which", ["unicycle", "satellite", "unstable"])
def test_solutions_are_stationary_and_not_only_of_small_gain(
    unicycle: ShootingProblem, satellite: Make, linear: Callable[..., Action], which: str
) -> None:
    if which == "unstable":  # a gradient at the first node grows a million times along the open loop
        problem = ShootingProblem(linear(1.5 * np.eye(2), np.eye(2), np.zeros(2)), 40)
        problem.set("weight", 1e-3)
        problem.set_initial_state([1.0, -1.0])
    else:
        problem = unicycle if which == "unicycle" else satellite(bounded=True)
    solution = BoxFddp(problem).solve()
    scale = 1.0 + max(np.abs(solution.costates).max(), np.abs(solution.multipliers).max(initial=0.0))
    assert solution.status is Status.CONVERGED and solution.criterion < 1e-9
    assert solution.residual().stationarity <= 1e-6 * scale
    assert solution.kkt.stationarity == pytest.approx(solution.residual().stationarity, rel=1e-3, abs=1e-9)


def test_a_gradient_above_the_tolerance_at_rounding_is_no_solution(unicycle: ShootingProblem) -> None:
    solution = Fddp(unicycle, FddpSettings(stationarity=1e-30)).solve()
    assert solution.status is Status.PRECISION_LIMIT and not solution.status.solved
    assert solution.residual().stationarity < 1e-10
    assert "loosen the tolerance" in solution.explain()


def test_unsupported_constraints_are_refused(cart: ShootingProblem, satellite: Make) -> None:
    with pytest.raises(InputError, match="path constraints"):
        Fddp(satellite(bounded=True))
    with pytest.raises(InputError, match="row 1 is no control"):
        BoxFddp(cart)


def test_solves_are_repeatable_to_the_bit(unicycle: ShootingProblem) -> None:
    solver = Fddp(unicycle)
    first, second = solver.solve(), solver.solve()
    third = Fddp(unicycle).solve()
    for other in (second, third):
        for name in ("xs", "us", "feedback", "feedforward", "costates", "gaps"):
            np.testing.assert_array_equal(getattr(first, name), getattr(other, name))
        assert (first.cost, first.iterations, first.kkt) == (other.cost, other.iterations, other.kkt)


def test_interpreted_functions_give_the_same(unicycle: ShootingProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = Fddp(unicycle).solve()
    monkeypatch.setenv("LGMPC_JIT", "0")
    solver = Fddp(unicycle)
    assert not solver.functions.compiled
    interpreted = solver.solve()
    np.testing.assert_allclose(interpreted.xs, compiled.xs, atol=1e-9)
    assert interpreted.iterations == compiled.iterations


@pytest.mark.slow
def test_a_new_cost_compiles_nothing_of_the_dynamics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_compiler() is None:
        pytest.skip("no C compiler is installed")
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "cache"))
    dynamics = FreeForwardDynamics(pin.buildSampleModelManipulator())
    effort, posture = CostItem("effort", Control(dynamics.nu)), CostItem("posture", StateError(dynamics.state))
    started: list[list[str]] = []
    for name, costs in (("first", [effort]), ("second", [effort, posture])):
        messages: list[str] = []
        action = MultibodyAction(name, dynamics, costs)
        with reporting(messages.append):
            Fddp(ShootingProblem(action, 3))
        started.append([message.split("'")[1] for message in messages if "once, later runs load it" in message])
    assert len(started[0]) > 6
    assert sorted(started[1]) == ["second_cost", "second_costs", "second_last_expansion", "second_terminal_value"]


def test_progress_is_reported_and_can_stop(unicycle: ShootingProblem) -> None:
    solver = Fddp(unicycle)
    reports: list[Progress] = []
    solution = solver.solve(callback=reports.append)
    assert [p.iteration for p in reports] == list(range(1, solution.iterations + 1))
    assert reports[-1].criterion < 1e-9 and reports[0].criterion > reports[-1].criterion
    assert reports[-1].cost == pytest.approx(solution.cost, rel=1e-14)
    stopped = solver.solve(callback=lambda progress: progress.iteration == 2)
    assert stopped.status is Status.STOPPED and stopped.iterations == 2


def test_limits_are_honoured(unicycle: ShootingProblem) -> None:
    solver = Fddp(unicycle)
    limited = solver.solve(max_iterations=3)
    assert limited.status is Status.ITERATION_LIMIT and limited.iterations == 3
    assert solver.solve(time_limit=0.0).status is Status.TIME_LIMIT
    unsolved = solver.solve(max_iterations=0)
    np.testing.assert_array_equal(unsolved.xs, unicycle.hold().xs)
    with pytest.raises(InputError, match="max_iterations"):
        solver.solve(max_iterations=-1)
    with pytest.raises(InputError, match="time_limit"):
        solver.solve(time_limit=float("nan"))
    with pytest.raises(SolverError, match="iteration_limit") as raised:
        solver.solve(max_iterations=1, throw=True)
    assert "stationarity: largest gradient" in raised.value.remedy
    assert solver.solve(throw=True).status.solved


def test_wrong_shapes_are_named(unicycle: ShootingProblem) -> None:
    solver = Fddp(unicycle)
    with pytest.raises(InputError, match=r"xs: got shape \(20, 3\); expected shape \(21, 3\)"):
        solver.solve(Trajectory(np.zeros((20, 3)), np.zeros((20, 2))))
    with pytest.raises(InputError, match="us: got shape"):
        solver.solve(Trajectory(np.zeros((21, 3)), np.zeros((20, 3))))


@pytest.mark.parametrize("where", ["xs", "us", "x0", "parameters"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_non_finite_values_are_found(unicycle: ShootingProblem, where: str, value: float) -> None:
    guess = unicycle.hold()
    if where == "x0":
        unicycle.x0[1] = value
    elif where == "parameters":
        unicycle.parameters[7] = value
    else:
        getattr(guess, where)[7, 1] = value
    solution = Fddp(unicycle).solve(guess)
    assert solution.status is Status.NOT_FINITE and solution.iterations == 0
    assert not solution.status.solved
    text = solution.explain()
    assert ("first state" in text) if where == "x0" else ("node 7" in text)


class Derived(Action):
    """An action with the costs of another and dynamics of its own."""

    def __init__(self, base: Action, name: str, step: Callable[..., object]) -> None:
        self.name, self.state, self.nu, self.parameters = name, base.state, base.nu, base.parameters
        self.cost, self.terminal_cost, self.constraint, self._step = (
            base.cost,
            base.terminal_cost,
            base.constraint,
            step,
        )

    def step(self, x, u, p):
        return self._step(x, u)

    def cost(self, x, u, p):
        raise AssertionError

    terminal_cost = constraint = cost


def test_roll_outs_that_diverge_are_shortened(linear: Callable[..., Action]) -> None:
    """The dynamics have the square root of a state that a long step makes negative."""
    base = linear(np.eye(2), np.eye(2), np.zeros(2))
    problem = ShootingProblem(Derived(base, "cliff", lambda x, u: x + 0.1 * ca.sqrt(x) - 0.1 * u), 6)
    problem.set("weight", 1e-4)
    problem.set("goal", 0.01)
    problem.set_initial_state([1.0, 2.0])
    lengths: list[float] = []
    solution = Fddp(problem).solve(problem.rollout(np.zeros((6, 2))), callback=lambda p: lengths.append(p.step_length))
    assert solution.status in (Status.CONVERGED, Status.STALLED, Status.ITERATION_LIMIT)
    assert np.isfinite(solution.xs).all() and np.isfinite(solution.cost)
    assert min(lengths) < 1.0


@pytest.mark.parametrize("seed", [1, 4, 7])
def test_an_ascent_is_bounded_by_the_model_and_not_by_the_trial(linear: Callable[..., Action], seed: int) -> None:
    """Closing the gaps makes this unstable trajectory blow up; an increase as expected along it would be accepted."""
    base = linear(np.eye(1), np.eye(1), np.zeros(1))
    problem = ShootingProblem(Derived(base, "cubic", lambda x, u: x + 0.1 * x**3 + 0.1 * u), 12)
    problem.set("weight", 300.0)
    problem.set_initial_state([1.0])
    rng = np.random.default_rng(seed)
    guess = Trajectory(rng.uniform(-3, 3, (13, 1)), rng.uniform(-1, 1, (12, 1)))
    problem.set("goal", guess.xs)
    costs: list[float] = []
    solution = Fddp(problem).solve(guess, callback=lambda progress: costs.append(progress.cost))
    assert solution.status is Status.CONVERGED
    assert max(costs) < 1.1 * solution.cost


def test_a_step_whose_derivatives_are_not_finite_is_taken_back(linear: Callable[..., Action]) -> None:
    """The square root has a value at zero, where steps lead, and no derivative."""
    base = linear(np.eye(1), np.eye(1), np.zeros(1))
    problem = ShootingProblem(Derived(base, "root", lambda x, u: ca.sqrt(ca.fmax(x + u, 0.0))), 3)
    problem.set("weight", 1e-6)
    problem.set("goal", -1.0)
    problem.set_initial_state([1.0])
    solution = Fddp(problem).solve(problem.rollout(np.zeros((3, 1))))
    assert solution.status in (Status.DIVERGED, Status.STALLED, Status.ITERATION_LIMIT)
    assert np.isfinite(solution.residual().largest) and np.isfinite(solution.cost)
    assert solution.cost <= Fddp(problem).solve(problem.rollout(np.zeros((3, 1))), max_iterations=0).cost


def test_trials_that_all_diverge_are_called_so(linear: Callable[..., Action]) -> None:
    base = linear(np.eye(1), np.eye(1), np.zeros(1))
    problem = ShootingProblem(Derived(base, "edge", lambda x, u: x + u + ca.sqrt(1 - (1e20 * u) ** 2) - 1), 3)
    problem.set_initial_state([1.0])
    solution = Fddp(problem).solve()  # no control but zero has a next state
    assert solution.status is Status.DIVERGED and not solution.status.solved
    assert not solution.us.any() and "diverge" in solution.explain()


def test_regularisation_does_not_make_a_point_converged(
    unicycle: ShootingProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However large the regularisation makes the expected reduction small, the last sweep is without it."""
    monkeypatch.setattr("lgmpc.solvers.fddp._LONG", 1.0)  # it never decreases
    solver = Fddp(unicycle, FddpSettings(tolerance=1e-2, stationarity=np.inf))
    begin = solver._begin

    def begin_regularised(guess: Trajectory) -> Status | None:
        status, solver._regularization.value = begin(guess), 1e8
        return status

    monkeypatch.setattr(solver, "_begin", begin_regularised)
    solution = solver.solve(unicycle.rollout(np.zeros((20, 2))))
    assert solution.status is Status.CONVERGED
    assert solution.cost == pytest.approx(Fddp(unicycle).solve().cost, abs=1e-2)


def test_explain_names_the_worst_node(unicycle: ShootingProblem) -> None:
    guess = unicycle.hold()
    guess.xs[12, 2] += 5.0
    solution = Fddp(unicycle).solve(guess, max_iterations=0)
    k, i = np.unravel_index(int(np.abs(solution.defects()).argmax()), (21, 3))
    assert f"where interval {k - 1} ('unicycle') meets node {k}, tangent entry {i}" in solution.explain()
    k, i = np.unravel_index(int(np.abs(solution.stationarity()).argmax()), (21, 5))
    assert f"at node {k} ('unicycle')" in solution.explain()


def test_explain_distinguishes_a_trajectory_without_gaps_from_one_that_begins_elsewhere(
    unicycle: ShootingProblem,
) -> None:
    solution = Fddp(unicycle).solve(unicycle.rollout(np.ones((20, 2))), max_iterations=0)
    assert "dynamics: no gap anywhere." in solution.explain()
    aside = replace(solution, xs=solution.xs + [0.0, 3.0, 0.0])  # the dynamics are the same everywhere
    assert "largest gap 3.00e+00, the first state's own, tangent entry 1." in aside.explain()


def test_solutions_are_frozen_and_their_own(unicycle: ShootingProblem) -> None:
    solver = Fddp(unicycle)
    solution = solver.solve()
    xs = solution.xs.copy()
    unicycle.set("weights", 1.0)
    unicycle.set_initial_state([0.0, 1.0, 0.0])
    solver.solve()
    np.testing.assert_array_equal(solution.xs, xs)
    assert solution.residual().largest < 1e-4  # measured against the data that it was solved for
    with pytest.raises(ValueError, match="read-only"):
        solution.us[0] = 0.0


@pytest.mark.parametrize(("name", "value"), [("tolerance", 0.0), ("stationarity", float("nan"))])
def test_invalid_settings_are_refused(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        FddpSettings(**{name: value})
