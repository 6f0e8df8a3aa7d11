"""ProxQP's answers against a second solver and against the optimality conditions, recomputed here."""

import numpy as np
import pinocchio as pin
import piqp
import pytest
from scipy.optimize import lsq_linear

from lgmpc.wbc import TickStatus, WholeBodyController, WholeBodySettings


def cost(qp, z):
    return 0.5 * z @ qp.hessian @ z + qp.gradient @ z


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
def trials(solo12, random_state, randomise):
    """Ten QPs, each written into the controller's solver just before it is returned."""

    def write_each(wbc):
        rng = np.random.default_rng(30)
        for trial in range(10):
            wbc.sense(*random_state(rng, solo12))
            randomise(wbc, rng)
            wbc.contacts.stance[:] = True
            wbc.contacts.stance[trial % 4] = trial % 3 > 0
            wbc.qp.update()
            yield wbc.solver

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
    for qp in trials(WholeBodyController(solo12, WholeBodySettings(tolerance=1e-9))):
        qp.reset()
        assert qp.solve() is TickStatus.SOLVED
        other = solve_by_interior_point(qp)
        z = qp.solution
        assert violation(qp, z) < 1e-8
        assert cost(qp, z) == pytest.approx(cost(qp, other), rel=1e-7, abs=1e-8)
        np.testing.assert_allclose(z[18:], other[18:], atol=1e-4)  # forces, N
        np.testing.assert_allclose(z[:18], other[:18], atol=1e-3)  # accelerations, up to 1e3 rad/s2


def test_solutions_are_optimal(solo12, trials):
    """-gradient lies in the cone of the active constraints' normals: multipliers found here, not the solver's."""
    for qp in trials(WholeBodyController(solo12, WholeBodySettings(tolerance=1e-8))):
        qp.reset()
        assert qp.solve() is TickStatus.SOLVED
        z = qp.solution
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


def test_warm_and_cold_starts_agree(solo12):
    """Along a motion with a sudden push in it, where the active set changes from tick to tick."""
    warm, cold = (WholeBodyController(solo12, WholeBodySettings(tolerance=1e-8)) for _ in range(2))
    rng = np.random.default_rng(31)
    q, v = solo12.q_reference.copy(), np.zeros(solo12.nv)
    iterations = np.zeros(2)
    for tick in range(120):
        v[6:] = 0.2 * np.sin(0.2 * tick + np.arange(12)) + 1e-3 * rng.normal(size=12)
        for wbc in (warm, cold):
            wbc.external_wrench[1] = 12.0 if 40 <= tick < 80 else 0.0
            wbc.tasks["com"].target.acceleration[:] = 3.0 * np.sin(0.1 * tick + np.arange(3))
            wbc.sense(q, v)
        cold.reset()
        for wbc in (warm, cold):
            assert wbc.solve() is TickStatus.SOLVED
        iterations += warm.solver.iterations, cold.solver.iterations
        np.testing.assert_allclose(warm.forces, cold.forces, atol=1e-3)
        np.testing.assert_allclose(warm.acceleration, cold.acceleration, atol=1e-2)
    assert iterations[0] < iterations[1]


def test_the_data_stays_in_the_solvers_memory(solo12, trials):
    """Cold and warm starts neither move the buffers nor change what was written to them."""
    names = (
        "hessian",
        "gradient",
        "equality",
        "equality_rhs",
        "inequality",
        "lower",
        "upper",
        "box_lower",
        "box_upper",
    )
    for trial, qp in enumerate(trials(WholeBodyController(solo12, WholeBodySettings()))):
        written = {name: getattr(qp, name).copy() for name in names}
        if trial % 3 == 0:
            qp.reset()
        assert qp.solve() is TickStatus.SOLVED
        model = qp._qp.model
        current = (model.H, model.g, model.A, model.b, model.C, model.l, model.u, model.l_box, model.u_box)
        for name, theirs in zip(names, current, strict=True):
            np.testing.assert_array_equal(theirs, written[name], err_msg=name)
            assert np.shares_memory(theirs, getattr(qp, name)), name
        assert np.shares_memory(qp._qp.results.x, qp.solution)


def draw(wbc, rng):
    """Write the QP of a state anywhere, of feet that stand or not on any floor, pushed: far from the last one."""
    robot, spread = wbc.robot, 10.0 ** rng.uniform(-1, 0.5)
    scales = np.concatenate([np.ones(3), np.full(3, 0.3 * spread), np.full(robot.nu, 0.4 * spread)])
    step = scales * rng.normal(size=robot.nv)
    wbc.sense(pin.integrate(robot.model, robot.q_reference, step), spread * rng.normal(0, 1, robot.nv))
    wbc.stand()
    wbc.contacts.stance[:] = rng.random(robot.nc) > 0.3
    wbc.contacts.friction[:] = rng.uniform(0.1, 0.8, robot.nc)
    wbc.tasks["com"].target.acceleration[:] = 10.0 ** rng.uniform(0, 2) * rng.normal(size=3)
    wbc.external_wrench[:3] = rng.normal(0, 10, 3)
    wbc.qp.update()


def test_a_warm_start_that_leads_nowhere_is_followed_by_a_cold_one(solo12):
    """Some of these tick pairs converge from cold alone: the solver returns their solution in the same tick."""
    wbc = WholeBodyController(solo12, WholeBodySettings())
    solver, rescued = wbc.solver, 0
    for seed in (133, 236, 360):
        outcomes = []
        for start in (solver._warm_start, solver._cold_start, solver.solve):
            rng = np.random.default_rng(seed)
            solver.reset()
            draw(wbc, rng)
            assert solver.solve() is TickStatus.SOLVED
            draw(wbc, rng)
            outcomes.append(start() is TickStatus.SOLVED)
        warm, cold, either = outcomes
        assert either == (warm or cold)
        rescued += cold and not warm
    assert rescued > 0


def slack(qp, z):
    """How far z is from the nearest limit, with its unit."""
    rows = qp.inequality @ z
    return np.concatenate([qp.upper - rows, rows - qp.lower, qp.box_upper - z, z - qp.box_lower]).min()


def test_while_no_limit_is_active_the_minimiser_under_the_equalities_is_the_solution(robot, random_state, randomise):
    """As an interior-point method has it, which is more exact than ProxQP; where a limit is active it is not taken."""
    wbc, rng = WholeBodyController(robot, WholeBodySettings()), np.random.default_rng(33)
    taken, nv = 0, robot.nv
    for trial in range(12):
        if trial % 3:
            wbc.sense(*random_state(rng, robot))
            randomise(wbc, rng)
        else:
            wbc.sense(robot.q_reference, 0.01 * rng.normal(size=nv))
            wbc.external_wrench[:] = 0.0
            wbc.contacts.target_forces[:] = (0.0, 0.0, 9.81 * robot.mass / robot.nc)
            wbc.stand()
        assert np.isfinite(wbc.qp.update())
        z, free = solve_by_interior_point(wbc.solver), wbc.qp.free_excess <= 1e-5
        assert free or slack(wbc.solver, z) < 1e-2
        assert not free or slack(wbc.solver, z) > -1e-4
        if free:
            taken += 1
            np.testing.assert_allclose(wbc.qp.free_solution[:nv], z[:nv], atol=1e-3)
            np.testing.assert_allclose(wbc.qp.free_solution[nv:], z[nv:], atol=1e-2 * robot.mass)
            assert cost(wbc.solver, wbc.qp.free_solution) <= cost(wbc.solver, z) + 1e-6 * abs(cost(wbc.solver, z))
            np.testing.assert_allclose(wbc.qp.free_torques, wbc.qp.torques(wbc.qp.free_solution), atol=1e-9)
            assert wbc.solve() is TickStatus.SOLVED
            np.testing.assert_array_equal(wbc.tau, wbc.qp.free_torques)
    assert 0 < taken < 12


def test_a_foot_in_the_air_needs_no_solver_as_long_as_no_limit_is_active(solo12, controller):
    """Standing on three feet under the centre of mass: the fourth has no force, whatever force it was to have."""
    controller.contacts.stance[0] = False
    q = solo12.q_reference.copy()
    controller.sense(q, np.zeros(solo12.nv))
    controller.stand()
    shift = controller.terms.contact_points[1:].mean(axis=0) - controller.terms.com
    controller.contacts.highest_normal[:] = 100.0
    controller.external_wrench[3:5] = 9.81 * solo12.mass * np.array([-shift[1], shift[0]])  # as if it stood above them
    controller.qp.update()
    assert controller.qp.free_excess <= 1e-5
    assert controller.solve() is TickStatus.SOLVED
    np.testing.assert_array_equal(controller.forces[0], 0.0)
    assert controller.forces[:, 2].sum() == pytest.approx(9.81 * solo12.mass, rel=0.02)


def test_without_a_weight_on_the_forces_proxqp_solves_alone(solo12):
    """The optimality conditions have no unique solution then."""
    wbc = WholeBodyController(solo12, WholeBodySettings().replace({"weights.force": 0.0}))
    assert wbc.solve() is TickStatus.SOLVED
    assert not wbc.qp.free_excess <= 1e-5
    assert wbc.forces[:, 2].sum() == pytest.approx(9.81 * solo12.mass, rel=1e-4)
