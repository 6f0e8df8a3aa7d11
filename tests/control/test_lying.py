"""Folding the legs and lifting the trunk: smooth paths between the right ends, and bounded torques."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.lying import LegRetraction, LyingSettings, RiseMotion
from lgmpc.robot import Robot
from lgmpc.robot.lying import lying_posture
from lgmpc.robot.posture import contact_heights

SETTINGS = LyingSettings()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(load_config(Path(__file__).parents[2] / "configs" / "solo12_rise.yaml"))


def test_folding_goes_smoothly_to_the_lying_posture(robot: Robot) -> None:
    folding, joints = LegRetraction(robot, SETTINGS), np.zeros(robot.nu)
    joints[1::3] = 1.4
    folding.begin(2.0, joints, np.zeros(robot.nu))
    np.testing.assert_allclose(folding.lying, lying_posture(robot)[robot.joint_q])
    times = np.arange(2.0, 8.0, 1e-3)
    end = next(t for t in times if folding.done(float(t)))
    path = np.array([folding.target(float(t))[0] for t in times])
    rate = np.array([folding.target(float(t))[1] for t in times])
    np.testing.assert_allclose(path[0], joints)
    np.testing.assert_allclose(path[times >= end], folding.lying[None].repeat(np.sum(times >= end), axis=0))
    np.testing.assert_allclose(np.gradient(path, times, axis=0)[1:-1], rate[1:-1], atol=0.02)
    assert 1.7 * SETTINGS.fold_rate_rad_s < np.abs(rate).max() < 1.9 * SETTINGS.fold_rate_rad_s  # 15/8 of the mean


def test_the_feet_are_lifted_before_they_are_put_down(robot: Robot) -> None:
    folding, q = LegRetraction(robot, SETTINGS), lying_posture(robot)
    folding.begin(0.0, np.zeros(robot.nu), np.zeros(robot.nu))
    heights = []
    for t in np.arange(0.0, 4.0, 0.01):
        q[robot.joint_q] = folding.target(float(t))[0]
        heights.append(contact_heights(robot.model, q, robot.contact_ids, robot.contact_radius).min())
    assert heights[-1] == pytest.approx(0.0, abs=1e-4)
    assert max(heights) == pytest.approx(SETTINGS.clearance_m, abs=1e-3)


def test_folding_torques_begin_with_the_present_one_are_bounded_and_vanish_when_folded(robot: Robot) -> None:
    folding, rest, torque = LegRetraction(robot, SETTINGS), np.zeros(robot.nu), np.linspace(-1.0, 1.0, robot.nu)
    folding.begin(0.0, folding.lying, torque)
    np.testing.assert_allclose(folding.torques(0.0, folding.lying, rest), torque, atol=1e-12)
    np.testing.assert_array_equal(folding.torques(10.0, folding.lying, rest), 0.0)
    bound = SETTINGS.effort_share * robot.effort_limit
    np.testing.assert_allclose(folding.torques(10.0, folding.lying + 3.0, rest), -bound)


@pytest.mark.parametrize("rising", [True, False])
def test_a_lift_goes_all_the_way_with_the_weight_on_the_feet(rising: bool) -> None:
    low, high = np.array([0.02, -0.01, -0.15]), np.zeros(3)
    start, goal = (low, high) if rising else (high, low)
    lift = RiseMotion(SETTINGS)
    lift.begin(1.0, start, goal)
    times = np.linspace(1.0, 1.0 + SETTINGS.rise_s + (SETTINGS.load_s if rising else 0.0), 2001)
    rows = []
    for t in times:
        over = lift.update(float(t))
        rows.append([*lift.offset, *lift.velocity, *lift.acceleration, lift.support, lift.lying])
        assert over == (t >= times[-1] - 1e-9)
    rows = np.array(rows)
    np.testing.assert_allclose(rows[[0, -1], :3], [start, goal], atol=1e-12)
    np.testing.assert_allclose(rows[[0, -1], 3:9], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(rows[:, :3], times, axis=0), rows[:, 3:6], atol=2e-4)
    np.testing.assert_allclose(np.gradient(rows[:, 3:6], times, axis=0)[2:-2], rows[2:-2, 6:9], atol=5e-3)
    np.testing.assert_allclose(rows[[0, -1], 9], [1.0, 0.0] if rising else [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(rows[[0, -1], 10], [1.0, 0.0] if rising else [0.0, 1.0], atol=1e-12)
    moving = np.linalg.norm(rows[:, 3:6], axis=1) > 1e-9
    assert (rows[moving, 9] < 1e-9).all(), "the feet carry the whole weight while the trunk moves"
