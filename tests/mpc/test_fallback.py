"""Which model plans: that with base and joints while its plans keep the legs' reach, else the centroidal one."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import FallbackMpc, MeasuredState, Mpc, Plan, make_mpc
from lgmpc.robot import Robot
from lgmpc.status import Status

pytestmark = pytest.mark.usefixtures("interpreted")
CONFIG = Path(__file__).parents[2] / "configs" / "solo12_balance_full_body.yaml"
CALM = np.zeros(6)
PUSHED = np.array([0.0, 25.0, 0.0, 0.0, 0.0, 0.0])


@lru_cache
def made() -> tuple[Robot, FallbackMpc]:
    config = load_config(CONFIG)
    robot = build_robot(config)
    mpc = make_mpc(robot, config.mpc)
    assert isinstance(mpc, FallbackMpc)
    return robot, mpc


@pytest.fixture
def mpc() -> FallbackMpc:
    """As new."""
    made()[1].reset()
    return made()[1]


def update(mpc: Mpc, k: int, wrench: np.ndarray = CALM, q: np.ndarray | None = None) -> Plan:
    robot = made()[0]
    data, q = robot.create_data(), robot.q_reference if q is None else q
    pin.computeCentroidalMap(robot.model, data, q)
    pin.centerOfMass(robot.model, data, q)
    com = data.com[0].copy()
    pin.framesForwardKinematics(robot.model, data, q)
    points = np.array([data.oMf[i].translation for i in robot.contact_ids]) - [0.0, 0.0, robot.contact_radius]
    contacts = ContactHorizon.allocate(20, 4)
    contacts.hold(points, np.ones(4, dtype=bool), 0.6)
    rotation = pin.Quaternion(robot.q_reference[3:7]).matrix()
    state = MeasuredState(0.02 * k, q, np.zeros(robot.nv), com, np.zeros(6), rotation, data.Ag[3:, 3:6].copy())
    reference = MotionReference.standing(robot, 20, com)
    return mpc.update(state, contacts, reference, np.tile(wrench, (20, 1)))


def by_legs(plan: Plan) -> bool:
    return plan.posture is not None


def test_the_centroidal_model_plans_while_the_legs_would_be_stretched(mpc: FallbackMpc) -> None:
    plans = [update(mpc, k, PUSHED if k in (1, 2) else CALM) for k in range(9)]
    # The multibody model pauses for four updates, and its first plan after that, made without a guess, is not followed.
    assert [k for k, plan in enumerate(plans) if not by_legs(plan)] == [1, 2, 3, 4, 5, 6]
    assert all(plan.status is Status.STEPPED for plan in plans)
    assert mpc.fallback_updates == 6


def test_the_centroidal_model_plans_what_it_would_have_planned_alone(mpc: FallbackMpc) -> None:
    plan = update(mpc, 0, PUSHED)
    mpc.reset()
    alone = update(mpc.fallback, 0, PUSHED)
    np.testing.assert_array_equal(plan.forces, alone.forces)


def test_the_centroidal_model_plans_when_the_other_fails(mpc: FallbackMpc) -> None:
    good = update(mpc, 0)
    weights = mpc.mpc.problem.view("com_weight")
    kept = weights.copy()
    weights[:] = np.nan  # the fault: the costs of the model with base and joints are lost, all else is sound
    try:
        plan = update(mpc, 1)
    finally:
        weights[:] = kept
    assert plan.status is Status.STEPPED and not by_legs(plan)
    assert mpc.mpc.failures == 1 and mpc.failures == 0
    np.testing.assert_allclose(plan.forces, good.forces, atol=0.05)


def test_a_state_that_is_not_finite_fails_both(mpc: FallbackMpc) -> None:
    good = update(mpc, 0, PUSHED)
    q = made()[0].q_reference.copy()
    q[9] = np.nan
    plan = update(mpc, 1, q=q)
    assert plan.status is Status.NOT_FINITE
    np.testing.assert_array_equal(plan.forces, good.forces)


def test_the_stand_in_has_the_horizon_and_the_limits_of_the_model_it_stands_in_for() -> None:
    config = load_config(CONFIG, ["mpc.nodes=17", "mpc.friction=0.5", "mpc.friction_facets=8"])
    mpc = make_mpc(made()[0], config.mpc)
    assert isinstance(mpc, FallbackMpc)
    shared = ("nodes", "node_s", "friction", "friction_facets", "rate_hz", "qp_solver", "stale_after")
    assert [getattr(mpc.fallback.settings, name) for name in shared] == [getattr(config.mpc, name) for name in shared]
