"""Swing trajectories: where they begin and end, smooth under moving targets, straight down when late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.locomotion.swing import SwingSettings, SwingTrajectory

coordinate = st.floats(-0.3, 0.3)
duration = st.floats(0.08, 0.5)
points = st.tuples(coordinate, coordinate, st.floats(-0.03, 0.03)).map(np.array)
level = st.tuples(coordinate, coordinate, st.just(0.0)).map(np.array)


def sample(swing: SwingTrajectory, t: float) -> np.ndarray:
    """(3, 3) position, velocity, acceleration."""
    rows = np.full((3, 3), np.nan)
    swing.sample(t, *rows)
    return rows


@given(points, points, st.tuples(coordinate, coordinate, st.floats(0.0, 0.3)).map(np.array), duration)
def test_a_swing_begins_where_the_foot_is_and_ends_at_its_target(
    begin: np.ndarray, target: np.ndarray, velocity: np.ndarray, length: float
) -> None:
    swing = SwingTrajectory()
    swing.lift_off(1.0, 1.0 + length, begin, velocity, target)
    position, speed, acceleration = sample(swing, 1.0)
    np.testing.assert_allclose(position, begin, atol=1e-12)
    np.testing.assert_allclose(speed, velocity, atol=1e-12)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-9)
    position, speed, _ = sample(swing, 1.0 + length - 1e-9)
    np.testing.assert_allclose(position, target, atol=1e-8)
    np.testing.assert_allclose(speed, [0.0, 0.0, -swing.touchdown_speed], atol=1e-5)
    apex = sample(swing, 1.0 + swing.settings.apex_share * length)
    assert apex[0, 2] == pytest.approx(max(begin[2], target[2]) + swing.clearance)
    assert apex[1, 2] == pytest.approx(0.0, abs=1e-9)


@given(level, level, duration)
def test_the_foot_rises_to_the_apex_and_then_falls(begin: np.ndarray, target: np.ndarray, length: float) -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, length, begin, np.zeros(3), target)
    heights = np.array([sample(swing, t)[0, 2] for t in np.linspace(0.0, length, 201)])
    top = int(np.argmax(heights))
    assert (np.diff(heights[: top + 1]) >= -1e-12).all()
    assert (np.diff(heights[top:]) <= 1e-12).all()
    assert heights.max() <= swing.clearance + 1e-9
    assert heights.min() >= -1e-9


@given(level, st.floats(0.005, 0.1), level, duration)
def test_a_foot_in_the_air_is_put_down_without_rising(
    begin: np.ndarray, height: float, target: np.ndarray, length: float
) -> None:
    swing, above = SwingTrajectory(), begin + [0.0, 0.0, height]
    swing.put_down(1.0, 1.0 + length, above)
    assert swing.retarget(1.0, target)
    np.testing.assert_allclose(sample(swing, 1.0)[:2], [above, np.zeros(3)], atol=1e-12)
    heights = np.array([sample(swing, t)[0, 2] for t in np.linspace(1.0, 1.0 + length - 1e-9, 201)])
    assert (np.diff(heights) <= 1e-12).all()
    position, speed, _ = sample(swing, 1.0 + length - 1e-9)
    np.testing.assert_allclose(position, target, atol=1e-7)
    assert speed[2] == pytest.approx(-swing.touchdown_speed, abs=1e-5)


@given(points, st.lists(points, min_size=1, max_size=6), duration, st.floats(0.0, 0.05))
def test_a_moving_target_leaves_the_path_twice_differentiable(
    begin: np.ndarray, targets: list[np.ndarray], length: float, offset: float
) -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, length, begin, np.zeros(3), targets[0])
    for t, target in zip(np.linspace(offset * length, 0.75 * length, len(targets)), targets, strict=True):
        before = sample(swing, t)
        assert swing.retarget(t, target)
        after = sample(swing, t)
        np.testing.assert_allclose(after[0], before[0], atol=1e-10)
        np.testing.assert_allclose(after[1], before[1], atol=1e-8)
        np.testing.assert_allclose(after[2], before[2], atol=1e-6 / length**2)
    end = sample(swing, length - 1e-9)
    np.testing.assert_allclose(end[0], targets[-1], atol=1e-7)


@given(level, level, duration)
def test_velocity_and_acceleration_are_the_derivatives(begin: np.ndarray, target: np.ndarray, length: float) -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, length, begin, np.array([0.1, -0.1, 0.05]), target)
    h = 1e-5 * length
    for t in np.array([0.1, 0.3, 0.6, 0.9]) * length:
        below, here, above = sample(swing, t - h), sample(swing, t), sample(swing, t + h)
        np.testing.assert_allclose((above[:2] - below[:2]) / (2 * h), here[1:], rtol=1e-5, atol=1e-5 / length**2)


def largest_acceleration(swing: SwingTrajectory, begin: float) -> float:
    """Of a foot in the plane, m/s2."""
    times = np.linspace(begin, swing.touchdown, 400, endpoint=False)
    return max(float(np.hypot(*sample(swing, t)[2, :2])) for t in times)


@given(level, level, duration, st.floats(50.0, 200.0))
def test_a_step_too_long_for_its_time_takes_longer(
    begin: np.ndarray, target: np.ndarray, length: float, limit: float
) -> None:
    settings = SwingSettings(acceleration_m_s2=limit, longest_share=1.5)
    swing, scheduled, latest = SwingTrajectory(settings), 1.0 + length, 1.0 + 1.4 * length
    swing.lift_off(1.0, scheduled, begin, np.zeros(3), target, latest)
    assert scheduled <= swing.touchdown <= latest
    peak = largest_acceleration(swing, 1.0)
    if swing.touchdown < latest:
        assert peak <= limit * (1.0 + 1e-6)
    if swing.touchdown > scheduled:  # and no longer than it has to
        assert peak >= limit * (1.0 - 1e-3)
    np.testing.assert_allclose(sample(swing, swing.touchdown - 1e-9)[0], target, atol=1e-8)


def test_a_swing_lasts_no_longer_than_its_share_and_as_scheduled_where_nothing_else_is_given() -> None:
    far = np.array([0.9, 0.0, 0.0])
    swing = SwingTrajectory(SwingSettings(longest_share=1.3))
    swing.lift_off(0.0, 0.1, np.zeros(3), np.zeros(3), far, latest=1.0)
    assert swing.touchdown == pytest.approx(0.13)
    swing.lift_off(0.0, 0.1, np.zeros(3), np.zeros(3), far)
    assert swing.touchdown == 0.1


def test_a_target_that_moves_away_puts_the_touchdown_off_and_one_that_returns_does_not_bring_it_back() -> None:
    swing = SwingTrajectory(SwingSettings(longest_share=1.5))
    swing.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]), latest=0.2)
    assert swing.touchdown == 0.12
    before = sample(swing, 0.03)
    assert swing.retarget(0.03, np.array([0.4, 0.1, 0.0]))
    np.testing.assert_allclose(sample(swing, 0.03), before, atol=1e-9)
    later = swing.touchdown
    assert later > 0.12
    assert swing.retarget(0.05, np.array([0.1, 0.0, 0.0]))
    assert swing.touchdown == later
    position, velocity, _ = sample(swing, later - 1e-9)
    np.testing.assert_allclose(position, [0.1, 0.0, 0.0], atol=1e-7)
    assert velocity[2] == pytest.approx(-swing.touchdown_speed, abs=1e-5)


def test_a_target_that_stays_leaves_the_path() -> None:
    begin, target = np.array([0.0, 0.1, 0.0]), np.array([0.2, 0.1, 0.0])
    still, moved = SwingTrajectory(), SwingTrajectory()
    for swing in (still, moved):
        swing.lift_off(0.0, 0.2, begin, np.zeros(3), target)
    moved.retarget(0.05, target + 0.1)
    moved.retarget(0.05, target)  # planned anew from the state on the old path
    np.testing.assert_allclose(sample(moved, 0.12), sample(still, 0.12), atol=1e-9)


@given(level, duration, st.floats(0.1, 0.7), st.floats(0.0, 6.3))
def test_a_target_that_moves_by_the_leeway_changes_the_acceleration_by_its_limit(
    target: np.ndarray, length: float, share: float, angle: float
) -> None:
    limit, begin = 90.0, share * length
    swing, moved = SwingTrajectory(SwingSettings(acceleration_m_s2=limit)), SwingTrajectory(SwingSettings())
    for each in (swing, moved):
        each.lift_off(0.0, length, np.zeros(3), np.zeros(3), target)
    way = swing.leeway(begin) * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert moved.retarget(begin, target + way)
    times = np.linspace(begin, length - 1e-9, 400)
    changes = [float(np.hypot(*(sample(moved, t) - sample(swing, t))[2, :2])) for t in times]
    assert max(changes) == pytest.approx(limit, rel=1e-3)
    assert swing.leeway(length) == 0.0


def test_near_the_touchdown_the_target_is_frozen() -> None:
    swing = SwingTrajectory(SwingSettings(freeze_share=0.7))
    swing.lift_off(0.0, 0.2, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    assert not swing.retarget(0.15, np.array([0.3, 0.0, 0.0]))
    assert swing.target == (0.1, 0.0, 0.0)
    assert swing.retarget(0.13, np.array([0.12, 0.0, 0.0]))


def test_a_late_foot_descends_at_constant_speed_to_the_search_depth() -> None:
    s = SwingSettings(touchdown_speed_m_s=0.2, search_depth_m=0.03, clearance_m=0.05)
    swing = SwingTrajectory(s)
    target = np.array([0.1, 0.05, 0.01])
    swing.lift_off(0.0, 0.2, np.zeros(3), np.zeros(3), target)
    position, velocity, acceleration = sample(swing, 0.3)
    np.testing.assert_allclose(position, [0.1, 0.05, 0.01 - 0.02])
    np.testing.assert_allclose(velocity, [0.0, 0.0, -0.2])
    np.testing.assert_allclose(acceleration, 0.0)
    position, velocity, _ = sample(swing, 1.0)
    np.testing.assert_allclose(position, [0.1, 0.05, 0.01 - 0.03])
    np.testing.assert_allclose(velocity, 0.0)


def test_soles_land_slower_than_points_unless_set() -> None:
    speeds = []
    for settings in (SwingSettings(), SwingSettings(touchdown_speed_m_s=0.3)):
        for sole in (False, True):
            swing = SwingTrajectory(settings, 0.9, sole)
            swing.lift_off(0.0, 0.2, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
            speeds.append(-sample(swing, 0.2 - 1e-9)[1][2])
    assert speeds == pytest.approx([0.4, 0.1, 0.3, 0.3], abs=1e-5)


def test_a_lost_foot_searches_from_where_it_is() -> None:
    swing = SwingTrajectory()
    swing.search(2.0, np.array([0.1, 0.2, 0.005]))
    position, velocity, _ = sample(swing, 2.05)
    np.testing.assert_allclose(position, [0.1, 0.2, 0.005 - 0.05 * swing.touchdown_speed])
    assert velocity[2] == -swing.touchdown_speed
    assert not swing.retarget(2.1, np.zeros(3))


@pytest.mark.parametrize(
    ("sole", "settings", "speed"), [(False, {}, 0.4), (True, {}, 0.4), (True, {"search_speed_m_s": 0.2}, 0.2)]
)
def test_late_soles_search_faster_than_they_land(sole: bool, settings: dict[str, float], speed: float) -> None:
    swing = SwingTrajectory(SwingSettings(**settings), 0.9, sole)
    swing.lift_off(0.0, 0.3, np.zeros(3), np.zeros(3), np.zeros(3))
    position, velocity, _ = sample(swing, 0.35)
    assert (position[2], velocity[2]) == pytest.approx((-0.05 * speed, -speed))


def test_clearance_and_search_depth_are_shares_of_the_height() -> None:
    for height in (0.21, 0.48):
        swing = SwingTrajectory(height=height)
        assert swing.clearance == pytest.approx(height / 7.0, abs=5e-4)
        swing.lift_off(0.0, 0.2, np.zeros(3), np.zeros(3), np.zeros(3))
        assert sample(swing, 9.0)[0, 2] == pytest.approx(-0.5 * height)


def test_a_hastened_foot_falls_freely_from_then_on() -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, 0.2, np.zeros(3), np.zeros(3), np.zeros(3))
    speed = swing.touchdown_speed
    swing.hasten(0.21)
    swing.hasten(0.22)  # has begun to fall
    position, velocity, _ = sample(swing, 0.25)
    assert position[2] == pytest.approx(-0.05 * speed - 0.5 * 9.81 * 0.04**2)
    assert velocity[2] == pytest.approx(-speed - 9.81 * 0.04)
    swing.lift_off(1.0, 1.2, np.zeros(3), np.zeros(3), np.zeros(3))
    assert sample(swing, 1.25)[1, 2] == -swing.touchdown_speed


def test_a_foot_held_back_by_an_obstacle_rises_before_it_moves_ahead_again() -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    at = np.array([0.03, 0.0, 0.02])
    wanted, velocity, _ = sample(swing, 0.06)
    assert not swing.blocked(0.06, wanted, np.zeros(3), wanted, velocity)  # not behind its path
    assert not swing.blocked(0.06, at, velocity, wanted, velocity)  # it catches up
    assert swing.blocked(0.06, at, np.zeros(3), wanted, velocity)
    long = SwingTrajectory()
    long.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), np.array([0.4, 0.0, 0.0]))  # motors are too weak for it
    assert not long.blocked(0.06, at, np.zeros(3), *sample(long, 0.06)[:2])
    swing.roughness = 0.05
    swing.step_over(0.06, at)
    rows = np.array([sample(swing, t)[0] for t in np.linspace(0.06, swing.touchdown - 1e-9, 200)])
    np.testing.assert_allclose(rows[0], at, atol=1e-12)
    np.testing.assert_allclose(rows[-1], swing.target, atol=1e-6)
    assert rows[:, 2].max() == pytest.approx(0.02 + swing.clearance + 0.05, abs=1e-4)
    over = np.flatnonzero(rows[:, 2] > 0.05)[0]
    assert (rows[:over, 0] == 0.03).all()


def test_a_late_foot_that_something_in_front_of_it_holds_searches_where_it_is() -> None:
    swing = SwingTrajectory()
    swing.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    at = np.array([0.06, 0.0, 0.025])
    assert not swing.held(np.array([0.095, 0.0, 0.01]), np.zeros(3))  # it is there
    assert not swing.held(at, np.array([0.5, 0.0, 0.0]))  # it lags, and catches up
    assert swing.held(at, np.zeros(3))
    swing.search(0.13, at)
    assert not swing.held(at, np.zeros(3))
    assert not swing.held(np.zeros(3), np.zeros(3))  # searches


@pytest.mark.parametrize("moves", [False, True], ids=["from lift-off", "by a target that moves"])
def test_on_rough_ground_a_step_that_needs_all_of_its_time_is_not_put_off(moves: bool) -> None:
    """What may be a riser ahead is a precaution; a push is not."""
    near, far, paths = np.array([0.05, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]), {}
    for name, target in (("near", near), ("far", far)):
        swing = SwingTrajectory()
        swing.roughness = 0.02
        swing.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), near if moves else target)
        assert swing.retarget(0.005, target)
        paths[name] = sample(swing, 0.025)[0, 0], sample(swing, 0.12 - 1e-9)[0]
        np.testing.assert_allclose(paths[name][1], target, atol=1e-6)
    assert paths["near"][0] == 0.0
    assert paths["far"][0] > 0.005


def test_a_foot_that_steps_over_an_obstacle_does_not_climb_without_end() -> None:
    """One that stays behind while it rises is left alone; no obstacle is higher than a third of the robot's height."""
    swing = SwingTrajectory(height=0.3)
    swing.lift_off(0.0, 0.12, np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    now, highest = 0.06, 0.0
    at, ahead = np.array([0.03, 0.0, 0.02]), np.array([1.0, 0.0, 0.0])
    for _ in range(6):
        swing.step_over(now, at)
        assert not swing.blocked(now + 0.02, at, np.zeros(3), at + 0.05 * ahead, ahead)
        rows = np.array([sample(swing, t)[0] for t in np.linspace(now, swing.touchdown, 50)])
        top = int(np.argmax(rows[:, 2]))
        at, now = rows[top], now + top / 49 * (swing.touchdown - now)
        assert swing.blocked(swing.touchdown - 1e-3, at, np.zeros(3), at + 0.05 * ahead, ahead)
        highest = max(highest, at[2])
    assert highest == pytest.approx(0.35 * 0.3 + swing.clearance, abs=1e-3)
