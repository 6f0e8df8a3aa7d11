"""Motions of the base and of feet, against properties that do not depend on their formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.errors import InputError
from lgmpc.lie import se3
from lgmpc.locomotion.sequence import GaitPhase, GaitSequence, QuadrupedFeet
from lgmpc.problems.footsteps import BaseLeap, BasePath, BaseProfile, Footsteps, SwingCurve

FEET = ("FL", "FR", "HL", "HR")
LEGS = QuadrupedFeet(*FEET)
START = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
ORIGIN = np.array([0.0, 0.0, 0.25])
PATH = BasePath.walking((0.3, -0.1), 0.5, 0.2, 1.4, 0.3)
LEAP = BaseLeap(np.array([0.3, 0.1, 0.05]), 0.4, 0.3, 0.6, 9.81)


@pytest.mark.parametrize("motion", [PATH, LEAP], ids=["path", "leap"])
def test_the_velocity_is_the_placement_s_derivative(motion: BaseProfile) -> None:
    times, h = np.linspace(motion.start + 0.01, motion.stop - 0.01, 23), 1e-6
    ahead, behind = motion.placements(times + h), motion.placements(times - h)
    measured = np.array([se3.log(se3.inverse(a) @ b) for a, b in zip(behind, ahead, strict=True)]) / (2 * h)
    np.testing.assert_allclose(motion.velocities(times), measured, atol=1e-8)


@pytest.mark.parametrize("motion", [PATH, LEAP], ids=["path", "leap"])
def test_a_base_is_at_rest_before_and_after(motion: BaseProfile) -> None:
    np.testing.assert_allclose(motion.placements([motion.start - 1.0, motion.start]), np.tile(np.eye(4), (2, 1, 1)))
    np.testing.assert_allclose(motion.placements(motion.stop + 1.0), motion.placements(motion.stop), atol=1e-15)
    assert not motion.velocities([motion.start - 1e-9, motion.stop + 1e-9]).any()


def test_a_path_s_length_is_speed_times_time_less_a_ramp() -> None:
    assert PATH.progress(PATH.stop) == pytest.approx(1.2 - 0.3, abs=1e-15)
    assert np.abs(np.diff(PATH.velocities(np.linspace(0.0, 2.0, 2001))[:, 0])).max() < 1.01 * 0.3 / 0.3 * 1e-3


def test_a_path_that_turns_is_an_arc() -> None:
    x, y = PATH.placements(np.linspace(0.0, 2.0, 50))[:, :2, 3].T
    radius = np.hypot(0.3, 0.1) / 0.5
    centre = np.array([0.1, 0.3]) / 0.5  # (0, 0) plus the velocity turned left, over the rate
    np.testing.assert_allclose(np.hypot(x - centre[0], y - centre[1]), radius, atol=1e-12)


def test_a_leap_is_ballistic_and_lands_at_its_goal() -> None:
    t = np.linspace(0.31, 0.59, 29)
    height = LEAP.placements(t)[:, 2, 3]
    np.testing.assert_allclose(np.diff(height, 2) / (t[1] - t[0]) ** 2, -9.81, rtol=1e-9)
    np.testing.assert_allclose(LEAP.placements(0.6)[:3, 3], [0.3, 0.1, 0.05], atol=1e-15)
    np.testing.assert_allclose(LEAP.placements(0.6)[:2, 0], [np.cos(0.4), np.sin(0.4)], atol=1e-15)


@given(st.floats(0.01, 0.2), st.floats(0.05, 1.0), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1))
def test_a_swing_is_smooth_and_has_its_apex_at_half_time(height: float, span: float, ahead: float, up: float) -> None:
    start = np.array([0.1, 0.2, 0.0])
    swing = SwingCurve(start, start + [ahead, -0.1, up], height, 1.0, 1.0 + span)
    s = np.linspace(-0.2, 1.2, 1401)
    points = swing.positions(1.0 + s * span)
    np.testing.assert_array_equal(points[s <= 0], np.broadcast_to(start, points[s <= 0].shape))
    np.testing.assert_allclose(points[s >= 1], np.broadcast_to(swing.end, points[s >= 1].shape), atol=1e-15)
    above = points[:, 2] - up * (10 * s**3 - 15 * s**4 + 6 * s**5).clip(0, 1) * ((s > 0) & (s < 1)) - up * (s >= 1)
    assert above.max() == pytest.approx(height, rel=1e-9) and s[above.argmax()] == pytest.approx(0.5)
    # Velocities and accelerations, per swing time, have no jumps: their differences vanish with the sampling.
    rate = np.gradient(points, s, axis=0)
    bend = np.gradient(rate, s, axis=0)
    size = height + abs(ahead) + abs(up) + 0.1
    assert np.abs(np.diff(rate, axis=0)).max() < 0.05 * size and np.abs(np.diff(bend, axis=0)).max() < 1.0 * size
    for end in (np.argmin(abs(s)), np.argmin(abs(s - 1))):
        assert np.abs(rate[end]).max() < 1e-3 * size and np.abs(bend[end]).max() < 0.4 * size


def gait(cycles: int = 3) -> GaitSequence:
    return (
        GaitSequence.stand(FEET, 0.2)
        + cycles * GaitSequence.trot(FEET, LEGS, 0.2, 0.05, 0.05)
        + GaitSequence.stand(FEET, 0.3)
    )


def test_footholds_of_a_straight_path() -> None:
    """Steady steps are as long as the base goes in a cycle; the last are where the standing robot has its feet."""
    whole = gait(4)
    path = BasePath.walking((0.4, 0.0), 0.0, 0.2, whole.duration - 0.3, 0.1)
    steps = Footsteps.plan(whole, path, START, ORIGIN)
    for foot, start in zip(steps.swings, START, strict=True):
        assert len(foot) == 4
        np.testing.assert_allclose(foot[-1].end - start, path.placements(path.stop)[:3, 3], atol=1e-14)
        np.testing.assert_allclose(foot[2].end - foot[1].end, [0.4 * 0.5, 0.0, 0.0], atol=1e-14)
    # In the middle of a stance in steady motion the foot is where it would be if it were fixed to the base.
    middle = 0.2 + 2 * 0.5 + 0.35  # FL: down at 0.2 after a cycle's start, up again at 0.5
    here = ORIGIN + path.placements(middle)[:3, 3] + START[0] - ORIGIN
    np.testing.assert_allclose(steps.positions(middle)[0], here, atol=1e-14)


def test_feet_move_in_swings_only_and_without_jumps() -> None:
    whole = gait()
    steps = Footsteps.plan(whole, BasePath.walking((0.3, 0.1), 0.6, 0.2, whole.duration - 0.3, 0.2), START, ORIGIN)
    times = np.linspace(0.0, whole.duration, 3001)
    feet, down = steps.positions(times), np.ones((len(times), 4), dtype=bool)
    for i, foot in enumerate(whole.feet):
        for swing in whole.swings(foot):
            down[(times > swing.liftoff) & (times < swing.touchdown), i] = False
    still = down[:-1] & down[1:]
    moved = np.linalg.norm(np.diff(feet, axis=0), axis=2)
    assert moved[still].max() < 1e-15 and moved.max() < 2e-3
    np.testing.assert_array_equal(feet[0], START)
    assert feet[..., 2].min() > -1e-15 and feet[..., 2].max() == pytest.approx(0.05, rel=1e-3)


def test_refusals() -> None:
    with pytest.raises(InputError, match="ramp"):
        BasePath.walking((0.3, 0.0), 0.0, 0.0, 1.0, 0.6)
    with pytest.raises(InputError, match="start, stop"):
        BasePath.walking((0.3, 0.0), 0.0, 1.0, 1.0, 0.0)
    with pytest.raises(InputError, match="velocity"):
        BasePath.walking((0.3, np.nan), 0.0, 0.0, 1.0, 0.0)
    with pytest.raises(InputError, match="displacement"):
        BaseLeap(np.zeros(2), 0.0, 0.0, 1.0, 9.81)
    with pytest.raises(InputError, match="in the air at an end"):
        Footsteps.plan(
            GaitSequence(FEET, (GaitPhase(duration_s=0.1, air=("FL",)), GaitPhase(duration_s=1.5))), PATH, START, ORIGIN
        )
    with pytest.raises(InputError, match="start"):
        Footsteps.plan(gait(), PATH, START[:3], ORIGIN)
