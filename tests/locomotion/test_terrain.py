"""The belief of the ground against planes that footholds lie on exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lgmpc.locomotion import TerrainBelief, TerrainBeliefSettings

FEET = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])
STANDING = [True] * 4


def on_plane(points: np.ndarray, slope: tuple[float, float], height: float = 0.0) -> np.ndarray:
    return np.column_stack([points, height + points @ slope])


def believed(slope: tuple[float, float], height: float = 0.0, at: tuple[float, float] = (0.0, 0.0)) -> TerrainBelief:
    belief = TerrainBelief(4, 0.24)
    belief.begin(on_plane(FEET + at, slope, height))
    return belief


@pytest.mark.parametrize("at", [(0.0, 0.0), (30.0, -7.0)])
@pytest.mark.parametrize("slope", [(0.2, -0.1), (-0.3, 0.0), (0.0, 0.4)])
def test_a_plane_under_all_feet_is_known_at_once(slope: tuple[float, float], at: tuple[float, float]) -> None:
    belief = believed(slope, 0.7, at)
    assert not belief.level
    np.testing.assert_allclose(belief.slope, slope, rtol=1e-5)
    normal = np.array([-slope[0], -slope[1], 1.0])
    np.testing.assert_allclose(belief.normal, normal / np.linalg.norm(normal), atol=1e-5)
    assert belief.plane_at(at[0] + 0.5, at[1] - 0.3) == pytest.approx(
        0.7 + (at[0] + 0.5) * slope[0] + (at[1] - 0.3) * slope[1], abs=1e-5
    )
    assert belief.carried(1e-5).all()


@pytest.mark.parametrize("height", [0.0, -1.0, 3.7])
def test_footholds_that_differ_by_millimetres_are_level_exactly(height: float) -> None:
    belief, rng = TerrainBelief(4, 0.24), np.random.default_rng(0)
    points = on_plane(FEET, (0.0, 0.0), height)
    points[:, 2] += 1e-3 * rng.uniform(-1.0, 1.0, 4)
    belief.begin(points)
    assert belief.level and belief.slope == (0.0, 0.0) and belief.normal.tolist() == [0.0, 0.0, 1.0]
    assert belief.plane_at(5.0, 5.0) == pytest.approx(points[:, 2].mean(), abs=1e-15)


def test_between_level_and_twice_that_tilt_the_slope_counts_in_part() -> None:
    flat = math.tan(math.radians(TerrainBeliefSettings().level_deg))
    slopes = [believed((k * 0.1 * flat, 0.0)).slope[0] for k in range(31)]
    assert slopes[:11] == [0.0] * 11
    assert (np.diff(slopes[10:]) > 0.0).all() and max(np.diff(slopes)) < 0.31 * flat  # without a jump
    assert slopes[20:] == pytest.approx([k * 0.1 * flat for k in range(20, 31)], rel=1e-5)


def test_the_slope_follows_within_the_filters_time_and_the_height_at_once() -> None:
    belief = believed((0.0, 0.0))
    time_constant = belief.settings.filter_share * math.sqrt(0.24 / 9.81)
    points = on_plane(FEET, (0.3, 0.0), 0.1)
    for _ in range(round(time_constant / 1e-3)):
        belief.update(1e-3, points, STANDING)
    assert belief.slope[0] == pytest.approx(0.3 * (1.0 - math.exp(-1.0)), rel=2e-2)
    assert belief.plane_at(0.0, 0.0) == pytest.approx(0.1, abs=1e-12)


def test_the_slope_follows_blocks_slowly_and_a_plane_after_a_stride() -> None:
    belief, fall_time = believed((0.0, 0.0)), math.sqrt(0.24 / 9.81)
    points = on_plane(FEET, (0.0, 0.0)) + np.outer([0.0, 0.08, 0.0, 0.0], [0.0, 0.0, 1.0])  # best fit: a rise of 0.1
    for _ in range(round(fall_time / 1e-3)):
        belief.update(1e-3, points, STANDING)
    assert abs(belief.slope[0]) < 0.01
    for _ in range(round(8.0 * fall_time / 1e-3)):
        belief.update(1e-3, on_plane(FEET, (0.3, 0.0)), STANDING)
    assert belief.slope[0] == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("bounces", [False, True])
def test_at_the_foot_of_a_ramp_footholds_have_its_heights_and_normals_before_the_plane_has(bounces: bool) -> None:
    """Whether contacts last or are lost for a moment."""
    belief, rise = believed((0.0, 0.0)), math.tan(math.radians(15.0))
    places = belief.places = belief.footholds.copy()

    def ground(x: float) -> float:
        return max(rise * (x - 0.35), 0.0)

    errors = []
    for step in range(1, 10):  # a trot of 12 cm a stride
        stance = np.array([True, False, False, True]) if step % 2 else np.array([False, True, True, False])
        places[stance, 0] += 0.12
        foot = 0 if step % 2 else 1
        x, y, _ = places[foot]
        errors.append((belief.height_at(x, y) - ground(x), belief.plane_at(x, y) - ground(x)))
        places[stance, 2] = [ground(x) for x in places[stance, 0]]
        for tick in range(120):
            belief.update(1e-3, places, (stance & (not bounces or tick % 40 < 30)).tolist())
    expected, plane = np.abs(errors[3:]).T  # the first two touchdowns on the ramp are unexpected
    assert plane.max() > 0.02 and expected.max() < 0.6 * plane.max()
    tilt = np.degrees(np.arctan2(-belief.normals[:, 0], belief.normals[:, 2]))
    assert tilt[:2] == pytest.approx(15.0, abs=3.0) and belief.slope[0] < 0.9 * rise
    assert not belief.level and np.linalg.norm(belief.normals, axis=1) == pytest.approx(1.0)


def test_feet_in_the_air_keep_their_last_foothold() -> None:
    belief = believed((0.2, 0.0))
    raised = belief.footholds + [0.1, 0.0, 0.3]
    for _ in range(100):
        belief.update(1e-3, raised, [False] * 4)
    assert belief.slope == pytest.approx((0.2, 0.0), rel=1e-5)
    np.testing.assert_array_equal(belief.footholds, on_plane(FEET, (0.2, 0.0)))


def test_a_foot_in_the_air_is_not_carried() -> None:
    belief, points = TerrainBelief(4, 0.24), on_plane(FEET, (0.0, 0.0), 2.0)
    points[2, 2] += 0.05
    belief.begin(points)
    stance = belief.carried(0.005)
    assert stance.tolist() == [True, True, False, True]
    belief.begin(points, stance)
    assert belief.level and belief.plane_at(0.0, 0.0) == 2.0


def test_a_steep_fit_is_limited() -> None:
    belief = believed((3.0, 0.0))
    assert math.degrees(math.atan(belief.slope[0])) == pytest.approx(belief.settings.steepest_deg)


def test_two_feet_side_by_side_say_nothing_of_the_slope_ahead() -> None:
    belief = TerrainBelief(2, 0.8)
    belief.begin(np.array([[0.0, 0.1, 0.02], [0.0, -0.1, 0.0]]))
    assert belief.slope == pytest.approx((0.0, 0.1), rel=1e-3)
