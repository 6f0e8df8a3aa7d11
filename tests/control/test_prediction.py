"""Who plans: the whole body's model while its plans keep the legs' reach, the centroidal one when they do not."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.balance import BalanceController
from lgmpc.control.interface import RobotState
from lgmpc.control.prediction import Predictor, WholeBodyPredictor
from lgmpc.mpc import CentroidalPlan, MpcStatus
from lgmpc.wbc import WholeBodyReference

CONFIGS = Path(__file__).parents[2] / "configs"
CALM = np.zeros(6)
PUSHED = np.array([0.0, 25.0, 0.0, 0.0, 0.0, 0.0])


@lru_cache
def controller() -> BalanceController:
    config = load_config(CONFIGS / "solo12_balance_kinodynamic.yaml")
    return build_controller(config, build_robot(config))


@pytest.fixture
def predictor() -> WholeBodyPredictor:
    """As new."""
    planner = controller().planner
    assert planner is not None and isinstance(planner.predictor, WholeBodyPredictor)
    planner.predictor.reset()
    return planner.predictor


def predict(predictor: Predictor, k: int, wrench: np.ndarray = CALM, q: np.ndarray | None = None) -> CentroidalPlan:
    robot = controller().robot
    terms = controller().wbc.sense(robot.q_reference if q is None else q, np.zeros(robot.nv))
    tracked = WholeBodyReference.standing(robot, terms.com, terms.contact_points)
    reference = np.tile(np.r_[terms.com, np.zeros(6)], (21, 1))
    return predictor.predict(0.02 * k, terms, tracked, reference, np.tile(wrench, (20, 1)))


def by_legs(plan: CentroidalPlan) -> bool:
    return plan.posture is not None


def test_the_centroidal_model_plans_while_the_legs_would_be_stretched(predictor: WholeBodyPredictor) -> None:
    plans = [predict(predictor, k, PUSHED if k in (1, 2) else CALM) for k in range(9)]
    # The legs' model sits out four updates, and its first plan after that, made without a guess, is not followed yet.
    assert [k for k, plan in enumerate(plans) if not by_legs(plan)] == [1, 2, 3, 4, 5, 6]
    assert all(plan.status is MpcStatus.SOLVED for plan in plans)
    assert predictor.stood_in == 6


def test_the_centroidal_model_plans_what_it_would_have_planned_alone(predictor: WholeBodyPredictor) -> None:
    plan = predict(predictor, 0, PUSHED)
    predictor.reset()
    alone = predict(predictor.stand_in, 0, PUSHED)
    np.testing.assert_array_equal(plan.forces, alone.forces)


def test_the_centroidal_model_plans_when_the_other_fails(predictor: WholeBodyPredictor) -> None:
    good = predict(predictor, 0)
    predictor.mpc.problem.view("com_weight")[:] = (
        np.nan
    )  # the fault: the whole body's costs are lost, all else is sound
    try:
        plan = predict(predictor, 1)
    finally:
        for node, weight in enumerate([50.0] * 20 + [10.0]):
            predictor.mpc.problem.view("com_weight")[node] = 1e3 * weight
    assert plan.status is MpcStatus.SOLVED and not by_legs(plan)
    assert predictor.mpc.failures == 1
    np.testing.assert_allclose(plan.forces, good.forces, atol=0.05)


def test_a_state_that_is_not_finite_fails_both(predictor: WholeBodyPredictor) -> None:
    good = predict(predictor, 0, PUSHED)
    q = controller().robot.q_reference.copy()
    q[9] = np.nan
    plan = predict(predictor, 1, q=q)
    assert plan.status is MpcStatus.NOT_FINITE
    np.testing.assert_array_equal(plan.forces, good.forces)


def test_the_posture_is_the_standing_one_where_the_plan_has_none() -> None:
    planner, tracked, robot = controller().planner, controller()._tracked, controller().robot
    assert planner is not None
    controller().update(RobotState(0.0, robot.q_reference, np.zeros(robot.nv)))
    upright, joints = tracked.base_rotation.copy(), tracked.joint_position.copy()
    tracked.base_rotation[:], tracked.joint_position[:] = (
        np.eye(3)[[1, 2, 0]],
        0.5,
    )  # what a plan of the legs might leave
    planner._tick = 0
    planner.observer.skip()
    planner.observer.wrench[:] = 2.4 * PUSHED
    planner.update(0.02, controller().wbc.terms, tracked)
    assert planner.plan is not None and not by_legs(planner.plan)
    np.testing.assert_allclose(tracked.base_rotation, upright, atol=1e-6)
    np.testing.assert_allclose(tracked.joint_position, robot.q_reference[robot.joint_q], atol=1e-12)
    np.testing.assert_allclose(joints, tracked.joint_position, atol=1e-3)
    np.testing.assert_array_equal(tracked.joint_velocity, 0.0)
