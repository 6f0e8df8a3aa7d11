"""Full-body MPC of Solo12 standing."""

from __future__ import annotations

import logging
import math
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import FullBodyMpc, FullBodyMpcSettings, MeasuredState, Plan
from lgmpc.mpc.full_body import FootPaths, contact_point_model, holding_efforts
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.status import Status

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
STANCE = np.ones(4, dtype=bool)


@lru_cache
def solo() -> Robot:
    spec = RobotSpec(
        model="solo12", contact_frames=FEET, contact_radius_m=0.016, effort_limit_nm=1.8, velocity_limit_rad_s=30.0,
        position_limit_rad=(-2.8, 2.8), armature_kg_m2=3.6e-4, posture="standing",
    )  # fmt: skip
    return load_robot(spec)


@lru_cache
def interpreted_mpc() -> FullBodyMpc:
    return FullBodyMpc(solo(), FullBodyMpcSettings())


@pytest.fixture
def mpc(interpreted: None) -> FullBodyMpc:
    """As new; to interpret these few updates takes less than to compile."""
    found = interpreted_mpc()
    found.reset()
    return found


def standing() -> np.ndarray:
    com = pin.centerOfMass(solo().model, solo().create_data(), solo().q_reference)
    return np.concatenate([com, np.zeros(6)])


def motion(reference: np.ndarray, nodes: int = 20) -> MotionReference:
    """The reference posture, with [centre of mass; linear momentum; ...] (9,), or (N+1, 9) a node each."""
    made = MotionReference.standing(solo(), nodes, np.zeros(3))
    made.com[:] = reference[..., :3]
    made.com_velocity[:] = reference[..., 3:6] / solo().mass
    return made


def measured(t: float, q: np.ndarray, v: np.ndarray) -> MeasuredState:
    """What these models read of a state."""
    return MeasuredState(t, q, v, np.zeros(3), np.zeros(6), np.eye(3), np.eye(3))


def update(mpc: FullBodyMpc, t: float = 0.0, v: np.ndarray | None = None, **change: object) -> Plan:
    given = {"q": solo().q_reference, "flags": STANCE, "friction": 0.6, "reference": standing(), **change}
    contacts = ContactHorizon.allocate(20, 4)
    contacts.hold(np.zeros((4, 3)), given["flags"], given["friction"])
    state = measured(t, given["q"], np.zeros(18) if v is None else v)
    wrench = np.broadcast_to(change.get("wrench", np.zeros(6)), (20, 6))
    return mpc.update(state, contacts, motion(given["reference"]), wrench)


def pushed(speed: float) -> np.ndarray:
    """The base moves along x and y, the joints so that the feet stay."""
    model, names = contact_point_model(solo())
    data = model.createData()
    pin.computeJointJacobians(model, data, solo().q_reference)
    pin.updateFramePlacements(model, data)
    feet = [pin.getFrameJacobian(model, data, model.getFrameId(n), pin.LOCAL_WORLD_ALIGNED)[:3] for n in names]
    jacobian, base = np.vstack(feet), np.array([speed, speed, 0.0, 0.0, 0.0, 0.0])
    return np.concatenate([base, -np.linalg.solve(jacobian[:, 6:], jacobian[:, :6] @ base)])


def test_standing_still_needs_the_weight_and_no_motion(mpc: FullBodyMpc) -> None:
    plan = update(mpc)
    assert plan.status is Status.STEPPED
    np.testing.assert_allclose(plan.forces.sum(axis=1), np.tile([0.0, 0.0, solo().mass * 9.81], (20, 1)), atol=1e-4)
    np.testing.assert_allclose(plan.xs, np.tile(standing(), (21, 1)), atol=1e-5)
    assert plan.posture is not None
    np.testing.assert_allclose(plan.posture.qs, np.tile(solo().q_reference, (21, 1)), atol=1e-4)


def test_the_plan_begins_with_the_measured_momentum_and_obeys_newton(mpc: FullBodyMpc) -> None:
    rng = np.random.default_rng(0)
    q = pin.integrate(solo().model, solo().q_reference, rng.uniform(-0.03, 0.03, 18))
    v = 0.2 * rng.standard_normal(18)
    wrench = np.array([4.0, -2.0, 1.0, 0.1, 0.0, 0.05])
    for i in range(4):  # iterations at the same time and state
        plan = update(mpc, 0.0, v, q=q, wrench=wrench)
        assert plan.status is Status.STEPPED, i
    data = solo().create_data()
    momentum = pin.computeCentroidalMomentum(solo().model, data, q, v).vector
    np.testing.assert_allclose(plan.xs[0], np.r_[data.com[0], momentum], atol=1e-9)
    gained = np.diff(plan.xs[:, 3:6], axis=0) / plan.node_duration
    expected = plan.forces.sum(axis=1) + solo().mass * solo().gravity + wrench[:3]
    np.testing.assert_allclose(gained, expected, atol=1.0)  # velocities are integrated, to first order


def test_known_wrench_is_met_at_once(mpc: FullBodyMpc) -> None:
    plan = update(mpc, wrench=np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0]))
    assert plan.first_forces[:, 1].sum() == pytest.approx(-8.0, rel=0.05)
    assert np.abs(plan.xs[:, 1] - standing()[1]).max() < 1e-3


def test_forces_do_not_slip_when_pushed(mpc: FullBodyMpc) -> None:
    for i in range(5):
        plan = update(mpc, 0.0, pushed(0.4), friction=0.45)
        assert plan.status is Status.STEPPED, i
    slip = np.linalg.norm(plan.forces[..., :2], axis=-1) - 0.45 * plan.forces[..., 2]
    assert -0.2 < slip.max() < 0.01  # friction is used to its limit
    assert plan.forces[..., 2].min() == pytest.approx(0.5, abs=0.01)  # and a foot unloaded to its


def test_torques_keep_their_limits_when_pushed_hard(mpc: FullBodyMpc) -> None:
    for i in range(4):
        plan = update(mpc, 0.0, pushed(0.5))
        assert plan.status is Status.STEPPED, i
    assert np.abs(mpc.solver.us).max() == pytest.approx(1.8, abs=1e-5)  # they are needed


def test_foot_in_the_air_has_exactly_no_force(mpc: FullBodyMpc) -> None:
    flags = np.ones((20, 4), dtype=bool)
    flags[5:12, 2] = False
    for _ in range(3):
        plan = update(mpc, flags=flags)
        assert plan.status is Status.STEPPED
    assert (plan.forces[5:12, 2] == 0.0).all()
    assert (np.delete(plan.forces, 2, axis=1)[5:12, :, 2] > 0.4).all()
    assert plan.forces[:5, 2, 2].min() > 0.4 and plan.forces[12:, 2, 2].min() > 0.4


def test_references_are_followed(mpc: FullBodyMpc) -> None:
    reference = np.tile(standing(), (21, 1))
    reference[:, 1] += np.linspace(0.0, 0.03, 21)
    reference[1:, 4] = solo().mass * 0.03 / 0.4
    for _ in range(3):
        plan = update(mpc, reference=reference)
    np.testing.assert_allclose(plan.xs[5:, 1], reference[5:, 1], atol=2e-3)


def test_same_inputs_give_the_same_bits(mpc: FullBodyMpc) -> None:
    def trace() -> np.ndarray:
        mpc.reset()
        return np.array([update(mpc, 0.02 * i, pushed(0.3 / (i + 1))).forces for i in range(4)])

    np.testing.assert_array_equal(trace(), trace())


@pytest.mark.parametrize("broken", ["q", "v", "wrench", "reference", "friction", "time"])
def test_not_finite_input_keeps_the_last_plan(mpc: FullBodyMpc, broken: str, caplog: pytest.LogCaptureFixture) -> None:
    good = update(mpc, 0.0, pushed(0.1))
    whole = {"q": solo().q_reference, "v": np.zeros(18), "wrench": np.zeros(6), "reference": standing()}
    t, change = 0.02, {}
    if broken == "time":
        t = math.nan
    elif broken == "friction":
        change = {"friction": math.nan}
    else:
        value = np.array(whole[broken])
        value.flat[1] = math.nan
        change = {broken: value}
    with caplog.at_level(logging.WARNING):
        plans = [update(mpc, t, **{"v": np.zeros(18), **change}) for _ in range(7)]
    assert [plan.status for plan in plans] == [Status.NOT_FINITE] * 5 + [Status.STALE] * 2
    for plan in plans:
        assert plan.time == good.time
        np.testing.assert_array_equal(plan.forces, good.forces)
        assert plan.posture is good.posture
    assert mpc.failures == 7 and len(caplog.records) == 1
    recovered = update(mpc, 0.2)
    assert recovered.status is Status.STEPPED and recovered.time == 0.2 and mpc.failures_in_a_row == 0


def test_before_any_success_it_stands(mpc: FullBodyMpc) -> None:
    plan = update(mpc, 0.3, np.full(18, np.nan), flags=np.array([True, False, True, True]))
    assert plan.status is Status.NOT_FINITE
    np.testing.assert_allclose(plan.first_forces[:, 2], solo().mass * 9.81 / 3 * np.array([1.0, 0.0, 1.0, 1.0]))
    assert plan.posture is not None
    sample = plan.posture.sample_at(np.array([0.3, 0.5]))
    np.testing.assert_allclose(sample.position, np.tile(solo().q_reference[7:], (2, 1)), atol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        plan.posture.qs[0, 0] = 1.0


@pytest.mark.parametrize("speed", [1e2, 1e200])
def test_absurd_states_end_in_a_status(mpc: FullBodyMpc, speed: float) -> None:
    update(mpc)
    for i in range(3):
        plan = update(mpc, 0.02 * (i + 1), speed * np.ones(18))
        assert np.isfinite(plan.xs).all() and np.isfinite(plan.forces).all()
    back = [update(mpc, 0.1 + 0.02 * i) for i in range(8)]
    assert back[-1].status.usable
    assert back[-1].first_forces[:, 2].sum() == pytest.approx(solo().mass * 9.81, rel=0.02)


@pytest.mark.parametrize("broken", ["contacts", "reference", "wrench"])
def test_wrong_shapes_are_named(mpc: FullBodyMpc, broken: str) -> None:
    right = {"contacts": ContactHorizon.allocate(20, 4), "reference": motion(standing()), "wrench": np.zeros((20, 6))}
    wrong = {
        "contacts": ContactHorizon.allocate(20, 3),
        "reference": motion(standing(), 19),
        "wrench": np.zeros((19, 6)),
    }
    state = measured(0.0, solo().q_reference, np.zeros(18))
    with pytest.raises(InputError, match=r"inputs of the MPC: .* expected points and normals \(20, 4, 3\)"):
        mpc.update(state, **{**right, broken: wrong[broken]})


def test_wrong_measured_state_is_named(mpc: FullBodyMpc) -> None:
    with pytest.raises(InputError, match=r"measured state: got shapes \(18,\) and \(18,\); expected q \(19,\)"):
        update(mpc, q=np.zeros(18))
    with pytest.raises(InputError, match=r"measured state: .* and v \(18,\)"):
        update(mpc, v=np.zeros(19))


def test_a_plan_that_stretches_a_leg_does_not_keep_the_reach(mpc: FullBodyMpc) -> None:
    assert mpc.keeps_reach(update(mpc))
    # Pushed by most of its weight, 10 N more than friction gives, and already moving: it would go on for 10 cm.
    plan = update(mpc, 0.02, pushed(0.3), wrench=np.array([0.0, 25.0, 0.0, 0.0, 0.0, 0.0]))
    assert plan.posture is not None
    assert np.abs(plan.posture.qs[:, 7:] - solo().q_reference[7:]).max() > 0.9
    assert not mpc.keeps_reach(plan)


def test_what_is_forgotten_is_no_guess_but_still_a_plan_to_fall_back_on(mpc: FullBodyMpc) -> None:
    fresh = update(mpc, 0.0, pushed(0.1))
    mpc.reset()
    good = update(mpc, -0.02, pushed(0.3))
    mpc.reset_guess()
    np.testing.assert_array_equal(update(mpc, 0.0, pushed(0.1)).forces, fresh.forces)
    mpc.reset()
    good = update(mpc, 0.0)
    mpc.reset_guess()
    assert update(mpc, 0.02, np.full(18, np.nan)).xs is good.xs


def test_contact_points_are_where_the_soles_are() -> None:
    model, names = contact_point_model(solo())
    data = model.createData()
    pin.framesForwardKinematics(model, data, solo().q_reference)
    for name, frame in zip(names, solo().contact_ids, strict=True):
        point, foot = (data.oMf[i].translation for i in (model.getFrameId(name), frame))
        np.testing.assert_allclose(foot - point, [0.0, 0.0, 0.016], atol=1e-12)
        assert point[2] == pytest.approx(0.0, abs=1e-9)
    assert len(solo().model.frames) == len(model.frames) - 4  # the robot's own model is left alone


def test_holding_efforts_hold() -> None:
    model, names = contact_point_model(solo())
    data, q = model.createData(), solo().q_reference
    efforts = holding_efforts(model, names, q)
    pin.computeAllTerms(model, data, q, np.zeros(18))
    pin.updateFramePlacements(model, data)
    jacobian = np.vstack(
        [pin.getFrameJacobian(model, data, model.getFrameId(n), pin.LOCAL_WORLD_ALIGNED)[:3] for n in names]
    )
    a = pin.forwardDynamics(model, data, q, np.zeros(18), np.r_[np.zeros(6), efforts], jacobian, np.zeros(12), 1e-12)
    np.testing.assert_allclose(a, 0.0, atol=1e-6)


def test_terminal_weights_are_those_of_the_running_nodes_times_the_factor(mpc: FullBodyMpc) -> None:
    """Running weights are per second: the action multiplies them by the interval's duration, the last node's not."""
    weights = mpc.settings.weights
    seen = mpc.problem.view("com_weight")
    np.testing.assert_allclose(seen[:-1] * 0.02, np.tile(weights.com, (20, 1)))
    np.testing.assert_allclose(seen[-1], np.multiply(weights.terminal, weights.com))


@pytest.mark.slow
def test_after_a_state_that_is_not_finite_the_guess_is_the_last_plan() -> None:
    """The next update starts from the last fresh plan, and not from rest."""
    mpc = FullBodyMpc(solo(), FullBodyMpcSettings())
    update(mpc, 0.0, pushed(0.3))
    update(mpc, 0.02, np.full(18, np.nan))
    resumed = update(mpc, 0.02, pushed(0.25))
    mpc.reset()
    update(mpc, 0.0, pushed(0.3))
    # The QP's own warm start differs, so the same guess gives the same plan but for the solver's tolerance.
    np.testing.assert_allclose(resumed.forces, update(mpc, 0.02, pushed(0.25)).forces, atol=1e-5)
    mpc.reset()
    assert np.abs(resumed.forces - update(mpc, 0.02, pushed(0.25)).forces).max() > 1e-3


def test_feet_in_the_air_move_to_their_footholds() -> None:
    """One foot in the air now, one later, one beyond the horizon, one not at all."""
    model, names = contact_point_model(solo())
    dt = 0.02
    paths = FootPaths(model, names, dt)
    horizon = ContactHorizon.allocate(10, 4)
    horizon.points[:] = np.random.default_rng(3).uniform(-0.3, 0.3, (4, 3))
    horizon.flags[:4, 0] = horizon.flags[3:7, 1] = horizon.flags[8:, 2] = False
    horizon.points[3:, 1] += (0.1, 0.02, 0.03)
    horizon.points[8:, 2] += (0.1, 0.0, 0.0)
    q, v = solo().q_reference, np.random.default_rng(4).uniform(-1.0, 1.0, 18)
    ways, in_air = paths.ahead(q, v, horizon)
    nodes = [np.flatnonzero(in_air[:, i]).tolist() for i in range(4)]
    assert nodes == [[0, 1, 2, 3, 4], [3, 4, 5, 6, 7], [8, 9, 10], []]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    np.testing.assert_allclose(ways[0, 0], data.oMf[model.getFrameId(names[0])].translation, atol=1e-12)
    np.testing.assert_allclose(ways[4, 0], horizon.points[3, 0], atol=1e-12)
    np.testing.assert_allclose(ways[3, 1], horizon.points[2, 1], atol=1e-12)
    np.testing.assert_allclose(ways[7, 1], horizon.points[6, 1], atol=1e-12)
    np.testing.assert_allclose(ways[5, 1], 0.5 * (horizon.points[2, 1] + horizon.points[6, 1]), atol=1e-12)
    # The one beyond the horizon is half-way, as the others' swings take four intervals.
    np.testing.assert_allclose(ways[10, 2], 0.5 * (horizon.points[7, 2] + horizon.points[8, 2]), atol=1e-12)
    # The cubic that begins with the measured velocity, a quarter of its way.
    pin.forwardKinematics(model, data, q, v)
    velocity = pin.getFrameVelocity(model, data, model.getFrameId(names[0]), pin.LOCAL_WORLD_ALIGNED).linear
    first, second = ways[:2, 0]
    other = horizon.points[3, 0] - first
    np.testing.assert_allclose(second - first, other * (3 - 2 * 0.25) * 0.0625 + 4 * dt * velocity * 0.25 * 0.5625)
