from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import CentroidalMpc, CentroidalMpcSettings, CentroidalWeights, MeasuredState, Plan
from lgmpc.ocp import KktResidual
from lgmpc.solvers import Solution, Status
from lgmpc.solvers.qp import QP_SOLVERS

MASS = 2.5
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])
STANCE = np.ones(4, dtype=bool)


def horizon(points: np.ndarray, flags: np.ndarray, friction: float = 0.6, nodes: int = 20) -> ContactHorizon:
    """One value for all intervals, or one each."""
    contacts = ContactHorizon.allocate(nodes, 4)
    contacts.hold(points, flags, friction)
    return contacts


def motion(reference: np.ndarray, nodes: int = 20, catching: bool = False) -> MotionReference:
    """The motion of a level base with [centre of mass; linear momentum; ...] (9,), or (N+1, 9) a node each."""
    rows = np.tile(reference, (nodes + 1, 1)) if reference.ndim == 1 else reference
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(rows), 1))
    return MotionReference(rows[:, :3], rows[:, 3:6] / MASS, level, np.zeros((len(rows), 3)), catching)


def make(**change: object) -> CentroidalMpc:
    return CentroidalMpc(MASS, 4, CentroidalMpcSettings(**change))


def update(mpc: CentroidalMpc, t: float, x: np.ndarray, **change: object) -> Plan:
    given = {"points": FEET, "flags": STANCE, "friction": 0.6, "reference": STANDING, "wrench": np.zeros(6)}
    given |= {"catching": False, **change}
    nodes = mpc.settings.nodes
    contacts = horizon(given["points"], given["flags"], given["friction"], nodes)
    wrench = np.broadcast_to(given["wrench"], (nodes, 6))
    state = MeasuredState.centroidal(t, x[:3], x[3:9])
    return mpc.update(state, contacts, motion(given["reference"], nodes, given["catching"]), wrench)


def advance(mpc: CentroidalMpc, x: np.ndarray, forces: np.ndarray, wrench: np.ndarray, period: float) -> np.ndarray:
    """Move the controller's exact model."""
    action = mpc.problem.action
    p = mpc.problem.parameters[0].copy()
    p[action.parameters["duration"]] = period
    p[action.parameters["external_wrench"]] = wrench
    return action.evaluate(x, forces.ravel(), p).x_next


def closed_loop(
    mpc: CentroidalMpc, impulse: tuple[float, float], seconds: float = 1.5
) -> tuple[np.ndarray, list[Plan]]:
    """Push for 0.2 s from 0.1 s on, without the controller's knowledge."""
    x, states, plans = STANDING.copy(), [], []
    for i in range(round(seconds / 0.01)):
        wrench = np.zeros(6)
        if 10 <= i < 30:
            wrench[:2] = np.array(impulse) / 0.2
        plans.append(update(mpc, i * 0.01, x))
        x = advance(mpc, x, plans[-1].first_forces, wrench, 0.01)
        states.append(x)
    return np.array(states), plans


def test_standing_still_needs_the_weight_shared_evenly() -> None:
    plan = update(make(), 0.0, STANDING)
    assert plan.status is Status.STEPPED
    np.testing.assert_allclose(plan.forces, np.tile([0.0, 0.0, MASS * 9.81 / 4], (20, 4, 1)), atol=1e-9)
    np.testing.assert_allclose(plan.xs, np.tile(STANDING, (21, 1)), atol=1e-12)
    assert plan.end == pytest.approx(0.4)


@pytest.mark.parametrize("qp_solver", QP_SOLVERS)
def test_pushed_model_comes_back_with_forces_that_do_not_slip(qp_solver: str) -> None:
    mpc = make(qp_solver=qp_solver)
    states, plans = closed_loop(mpc, (1.4, 1.4))
    assert np.abs(states[:, :2]).max() > 8e-3  # it is moved
    np.testing.assert_allclose(states[-1, :3], STANDING[:3], atol=2e-3)
    np.testing.assert_allclose(states[-1, 3:], 0.0, atol=2e-2)
    assert mpc.failures == 0
    forces = np.array([plan.forces for plan in plans])
    slip = np.linalg.norm(forces[..., :2], axis=-1) - 0.6 * forces[..., 2]
    assert slip.max() < 0.02  # N; OSQP is loose, the others are below 1e-5
    assert forces[..., 2].min() > 0.5 - 0.02 and forces[..., 2].max() < 60.0 + 0.02
    used = np.linalg.norm(forces[:, 0, :, :2], axis=-1) / forces[:, 0, :, 2]
    assert used.max() > 0.55  # friction is used to its limit


def test_known_wrench_is_met_at_once() -> None:
    blind, informed = make(), make()
    wrench = np.array([8.0, 0.0, 0.0, 0.0, 0.1, 0.0])
    x_blind, x_informed = STANDING, STANDING
    for i in range(20):
        plan = update(blind, i * 0.01, x_blind)
        x_blind = advance(blind, x_blind, plan.first_forces, wrench, 0.01)
        plan = update(informed, i * 0.01, x_informed, wrench=wrench)
        x_informed = advance(informed, x_informed, plan.first_forces, wrench, 0.01)
    assert abs(x_informed[0]) < 0.1 * abs(x_blind[0])
    assert plan.first_forces[:, 0].sum() == pytest.approx(-8.0, abs=0.3)


def test_vertical_acceleration_is_used_to_gain_friction() -> None:
    plan = update(make(), 0.0, STANDING + [0, 0, 0, 2.5, 0, 0, 0, 0, 0])
    assert plan.first_forces[:, 2].sum() > 1.5 * MASS * 9.81


def test_foot_in_the_air_has_exactly_no_force() -> None:
    flags = np.ones((20, 4), dtype=bool)
    flags[5:12, 2] = False
    for qp_solver in QP_SOLVERS:
        plan = update(make(qp_solver=qp_solver), 0.0, STANDING, flags=flags)
        assert plan.status is Status.STEPPED
        assert (plan.forces[5:12, 2] == 0.0).all()
        assert (np.delete(plan.forces, 2, axis=1)[5:12, :, 2] >= 0.49).all()
        assert np.abs(plan.forces[:5, 2, 2]).min() > 0.4


def test_references_and_points_may_differ_from_node_to_node() -> None:
    mpc = make()
    reference = np.tile(STANDING, (21, 1))
    reference[:, 1] = np.linspace(0.0, 0.03, 21)
    reference[:, 4] = MASS * 0.03 / 0.4
    points = np.tile(FEET, (20, 1, 1))
    points[10:, :, 0] += 0.02
    plan = update(mpc, 0.0, reference[0], reference=reference, points=points)
    np.testing.assert_allclose(plan.xs[:, 1], reference[:, 1], atol=2e-4)
    where = mpc.problem.action.parameters["contact_points"]
    np.testing.assert_array_equal(mpc.problem.parameters[12, where].reshape(4, 3), points[12])


def test_same_inputs_give_the_same_bits() -> None:
    for qp_solver in QP_SOLVERS:
        mpc = make(qp_solver=qp_solver)
        first, _ = closed_loop(mpc, (0.5, 1.8), seconds=0.2)
        mpc.reset()
        again, _ = closed_loop(mpc, (0.5, 1.8), seconds=0.2)
        other, _ = closed_loop(make(qp_solver=qp_solver), (0.5, 1.8), seconds=0.2)
        np.testing.assert_array_equal(first, again)
        np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize("iterations", [1, 2])
def test_machine_code_of_the_whole_update_gives_the_bits_of_its_parts(
    iterations: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, parts = make(sqp_iterations=iterations), make(sqp_iterations=iterations)
    assert whole._compiled is not None
    parts._compiled = None
    swinging = {"flags": STANCE & [True, False, True, True], "wrench": np.array([8.0, 0.0, 1.0, 0.0, 0.1, 0.0])}
    failing = whole.solver.qp_solver, parts.solver.qp_solver
    for i, change in enumerate([{}, swinging, {**swinging, "catching": True}, {}, {"friction": np.nan}, {}, swinging]):
        for solver in failing:
            solver._counts[1:3] = (1, 0) if i == 6 else (25, 30)  # too few: the fallback solves
        x = STANDING + (i / 6) * np.array([0.2, -0.3, -0.1, 2.0, -3.0, -1.0, 0.5, 0.5, 0.2])
        one, other = (update(mpc, 0.013 * i, x, **change) for mpc in (whole, parts))
        assert (one.time, one.status, one.qp_iterations) == (other.time, other.status, other.qp_iterations)
        np.testing.assert_array_equal(one.xs, other.xs)
        np.testing.assert_array_equal(one.forces, other.forces)
        assert [solver.took_over for solver in failing] == [i == 6, i == 6]


def test_more_iterations_change_little() -> None:
    one, _ = closed_loop(make(), (1.4, 1.4), seconds=0.6)
    three, _ = closed_loop(make(sqp_iterations=3), (1.4, 1.4), seconds=0.6)
    assert 0.0 < np.abs(one[:, :3] - three[:, :3]).max() < 5e-4


@pytest.mark.parametrize("broken", ["com", "wrench", "reference", "friction", "points", "time"])
def test_not_finite_input_keeps_the_last_plan(broken: str, caplog: pytest.LogCaptureFixture) -> None:
    mpc = make(stale_after=2)
    good = update(mpc, 0.0, STANDING + [0.01, 0, 0, 0.1, 0, 0, 0, 0, 0])
    x, t, change = STANDING.copy(), 0.01, {}
    if broken == "com":
        x[2] = np.nan
    elif broken == "time":
        t = math.nan
    else:
        name, value = {
            "wrench": ("wrench", np.zeros(6)),
            "reference": ("reference", STANDING.copy()),
            "friction": ("friction", np.array([0.6, 0.6])),
            "points": ("points", FEET.copy()),
        }[broken]
        value.flat[1] = np.inf if broken == "wrench" else np.nan
        change = {name: value if broken != "friction" else math.nan}
    with caplog.at_level(logging.WARNING):
        plans = [update(mpc, t, x, **change) for _ in range(4)]
    assert [plan.status for plan in plans] == [Status.NOT_FINITE] * 2 + [Status.STALE] * 2
    for plan in plans:
        assert plan.time == good.time
        np.testing.assert_array_equal(plan.xs, good.xs)
        np.testing.assert_array_equal(plan.forces, good.forces)
    assert mpc.failures == mpc.failures_in_a_row == 4
    assert len(caplog.records) == 1 and "NOT_FINITE; the last plan remains" in caplog.text  # logged once
    recovered = update(mpc, 0.05, STANDING)
    assert recovered.status is Status.STEPPED and recovered.time == 0.05
    assert mpc.failures == 4 and mpc.failures_in_a_row == 0


def test_before_any_success_the_weight_is_shared() -> None:
    mpc = make()
    plan = update(mpc, 0.3, np.full(9, np.nan), flags=np.array([True, False, True, True]))
    assert plan.status is Status.NOT_FINITE
    with pytest.raises(ValueError, match="read-only"):
        plan.xs[0, 0] = 1.0
    np.testing.assert_allclose(plan.first_forces[:, 2], MASS * 9.81 / 3 * np.array([1.0, 0.0, 1.0, 1.0]))
    np.testing.assert_array_equal(plan.sample(0.4).com, STANDING[:3])
    assert update(mpc, 0.31, STANDING).status is Status.STEPPED


@pytest.mark.parametrize("qp_solver", QP_SOLVERS)
@pytest.mark.parametrize("distance", [1.0, 1e3, 1e200])
def test_absurd_states_end_in_a_status(qp_solver: str, distance: float) -> None:
    mpc = make(qp_solver=qp_solver, weights=CentroidalWeights(angular_momentum=1e3))
    update(mpc, 0.0, STANDING)
    for i in range(3):
        plan = update(mpc, 0.01 * (i + 1), STANDING + distance * np.array([1, -1, 0.5, 2, 1, -1, 1, 1, 1]))
        assert np.isfinite(plan.xs).all() and np.isfinite(plan.forces).all()
        assert (plan.forces[..., 2] > -1.0).all() and (plan.forces[..., 2] < 61.0).all()
    back = [update(mpc, 0.05, STANDING) for _ in range(8)]
    assert all(plan.status.usable for plan in back)
    np.testing.assert_allclose(back[-1].first_forces[:, 2], MASS * 9.81 / 4, atol=0.05)


@pytest.mark.parametrize("qp_solver", ["active_set", "piqp"])
def test_saturated_forces_are_solved_for(qp_solver: str) -> None:
    mpc = make(qp_solver=qp_solver)
    plan = update(mpc, 0.0, STANDING + [0.3, -0.3, -0.1, 5.0, -5.0, -3.0, 0.5, 0.5, 0.2])
    assert plan.status is Status.STEPPED
    assert plan.first_forces[:, 2].max() == pytest.approx(60.0, abs=1e-4)
    assert mpc.solver.residual().constraint < 1e-5


def test_time_may_jump() -> None:
    mpc = make()
    x = STANDING + [0.01, 0, 0, 0.2, 0, 0, 0, 0, 0]
    fresh = update(make(), 0.0, x)
    for t in (0.0, 0.0, 0.07, 0.4, 5.0, 1.0, -3.0):
        plan = update(mpc, t, x)
        assert plan.status is Status.STEPPED and plan.time == t
        np.testing.assert_allclose(plan.xs, fresh.xs, atol=1e-3)


@pytest.mark.parametrize(
    ("contacts", "reference", "wrench"),
    [
        (ContactHorizon.allocate(20, 3), motion(STANDING), np.zeros((20, 6))),
        (ContactHorizon.allocate(19, 4), motion(STANDING), np.zeros((20, 6))),
        (ContactHorizon.allocate(20, 4), motion(STANDING, 19), np.zeros((20, 6))),
        (ContactHorizon.allocate(20, 4), motion(STANDING), np.zeros((20, 3))),
        (ContactHorizon.allocate(20, 4), motion(STANDING), np.zeros(6)),
    ],
)
def test_wrong_shapes_are_named(contacts: ContactHorizon, reference: MotionReference, wrench: np.ndarray) -> None:
    state = MeasuredState.centroidal(0.0, STANDING[:3], STANDING[3:])
    with pytest.raises(InputError, match=r"inputs of the MPC: .* expected points and normals \(20, 4, 3\)"):
        make().update(state, contacts, reference, wrench)


def test_wrong_measured_state_and_model_are_named() -> None:
    with pytest.raises(InputError, match="inputs of the MPC"):
        make().update(
            MeasuredState.centroidal(0.0, np.zeros(2), np.zeros(6)),
            ContactHorizon.allocate(20, 4),
            motion(STANDING),
            np.zeros((20, 6)),
        )
    with pytest.raises(InputError, match="mass: got -1"):
        CentroidalMpc(-1.0, 4)
    with pytest.raises(InputError, match="contacts: got 0"):
        CentroidalMpc(MASS, 0)
    with pytest.raises(InputError, match="gravity: got NaN"):
        CentroidalMpc(MASS, 4, gravity=(0.0, 0.0, math.nan))


def test_a_tilted_base_is_turned_upright_at_the_rate_of_the_settings() -> None:
    """The plan's angular momentum begins where it was measured and approaches I rate exp(-rate t) theta."""
    rate, inertia = 3.0, np.diag([0.02, 0.05, 0.06])
    settings = CentroidalMpcSettings(weights=CentroidalWeights(angular_momentum=1e6), uprighting_rate_hz=rate)
    mpc = CentroidalMpc(MASS, 4, settings)
    tilt = so3.exp(np.array([0.1, 0.0, 0.0]))
    momentum = np.r_[np.zeros(3), inertia @ [-0.1 * rate, 0.0, 0.0]]
    state = MeasuredState(0.0, np.zeros(0), np.zeros(0), STANDING[:3], momentum, tilt, inertia)
    plan = mpc.update(state, horizon(FEET, STANCE), motion(STANDING), np.zeros((20, 6)))
    expected = -0.1 * rate * inertia[0, 0] * np.exp(-rate * 0.02 * np.arange(21))
    np.testing.assert_allclose(plan.xs[:, 6], expected, atol=2e-5)


def test_a_turning_reference_has_its_angular_momentum() -> None:
    inertia = np.diag([0.02, 0.05, 0.06])
    reference = motion(STANDING)
    reference.angular_velocity[:, 2] = 0.5
    state = MeasuredState(0.0, np.zeros(0), np.zeros(0), STANDING[:3], np.r_[np.zeros(5), 0.03], np.eye(3), inertia)
    mpc = CentroidalMpc(MASS, 4, CentroidalMpcSettings(weights=CentroidalWeights(angular_momentum=1e6)))
    plan = mpc.update(state, horizon(FEET, STANCE), reference, np.zeros((20, 6)))
    np.testing.assert_allclose(plan.xs[:, 8], 0.03, atol=1e-5)


@pytest.mark.parametrize("mass", [2.5, 50.0])
def test_the_defaults_suit_a_heavier_robot(mass: float) -> None:
    """Weights and force limits scale with the mass: the same motion follows from forces in proportion."""
    x = np.array([0.02, -0.01, 0.0, 0.2, -0.1, 0.0, 0.0, 0.0, 0.0])
    mpc, small = CentroidalMpc(mass, 4), CentroidalMpc(2.5, 4)
    plans = []
    for each in (mpc, small):
        scaled = np.r_[STANDING[:3] + x[:3], each.mass * x[3:6], np.zeros(3)]
        plans.append(update(each, 0.0, scaled))
    np.testing.assert_allclose(plans[0].xs[:, :3], plans[1].xs[:, :3], atol=1e-6)
    np.testing.assert_allclose(plans[0].forces / mass, plans[1].forces / 2.5, atol=1e-3)


def test_a_foot_in_the_air_selects_the_weights_of_stepping() -> None:
    start = STANDING + [0.03, 0, 0, 0, 0, 0, 0, 0, 0]
    lifts = np.ones((20, 4), dtype=bool)
    lifts[10:14, 0] = False
    soft = CentroidalMpc(
        MASS, 4, CentroidalMpcSettings(weights=CentroidalWeights(com=(1e2, 1e2, 3e3)), normal_force_n=(0.5, 30.0))
    )
    mpc = make()
    standing = update(mpc, 0.0, start).xs
    mpc.reset()
    stepping = update(mpc, 0.0, start, flags=lifts).xs
    np.testing.assert_allclose(stepping, update(soft, 0.0, start, flags=lifts).xs, atol=1e-9)
    mpc.reset()
    np.testing.assert_array_equal(update(mpc, 0.0, start).xs, standing)


def test_steps_that_catch_a_push_have_weights_of_their_own() -> None:
    start = STANDING + [0, 0, 0, MASS, 0, 0.5 * MASS, 0, 0, 0]
    lifts = np.ones((20, 4), dtype=bool)
    lifts[10:14, 0] = False
    found = {}
    for catching in (False, True):
        found[catching] = update(make(), 0.0, start, flags=lifts, catching=catching).xs
        standing = update(make(), 0.0, start, catching=catching).xs
        np.testing.assert_array_equal(standing, update(make(), 0.0, start).xs)  # on all feet nothing is caught by steps
    heavy = CentroidalMpc(MASS, 4, CentroidalMpcSettings(stepping_weights={"com": (1e2, 1e2, 3e4)}))
    np.testing.assert_array_equal(found[True], update(heavy, 0.0, start, flags=lifts).xs)
    rise, low = (abs(found[catching][-1, 2] - STANDING[2]) for catching in (False, True))
    assert low < 0.5 * rise


def test_an_update_under_a_sudden_push_takes_few_sweeps() -> None:
    """The push changes most limits at once: the interior point method begins at the last multipliers."""
    wrench = np.array([22.0, 12.0, 0.0, 0.0, 0.0, 0.0])
    mpc, cold = make(), make()
    update(mpc, 0.0, STANDING)
    update(mpc, 0.01, STANDING, wrench=0.6 * wrench)  # as the observer sees it
    plan = update(mpc, 0.02, STANDING, wrench=wrench)
    assert plan.status is Status.STEPPED and plan.qp_iterations <= 18  # 25 and more from a path of its own
    for _ in range(8):  # the linearisations of both approach the same
        plan, other = (update(each, 0.02, STANDING, wrench=wrench) for each in (mpc, cold))
    np.testing.assert_allclose(plan.forces, other.forces, atol=2e-3)


@pytest.mark.parametrize("catching", [False, True])
def test_terminal_weights_of_steps_are_those_of_the_running_nodes_times_the_factor(catching: bool) -> None:
    mpc, lifts = make(), np.ones((20, 4), dtype=bool)
    lifts[10:14, 0] = False
    s = mpc.settings
    update(mpc, 0.0, STANDING, flags=lifts, catching=catching)
    seen, weights = mpc.problem.view("x_weight")[:, :3], (s.catching_weights if catching else s.stepping_weights).com
    np.testing.assert_array_equal(seen[:-1], np.tile(weights, (s.nodes, 1)))
    np.testing.assert_allclose(seen[-1], s.weights.terminal * np.array(weights), rtol=1e-15)
    assert s.weights.terminal not in (1.0, 2.0)


def test_weights_steer() -> None:
    start = STANDING + [0.03, 0, 0, 0, 0, 0, 0, 0, 0]
    stiff = update(make(), 0.0, start)
    soft = CentroidalMpc(MASS, 4, CentroidalMpcSettings(weights=CentroidalWeights(com=(10.0, 1e3, 1e3))))
    assert abs(stiff.xs[-1, 0]) < 0.3 * abs(update(soft, 0.0, start).xs[-1, 0])


@pytest.mark.parametrize(
    ("constraint", "dynamics", "status"),
    [
        (0.009 * MASS * 9.81, 0.009, Status.ACCEPTABLE),  # below 1 % of the weight, and 0.01 m or N.s
        (0.011 * MASS * 9.81, 0.0, Status.FAILED),
        (0.0, 0.011, Status.FAILED),
    ],
)
def test_a_loosely_solved_plan_is_followed_if_it_nearly_keeps_forces_and_dynamics(
    constraint: float, dynamics: float, status: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    mpc = make(qp_solver="piqp")  # which has no machine code of the whole update
    exact = mpc.solver.feedback

    def loose(x0: np.ndarray) -> Solution:
        kkt = KktResidual(0.0, dynamics, constraint, 0.0)
        return replace(exact(x0), status=Status.ACCEPTABLE, kkt=kkt)

    monkeypatch.setattr(mpc.solver, "feedback", loose)
    assert update(mpc, 0.0, STANDING).status is status
