"""Footholds: the pendulum that they are derived from, turns, reach, and the horizon."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, strategies as st

from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.command import VelocityRamp
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner, FootholdSettings
from lgmpc.locomotion.gait import quadruped_gaits
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot import Robot
from lgmpc.timegrid import TimeGrid
from tests.support.samples import solo8

TROT = quadruped_gaits()["trot"]
speed = st.floats(-3.0, 3.0)


def pendulum(position: float, velocity: float, height: float, duration: float) -> tuple[float, float]:
    """Linear inverted pendulum about 0 after ``duration``."""
    w = math.sqrt(9.81 / height)
    c, s = math.cosh(w * duration), math.sinh(w * duration)
    return position * c + velocity * s / w, position * w * s + velocity * c


def test_legs_are_measured_in_the_reference_posture(solo12: Robot, legs: LegGeometry) -> None:
    assert legs.height == pytest.approx(0.209, abs=1e-3)
    np.testing.assert_allclose(
        legs.feet[:, :2], [[0.195, 0.169], [0.195, -0.169], [-0.195, 0.169], [-0.195, -0.169]], atol=1e-3
    )
    np.testing.assert_allclose(legs.hips[0, :2], [0.1946, 0.1014], atol=1e-3)


@pytest.mark.parametrize("knees", [(-2.8, 2.8), (-2.8, -0.9), (0.4, 2.8)])
def test_a_leg_is_as_long_as_the_range_of_its_knee_allows(solo12: Robot, knees: tuple[float, float]) -> None:
    model, data = solo12.model.copy(), solo12.create_data()
    at = model.joints[model.getJointId("FL_KFE")].idx_q
    model.lowerPositionLimit[at], model.upperPositionLimit[at] = knees
    length = LegGeometry.of(replace(solo12, model=model)).length[0]
    q, distances = solo12.q_reference.copy(), []
    for angle in np.linspace(*knees, 2001):
        q[at] = angle
        pin.framesForwardKinematics(model, data, q)
        foot = data.oMf[solo12.contact_ids[0]].translation
        distances.append(float(np.linalg.norm(foot - data.oMi[model.getJointId("FL_HFE")].translation)))
    assert length == pytest.approx(max(distances), abs=1e-6)


def test_at_rest_the_feet_stay_where_they_belong(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    for foot in range(4):
        place = planner.place(foot, BaseMotion(1.0, 2.0, 0.0, 0.0, 0.0), 0.1, TROT.stance_s)
        np.testing.assert_allclose(place, legs.feet[foot, :2] + [1.0, 2.0], atol=1e-12)


def test_a_robot_that_walks_is_above_the_middle_of_its_feet_one_that_stands_need_not_be(legs: LegGeometry) -> None:
    """HyQ's posture has its centre of mass 39 mm ahead of the middle: it trotted 23 mm beside its path."""
    shifted = replace(legs, feet=legs.feet + [-0.04, 0.015, 0.0])
    planner = FootholdPlanner(shifted)
    for stance, expected in ((TROT.stance_s, legs.feet), (math.inf, shifted.feet)):
        places = [planner.place(foot, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0), 0.1, stance) for foot in range(4)]
        np.testing.assert_allclose(places, expected[:, :2], atol=1e-12)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.1, 0.4))
def test_one_stance_takes_the_velocity_error_away(legs: LegGeometry, v: float, wanted: float, stance: float) -> None:
    planner = FootholdPlanner(replace(legs, radius=0.0), FootholdSettings(reach_share=1.0))
    motion = BaseMotion(0.0, 0.0, v, 0.0, 0.0, commanded_vx=wanted)
    # The mean foothold of a diagonal is the point that supports.
    support = np.mean([planner.place(foot, motion, 0.0, stance)[0] for foot in (0, 3)])
    if abs(support) < 0.12:  # within reach
        _, after = pendulum(-support, v, legs.height, stance)
        assert after == pytest.approx(wanted, abs=1e-9)


@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.1, 0.8))
def test_feet_are_shifted_no_further_than_friction_can_brake(
    legs: LegGeometry, vx: float, vy: float, friction: float
) -> None:
    """Supported at a distance d, a pendulum of height h decelerates by g d / h: at most by friction times g."""
    point = replace(legs, length=10.0 * legs.length, radius=0.0)
    planner = FootholdPlanner(point, FootholdSettings(side_share=-1.0))
    keeping = BaseMotion(0.0, 0.0, vx, vy, 0.0, commanded_vx=vx, commanded_vy=vy)
    stopping = [BaseMotion(0.0, 0.0, vx, vy, 0.0, friction=mu) for mu in (math.inf, friction)]
    neutral = planner.place(0, keeping, 0.0, TROT.stance_s)
    free, held = (np.subtract(planner.place(0, each, 0.0, TROT.stance_s), neutral) for each in stopping)
    assert np.linalg.norm(held) == pytest.approx(min(np.linalg.norm(free), friction * legs.height), abs=1e-9)
    assert held @ free == pytest.approx(np.linalg.norm(held) * np.linalg.norm(free), abs=1e-9)


def test_the_commanded_acceleration_needs_no_velocity_error(legs: LegGeometry) -> None:
    """A pendulum that is at its command gains within the stance what the command gains."""
    point = replace(legs, radius=0.0)
    planner = FootholdPlanner(point, FootholdSettings(reach_share=1.0))
    stance, remaining = 0.12, 0.05
    motion = BaseMotion(0.0, 0.0, 0.4, 0.0, 0.0, commanded_vx=0.4, ramp=VelocityRamp(1.0, 0.0, 10.0))
    touchdown = 0.4 * remaining  # where the centre of mass is predicted to be
    support = np.mean([planner.place(foot, motion, remaining, stance)[0] for foot in (0, 3)])
    _, after = pendulum(touchdown - support, 0.4 + remaining, legs.height, stance)
    assert after == pytest.approx(0.4 + remaining + stance, abs=1e-9)


def test_a_robot_that_lags_puts_its_feet_further_back_and_round_ones_too(legs: LegGeometry) -> None:
    settings = FootholdSettings(position_feedback=0.5)
    planner, motion = FootholdPlanner(legs, settings), BaseMotion(0.0, 0.0, 0.4, 0.0, 0.0, commanded_vx=0.4)
    place = planner.place(0, motion, 0.05, 0.12)
    lagging = planner.place(0, replace(motion, error_x=-0.01, error_y=0.004), 0.05, 0.12)
    np.testing.assert_allclose(np.subtract(lagging, place), [-0.005, 0.002], atol=1e-12)
    of_points = FootholdPlanner(replace(legs, radius=0.0), settings).place(0, motion, 0.05, 0.12)
    assert of_points[0] - place[0] == pytest.approx(legs.radius / legs.height * 0.4 * 0.06, rel=0.07)


def test_a_narrow_gait_steps_close_to_the_midline_and_ends_in_the_reference_posture(legs: LegGeometry) -> None:
    planner, motion = FootholdPlanner(legs), BaseMotion(1.0, 2.0, 0.0, 0.0, 0.0)
    for foot in range(4):
        _, y = planner.place(foot, motion, 0.1, 0.12, width=0.5)
        assert y == pytest.approx(2.0 + 0.5 * legs.feet[foot, 1])
        np.testing.assert_allclose(
            planner.place(foot, motion, 0.1, math.inf, width=0.5), np.array([1.0, 2.0]) + legs.feet[foot, :2]
        )


def test_standing_from_then_on_takes_the_capture_point(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    motion = BaseMotion(0.0, 0.0, 0.3, -0.2, 0.0)
    place = np.array(planner.place(0, motion, 0.0, math.inf)) - legs.feet[0, :2]
    np.testing.assert_allclose(place, np.array([0.3, -0.2]) * math.sqrt(legs.height / 9.81), atol=1e-12)


def test_footholds_turn_with_the_base(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    straight = BaseMotion(0.0, 0.0, 0.4, 0.1, 0.0, commanded_vx=0.4)
    for yaw in (0.5, -2.0, 3.0):
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, -s], [s, c]])
        vx, vy = turn @ [0.4, 0.1]
        wx, wy = turn @ [0.4, 0.0]
        turned = BaseMotion(0.0, 0.0, vx, vy, yaw, commanded_vx=wx, commanded_vy=wy)
        for foot in range(4):
            place = turn @ planner.place(foot, straight, 0.1, 0.2)
            np.testing.assert_allclose(planner.place(foot, turned, 0.1, 0.2), place, atol=1e-12)


def test_footholds_move_with_the_whole_motion(legs: LegGeometry) -> None:
    """Turned and shifted: a robot that turns, lags, accelerates and is pulled, with all footholds within reach."""

    def motion(x: float, y: float, yaw: float) -> BaseMotion:
        c, s = math.cos(yaw), math.sin(yaw)
        (vx, vy), (wx, wy), (ex, ey), (ax, ay), (lx, ly), (px, py) = (
            (c * a - s * b, s * a + c * b)
            for a, b in ((0.4, 0.1), (0.5, -0.2), (-0.01, 0.02), (0.3, -0.6), (0.2, 0.4), (0.05, -0.03))
        )
        return BaseMotion(
            x + px, y + py, vx, vy, yaw + 0.2, yaw_rate=0.9, commanded_vx=wx, commanded_vy=wy, error_x=ex,
            error_y=ey, ramp=VelocityRamp(ax, ay, 0.3), load_x=lx, load_y=ly,
        )  # fmt: skip

    planner = FootholdPlanner(
        replace(legs, length=10.0 * legs.length), FootholdSettings(side_share=-1.0, position_feedback=0.5)
    )
    c, s = math.cos(0.7), math.sin(0.7)
    for foot in range(4):
        for stance in (0.12, math.inf):
            place = planner.place(foot, motion(0.0, 0.0, 0.0), 0.1, stance)
            moved = planner.place(foot, motion(3.0, -2.0, 0.7), 0.1, stance)
            np.testing.assert_allclose(moved, [3.0, -2.0] + np.array([[c, -s], [s, c]]) @ place, atol=1e-12)


def test_a_turn_in_place_puts_the_feet_ahead_by_half_a_stance(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.3, yaw_rate=2.0)
    x, y = planner.place(0, motion, 0.05, 0.2)
    angle = 0.3 + 2.0 * (0.05 + 0.1)
    fx, fy, _ = legs.feet[0]
    assert math.hypot(x, y) == pytest.approx(math.hypot(fx, fy))
    assert math.atan2(y, x) == pytest.approx(math.atan2(fy, fx) + angle)


def test_a_turn_while_moving_shifts_the_support_outward(legs: LegGeometry) -> None:
    v, omega, stance = 0.5, 1.0, 0.01
    motion = BaseMotion(0.0, 0.0, v, 0.0, 0.0, yaw_rate=omega, commanded_vx=v)
    centre = np.mean([FootholdPlanner(legs).place(foot, motion, 0.0, stance) for foot in range(4)], axis=0)
    # Support y moves so that (0 - y) g / h is the centripetal acceleration omega v, to the left.
    assert -centre[1] * 9.81 / legs.height == pytest.approx(omega * v, rel=0.01)


@given(
    speed,
    speed,
    speed,
    st.floats(-3.0, 3.0),
    st.floats(0.0, 0.2),
    st.integers(0, 3),
    st.booleans(),
    st.floats(-0.5, 0.5),
    st.floats(-0.05, 0.05),
)
def test_footholds_are_within_reach_and_on_their_side(
    legs: LegGeometry,
    vx: float,
    vy: float,
    rate: float,
    yaw: float,
    remaining: float,
    foot: int,
    stops: bool,
    share: float,
    height: float,
) -> None:
    planner = FootholdPlanner(legs, FootholdSettings(side_share=share))
    motion = BaseMotion(0.3, -0.2, vx, vy, yaw, yaw_rate=rate, height=height)
    x, y = planner.place(foot, motion, remaining, math.inf if stops else 0.18)
    c, s = math.cos(yaw + rate * remaining), math.sin(yaw + rate * remaining)
    dx, dy = x - 0.3 - vx * remaining, y + 0.2 - vy * remaining
    local = np.array([c * dx + s * dy, -s * dx + c * dy])
    hip = legs.hips[foot]
    drop = hip[2] + legs.height + height
    distance = math.hypot(*(local - hip[:2]), drop)
    assert distance <= planner.reach_share * legs.length[foot] + 1e-9
    width = legs.feet[foot, 1]
    assert local[1] * math.copysign(1.0, width) >= share * abs(width) - 1e-9


def test_a_foothold_keeps_its_distance_from_another_foot(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
    alone = planner.place(0, motion, 0.0, 0.2)
    near = planner.place(0, motion, 0.0, 0.2, [(alone[0] + 0.01, alone[1])])
    assert math.dist(near, (alone[0] + 0.01, alone[1])) == pytest.approx(0.3 * legs.length[0])
    same = planner.place(0, motion, 0.0, 0.2, [alone])
    assert math.dist(same, alone) == pytest.approx(0.3 * legs.length[0])
    outward = legs.feet[0, :2] / math.hypot(*legs.feet[0, :2])  # the way from the base to the foot
    assert (np.subtract(same, alone) @ outward) == pytest.approx(0.3 * legs.length[0])
    far = planner.place(0, motion, 0.0, 0.2, [(alone[0] + 0.2, alone[1])])
    assert far == alone


def test_footholds_at_the_legs_reach_are_clear_of_the_other_feet_too(legs: LegGeometry) -> None:
    """Of 10,000 random draws 120 were too near, down to 7 mm of 97, when the reach was applied after the distance."""
    planner, rng = FootholdPlanner(legs), np.random.default_rng(0)
    for _ in range(1000):
        away, heading, yaw = rng.uniform(-math.pi, math.pi, 3)
        motion = BaseMotion(1.0, -2.0, math.cos(away), math.sin(away), yaw, commanded_vx=0.1 * math.cos(heading))
        c, s, foot = math.cos(yaw), math.sin(yaw), int(rng.integers(4))
        places = np.array(planner.feet) + rng.uniform((-0.12, -0.05), (0.12, 0.05), (4, 2))
        others = [(1.0 + c * x - s * y, -2.0 + s * x + c * y) for x, y in np.delete(places, foot, axis=0)]
        place = planner.place(foot, motion, rng.uniform(0.0, 0.15), rng.uniform(0.1, 0.2), others)
        assert min(math.dist(place, other) for other in others) > planner.spacing - 1e-6


def test_the_horizon_holds_a_foot_until_its_next_lift_off(legs: LegGeometry) -> None:
    ground = TerrainBelief(4, legs.height)
    ground.begin(np.array([[x, y, 0.1] for x, y, _ in legs.feet]))
    planner = FootholdPlanner(legs, ground=ground)
    clock = GaitClock(TROT)
    horizon = TimeGrid(0.02, 20, 0.02)
    t = horizon.start
    clock.advance(t)
    motion = BaseMotion(0.0, 0.0, 0.5, 0.0, 0.0, commanded_vx=0.5)
    contacts = np.arange(12.0).reshape(4, 3)
    points = np.zeros((20, 4, 3))
    planner.horizon(clock, motion, horizon, contacts, points)
    flags = np.zeros((20, 4), dtype=np.bool_)
    clock.horizon(horizon, flags)
    for foot in range(4):
        liftoffs = [k for k in range(1, 20) if flags[k - 1, foot] and not flags[k, foot]]
        first = liftoffs[0]
        np.testing.assert_array_equal(points[:first, foot], np.tile(contacts[foot], (first, 1)))
        swing = next(s for s in clock.swings(foot, t, 1.0) if s.liftoff > t)
        expected = planner.place_later(foot, motion, swing.touchdown - t, TROT.stance_s)
        second = liftoffs[1] if len(liftoffs) > 1 else 20
        np.testing.assert_allclose(points[first:second, foot], np.tile([*expected, 0.1], (second - first, 1)))


def test_the_horizon_places_the_feet_that_would_lift_off_now(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    clock = GaitClock(TROT)
    motion = BaseMotion(0.0, 0.0, 1.0, 0.5, 0.0)
    contacts = legs.feet
    points = np.zeros((5, 4, 3))
    planner.horizon(clock, motion, TimeGrid(0.02, 5), contacts, points, [True] * 4)
    lifted = np.flatnonzero(~clock.flags(0.0)).tolist()
    assert len(lifted) == 2
    for foot in range(4):
        expected = planner.place(foot, motion, TROT.swing_s, TROT.stance_s) if foot in lifted else contacts[foot, :2]
        np.testing.assert_allclose(points[:, foot, :2], np.tile(expected, (5, 1)), atol=1e-12)
    planner.horizon(clock, motion, TimeGrid(0.02, 5), contacts, points, clock.flags(0.0).tolist())  # in the air already
    np.testing.assert_array_equal(points, np.tile(contacts, (5, 1, 1)))


def test_later_swings_are_placed_for_the_commanded_velocity(legs: LegGeometry) -> None:
    planner = FootholdPlanner(legs)
    motion = BaseMotion(0.0, 0.0, 0.5, 0.2, 0.0, commanded_vx=0.5)
    steady = replace(motion, vy=0.0)
    near = planner.place_later(0, motion, 0.0, 0.18)
    np.testing.assert_allclose(near, planner.place(0, motion, 0.0, 0.18), atol=1e-12)
    far, reference = planner.place_later(0, motion, 3.0, 0.18), planner.place_later(0, steady, 3.0, 0.18)
    assert far[0] == pytest.approx(reference[0])
    assert far[1] - reference[1] == pytest.approx(0.2 * planner.settings.error_decay_s, rel=1e-3)


def test_legs_without_abduction_are_measured_from_their_first_joint() -> None:
    """Two links of 160 mm from the thigh's joint."""
    robot = solo8()
    legs, data = LegGeometry.of(robot), robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    com = pin.centerOfMass(robot.model, robot.create_data(), robot.q_reference)
    for foot, name in enumerate(("FL", "FR", "HL", "HR")):
        hip = data.oMi[robot.model.getJointId(f"{name}_HFE")].translation
        np.testing.assert_allclose(legs.hips[foot], hip - com, atol=1e-9)
    np.testing.assert_allclose(legs.length, 0.32, atol=5e-3)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_planar_legs_keep_the_line_of_support_of_legs_that_move_sideways(yaw: float) -> None:
    """The line through both feet of a diagonal, in the air at the same time, has the same distance from any point."""
    legs = LegGeometry.of(solo8())
    free = FootholdPlanner(replace(legs, normals=np.zeros((4, 3))), FootholdSettings(reach_share=1.0))
    planar = FootholdPlanner(legs, FootholdSettings(reach_share=1.0))
    c, s = math.cos(yaw), math.sin(yaw)
    motion = BaseMotion(0.1, 0.2, 0.3 * c - 0.06 * s, 0.3 * s + 0.06 * c, yaw, 0.0, 0.3 * c, 0.3 * s)
    for pair in ((0, 3), (1, 2)):
        wanted, found = (
            np.array([planner.place(foot, motion, 0.05, TROT.stance_s) for foot in pair]) for planner in (free, planar)
        )
        assert np.abs(wanted - found).max() > 0.005
        along = (wanted[1] - wanted[0]) / np.linalg.norm(wanted[1] - wanted[0])
        across = np.array([-along[1], along[0]])
        np.testing.assert_allclose((found - wanted) @ across, 0.0, atol=1e-3)
        com = planar.expected(motion, 0.05, present=True)
        for foot, place in zip(pair, found, strict=True):
            left = -s * (place[0] - com[0]) + c * (place[1] - com[1])
            assert left == pytest.approx(legs.feet[foot, 1], abs=1e-9)


def test_the_plane_of_a_planar_leg_tilts_with_the_base() -> None:
    """Where it meets the ground is where the leg of the rolled robot puts its foot when it is stretched that far."""
    robot, roll = solo8(), 0.06
    legs, data = LegGeometry.of(robot), robot.create_data()
    q = robot.q_reference.copy()
    q[3:7] = pin.Quaternion(pin.exp3(np.array([roll, 0.0, 0.0]))).coeffs()
    com = pin.centerOfMass(robot.model, data, q).copy()
    pin.framesForwardKinematics(robot.model, data, q)
    planner = FootholdPlanner(legs, FootholdSettings(reach_share=1.0))
    motion = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0, rise_left=math.sin(roll))
    for foot, frame in enumerate(robot.contact_ids):
        place = np.array([*planner.place(foot, motion, 0.0, TROT.stance_s), -legs.height])
        normal = data.oMi[1].rotation[:, 1]
        contact = data.oMf[frame].translation - legs.radius * data.oMi[1].rotation[:, 2] - com
        assert normal @ (place - contact) == pytest.approx(0.0, abs=1e-3)  # second order in the roll
        assert abs(place[1] - contact[1]) < 0.02
