"""The answers of active sets and of ProxQP against a third solver and the optimality conditions, recomputed here."""

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.status import Status
from lgmpc.wbc import WholeBodyController, WholeBodySettings


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


@pytest.fixture(params=["active_set", "proxqp"])
def solver_name(request):
    return request.param


def test_same_solution_as_an_interior_point_method(solo12, trials, measures, solver_name):
    for qp in trials(WholeBodyController(solo12, WholeBodySettings(tolerance=1e-9, solver=solver_name))):
        qp.reset()
        assert qp.solve() is Status.CONVERGED
        assert qp.took_over == (solver_name == "proxqp")
        other = measures.solve_by_interior_point(qp)
        z = qp.solution
        np.testing.assert_allclose(qp.values, qp.inequality @ z, atol=1e-10)
        assert measures.violation(qp, z) < 1e-8
        assert measures.cost(qp, z) == pytest.approx(measures.cost(qp, other), rel=1e-7, abs=1e-8)
        np.testing.assert_allclose(z[18:], other[18:], atol=1e-4)  # forces, N
        np.testing.assert_allclose(z[:18], other[:18], atol=1e-3)  # accelerations, up to 1e3 rad/s2


def test_solutions_are_optimal(solo12, trials, measures, solver_name):
    for qp in trials(WholeBodyController(solo12, WholeBodySettings(tolerance=1e-8, solver=solver_name))):
        qp.reset()
        assert qp.solve() is Status.CONVERGED
        assert measures.stationarity(qp, qp.solution) < 1e-5 * max(1.0, np.abs(qp.gradient).max())


def test_warm_and_cold_starts_agree(solo12, solver_name):
    """Along a motion with a sudden push in it, where the active set changes from tick to tick."""
    warm, cold = (WholeBodyController(solo12, WholeBodySettings(tolerance=1e-8, solver=solver_name)) for _ in range(2))
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
            assert wbc.solve() is Status.CONVERGED
        iterations += warm.solver.iterations, cold.solver.iterations
        np.testing.assert_allclose(warm.forces, cold.forces, atol=1e-3)
        np.testing.assert_allclose(warm.acceleration, cold.acceleration, atol=1e-2)
    assert iterations[0] < iterations[1]


def test_the_data_stays_in_the_solvers_memory(solo12, trials, solver_name):
    """Cold and warm starts of both solvers neither move the buffers nor change what was written to them."""
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
    for trial, qp in enumerate(trials(WholeBodyController(solo12, WholeBodySettings(solver=solver_name)))):
        written = {name: getattr(qp, name).copy() for name in names}
        if trial % 3 == 0:
            qp.reset()
        assert qp.solve() is Status.CONVERGED
        model = qp._qp.model
        current = (model.H, model.g, model.A, model.b, model.C, model.l, model.u, model.l_box, model.u_box)
        for name, theirs in zip(names, current, strict=True):
            np.testing.assert_array_equal(theirs, written[name], err_msg=name)
            assert np.shares_memory(theirs, getattr(qp, name)), name


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


@pytest.mark.usefixtures("interpreted")
def test_a_warm_start_that_leads_nowhere_is_followed_by_a_cold_one(solo12):
    """Some of these tick pairs converge from cold alone: ProxQP returns their solution in the same tick."""
    wbc = WholeBodyController(solo12, WholeBodySettings(joint_horizon_s=0.05))
    solver, rescued = wbc.solver, 0
    for seed in (15, 55, 119, 701, 769):
        outcomes = []
        for start in (solver._warm_start, solver._cold_start, solver.solve):
            rng = np.random.default_rng(seed)
            solver.reset()
            draw(wbc, rng)
            assert solver.solve() is Status.CONVERGED
            draw(wbc, rng)
            outcomes.append(start() is Status.CONVERGED)
        warm, cold, either = outcomes
        assert either == (warm or cold)
        rescued += cold and not warm
    assert rescued > 0


def pushed_ticks(robot, seconds):
    """The solver after each tick of standing on the MuJoCo plant, pushed until feet slide and torques saturate."""
    plant, wbc = (
        MujocoPlant(robot, PlantSettings(friction=0.3)),
        WholeBodyController(robot, WholeBodySettings(tolerance=1e-7)),
    )
    plant.reset(robot.x_reference)
    for tick in range(round(seconds / plant.dt)):
        if tick == 50:
            plant.set_wrench("base_link", np.array([8.0, 14.0, 0.0, 0.0, 0.0, 0.0]))
        wbc.contacts.stance[0] = tick < 200  # a foot lifts off meanwhile
        sample = plant.sense()
        wbc.sense(sample.q, sample.v)
        assert wbc.solve() is Status.CONVERGED
        yield wbc.solver
        plant.step(wbc.tau)


def test_no_tick_of_a_push_is_left_to_proxqp(solo12, measures):
    """Where many limits become active or inactive, three methods compute the same minimiser."""
    hard, steps = 0, 0
    for qp in pushed_ticks(solo12, 0.35):
        assert not qp.took_over
        steps += qp.iterations
        if qp.iterations < 2:
            continue
        hard += 1
        z = qp.solution.copy()
        assert measures.violation(qp, z) < 1e-7
        assert measures.stationarity(qp, z) < 1e-5
        others = [measures.solve_by_interior_point(qp)]
        assert qp._cold_start() is Status.CONVERGED
        others.append(qp._qp.results.x.copy())
        for other in others:
            np.testing.assert_allclose(z, other, rtol=1e-4, atol=1e-3)
    assert hard > 5 and steps > 100


@pytest.mark.parametrize(
    "robot", ["solo12", *(pytest.param(name, marks=pytest.mark.slow) for name in ("anymal_c", "stilts"))], indirect=True
)
def test_active_sets_solve_whatever_proxqp_does(robot):
    """From the active limits of another state, and from none; what they do not solve contradicts itself."""
    wbc, rng = WholeBodyController(robot, WholeBodySettings()), np.random.default_rng(32)
    solved = np.zeros(2, dtype=int)
    for trial in range(30):
        draw(wbc, rng)
        if trial % 2:
            wbc.solver.reset()
        first = wbc.solver.solve() is Status.CONVERGED and not wbc.solver.took_over
        second = wbc.solver._cold_start() is Status.CONVERGED
        assert first or not second
        solved += first, second
    assert solved.min() > 10


def test_a_foot_in_the_air_or_without_load_has_no_force(solo12, controller):
    """Whatever force it was to have; the bounds of all three components fix it."""
    controller.contacts.stance[0] = False
    controller.contacts.lowest_normal[3] = controller.contacts.highest_normal[3] = 0.0  # just touched down
    controller.contacts.highest_normal[1:3] = 100.0
    controller.contacts.target_forces[:, :2] = 1.0
    assert controller.solve() is Status.CONVERGED
    np.testing.assert_array_equal(controller.forces[[0, 3]], 0.0)
    assert controller.forces[1:3, 2].min() > 1.0


def test_without_a_weight_on_the_forces_proxqp_solves_alone(solo12):
    """The Hessian is not positive definite then."""
    wbc = WholeBodyController(solo12, WholeBodySettings().replace({"weights.force": 0.0}))
    assert wbc.solve() is Status.CONVERGED
    assert wbc.solver.took_over
    assert wbc.forces[:, 2].sum() == pytest.approx(9.81 * solo12.mass, rel=1e-4)
