"""Feet: a swing begins wherever its foot is, and ends where a plan decided."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.feet import Feet
from lgmpc.lie import so3
from lgmpc.locomotion import BaseMotion, ContactState, MotionCommand
from lgmpc.locomotion.settings import LocomotionSettings, gaits_of
from lgmpc.robot import Robot
from lgmpc.wbc import Contacts, WholeBodySettings

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_balance.yaml"
FOOT = 1


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(load_config(CONFIG))


@pytest.mark.parametrize(
    ("touched_s", "state"), [(0.02, ContactState.LOST), (0.0, ContactState.MISSING)], ids=["lost", "missing"]
)
def test_a_foot_without_ground_swings_when_its_next_swing_is_due(
    robot: Robot, touched_s: float, state: ContactState
) -> None:
    """After its first swing the foot touches the ground for ``touched_s``, s, and never again."""
    settings = LocomotionSettings()
    feet = Feet(robot, settings, gaits_of(robot, settings), Contacts.standing(robot, WholeBodySettings().scaled(robot)))
    points = feet.legs.feet * [1.0, 1.0, 0.0]
    feet.begin(0.0, points, None)
    behind = points - [0.05, 0.0, 0.0]  # the feet that stand, once the robot has passed over them
    found, heights, aims = set(), [], []
    touchdown = np.inf
    for time in 1e-3 * np.arange(1, 500):
        feet.follow(time, MotionCommand(vx=0.1, gait="trot"))
        scheduled = feet.clock.flags(time)
        if scheduled[FOOT] and feet.clock.last_touchdown(FOOT, time) > 0.0:
            touchdown = min(touchdown, time)
        scheduled[FOOT] &= time < touchdown + touched_s
        feet.update(time, behind, np.zeros((4, 3)), scheduled, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0))
        found.add(feet.events.states[FOOT])
        if time > touchdown and feet.events.states[FOOT] is ContactState.SWING:
            heights.append(feet.position[FOOT, 2])
            aims.append(feet.footholds[FOOT, :2].copy())
    assert state in found
    assert max(heights) > 0.9 * settings.swing.clearance_m
    np.testing.assert_allclose(np.array(aims) - points[FOOT, :2], 0.0, atol=0.02)


def test_the_displacement_of_feet_is_that_from_the_reference_posture_wherever_the_robot_is(robot: Robot) -> None:
    settings = LocomotionSettings()
    feet = Feet(robot, settings, gaits_of(robot, settings), Contacts.standing(robot, WholeBodySettings().scaled(robot)))
    x, y, yaw = 3.0, -2.0, 0.7
    points = np.array([x, y, 0.0]) + feet.legs.feet @ so3.exp(np.array([0.0, 0.0, yaw])).T
    feet.begin(0.0, points, None)
    assert feet.displacement(x, y, yaw) == pytest.approx(0.0, abs=1e-12)
    assert feet.displacement(x + 0.03, y - 0.04, yaw) == pytest.approx(0.05)
    points[FOOT] += [0.02, -0.01, 0.0]
    feet.begin(0.0, points, None)
    assert feet.displacement(x, y, yaw) == pytest.approx(math.hypot(0.02, 0.01))
