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
from lgmpc.wbc import Contacts, WholeBodySettings, standard_tasks

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
    for time in 1e-3 * np.arange(1, 700):
        feet.follow(time, MotionCommand(vx=0.1, gait="trot"))
        scheduled = feet.clock.flags(time)
        if scheduled[FOOT] and feet.clock.last_touchdown(FOOT, time) > 0.0:
            touchdown = min(touchdown, time)
        scheduled[FOOT] &= time < touchdown + touched_s
        measured = np.where(feet.stance[:, None], behind, feet.position)  # in the air they follow their paths
        feet.update(time, measured, feet.velocity, scheduled, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0))
        found.add(feet.events.states[FOOT])
        if time > touchdown and feet.events.states[FOOT] is ContactState.SWING:
            heights.append(feet.position[FOOT, 2])
            aims.append(feet.footholds[FOOT, :2].copy())
    assert state in found
    assert max(heights) > 0.9 * 0.03
    np.testing.assert_allclose(np.array(aims) - points[FOOT, :2], 0.0, atol=0.02)


def test_on_rough_ground_the_schedule_waits_for_feet_that_search_not_for_those_that_hang(robot: Robot) -> None:
    """A foot finds no ground: it follows its path down, or a stretched leg holds it above."""
    settings, liftoffs = LocomotionSettings(), {}
    for hangs in (False, True):
        feet = Feet(
            robot, settings, gaits_of(robot, settings), Contacts.standing(robot, WholeBodySettings().scaled(robot))
        )
        points = feet.legs.feet * [1.0, 1.0, 0.0]
        feet.begin(0.0, points, None)
        feet.roughness, touchdown = 0.02, math.inf
        for time in 1e-3 * np.arange(1, 700):
            feet.follow(time, MotionCommand(vx=0.1, gait="trot"))
            contacts = feet.clock.flags(time)
            if contacts[FOOT] and feet.clock.last_touchdown(FOOT, time) > 0.0:
                touchdown = min(touchdown, time)
            contacts[FOOT] &= time < touchdown
            measured, velocity = np.where(feet.stance[:, None], points, feet.position), feet.velocity.copy()
            if hangs and time >= touchdown:
                measured[FOOT, 2], velocity[FOOT] = 0.02, 0.0
            feet.update(time, measured, velocity, contacts, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0))
            if time > touchdown and feet.events.states[0] is ContactState.SWING:
                liftoffs[hangs] = time - touchdown
                break
    assert liftoffs[False] > 0.08  # the longest search
    assert liftoffs[True] < 0.03


def test_feet_swing_higher_after_a_touchdown_at_an_unexpected_height_and_after_an_obstacle(robot: Robot) -> None:
    settings = LocomotionSettings()
    apexes = {}
    for case in ("even", "block", "riser"):
        feet = Feet(
            robot, settings, gaits_of(robot, settings), Contacts.standing(robot, WholeBodySettings().scaled(robot))
        )
        points = feet.legs.feet * [1.0, 1.0, 0.0]
        feet.begin(0.0, points, None)
        heights = []
        for time in 1e-3 * np.arange(1, 560):
            feet.follow(time, MotionCommand(vx=0.5, gait="trot"))
            measured = np.where(feet.stance[:, None], points, feet.position)
            measured[:, :2] = feet.position[:, :2]
            velocity = feet.velocity.copy()
            contacts = feet.clock.flags(time)
            if case == "block" and 0.14 < time < 0.3:  # the first touchdown of this foot is 20 mm up
                contacts[FOOT] |= feet.velocity[FOOT, 2] < 0.0 and feet.position[FOOT, 2] < 0.02
                measured[FOOT, 2] = max(feet.position[FOOT, 2], 0.02)
            if case == "riser" and 0.03 < time < 0.3 and not feet.stance[FOOT]:
                measured[FOOT, 0], velocity[FOOT] = points[FOOT, 0] + 0.01, 0.0
            feet.update(time, measured, velocity, contacts, BaseMotion(0.5 * time, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5))
            heights.append(feet.position[FOOT, 2])
        apexes[case] = max(heights[320:])
    assert apexes["even"] == pytest.approx(0.03, abs=1e-3)
    assert apexes["block"] > 0.04
    assert apexes["riser"] > 0.06


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


@pytest.mark.parametrize("lasted", [0.002, 0.04])
def test_a_foot_that_bounces_off_is_pressed_down_until_it_falls_by_itself(robot: Robot, lasted: float) -> None:
    """After a contact of 2 ms, which may have been none, or of 40: then forces may still push it down further."""
    settings, weight = LocomotionSettings(), 9.81 * robot.mass
    contacts = Contacts.standing(robot, WholeBodySettings().scaled(robot))
    feet = Feet(robot, settings, gaits_of(robot, settings), contacts)
    swing = next(task for task in standard_tasks(robot, WholeBodySettings()) if task.name == "swing")
    loads = {}
    points, still = feet.legs.feet * [1.0, 1.0, 0.0], BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
    feet.begin(0.0, points, None)
    touchdown = np.inf
    for time in 1e-3 * np.arange(1, 350):
        feet.follow(time, MotionCommand(vx=0.1, gait="trot"))
        touching = feet.clock.flags(time)
        if touching[FOOT] and feet.clock.last_touchdown(FOOT, time) > 0.0:
            touchdown = min(touchdown, time)
        since = time - touchdown
        touching[FOOT] &= not lasted - 1e-9 <= since < lasted + 0.015
        falling = np.zeros((4, 3))
        falling[FOOT, 2] = -0.2 if since > lasted + 0.01 else 0.0
        feet.update(time, np.where(feet.stance[:, None], points, feet.position), falling, touching, still)
        feet.write_contacts(time, swing)
        loads[round(since, 3)] = contacts.lowest_normal[FOOT], contacts.highest_normal[FOOT]
    press, most = 0.1 * weight, 24.0 * robot.mass

    def bounds(since: float, share: float) -> object:
        opened = most * min((lasted + since) / settings.contacts.ramp_s, 1.0)
        return pytest.approx((share * press, share * press if lasted < 0.003 else opened), rel=1e-3)

    assert loads[lasted + 0.002] == pytest.approx((0.04 * robot.mass, most * min((lasted + 0.002) / 0.025, 1.0)))
    assert loads[lasted + 0.006] == bounds(0.006, 1.0)
    assert loads[lasted + 0.013] == bounds(0.013, 0.5)  # at half of the speed
