"""The friction monitor: a lower coefficient while a foot slides, and slowly the nominal one again."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.estimation import FrictionMonitor
from lgmpc.robot.soles import FootPoints

STANCE = [True, True, True, False]
FORCES = np.tile([0.0, 6.4, 8.0], (4, 1))
"""Steeper than any coefficient here: they bound nothing."""


TILTS = {"level": np.eye(3), "a slope of 25 degrees": pin.exp3(np.radians(25.0) * np.array([0.6, -0.8, 0.0]))}


@pytest.fixture(params=TILTS)
def tilt(request: pytest.FixtureRequest) -> np.ndarray:
    """Axes of the surface, along which velocities and forces of the tests are given."""
    return TILTS[request.param]


def update(monitor: FrictionMonitor, tilt: np.ndarray, velocities: np.ndarray, forces: np.ndarray) -> float:
    normals = np.tile(tilt[:, 2], (4, 1))
    return monitor.update(velocities @ tilt.T, STANCE, forces @ tilt.T, normals)


def velocities(foot: int, sideways: float, up: float = 0.0) -> np.ndarray:
    v = np.zeros((4, 3))
    v[foot] = [0.6 * sideways, -0.8 * sideways, up]
    return v


def test_while_a_stance_foot_slides_it_falls_with_its_time_constant(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, sliding_speed=0.1, fall_time=0.05)
    coefficients = [update(monitor, tilt, velocities(1, 0.11 + 1e-3 * k), FORCES) for k in range(80)]
    assert coefficients[3] == 0.6  # the smoothed velocity comes later
    assert coefficients[79] == pytest.approx(np.exp(-1.0) * coefficients[29], rel=1e-12)


def test_the_slope_of_the_force_under_which_a_foot_slides_ever_faster_bounds_it_at_once(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=1e6)
    forces = FORCES.copy()
    forces[1] = [-3.0, 4.0, 12.5]
    update(monitor, tilt, velocities(1, 0.05), forces)
    assert monitor.coefficient == 0.6
    update(monitor, tilt, velocities(1, 0.4), forces)
    assert monitor.coefficient == pytest.approx(0.4)
    for load in (0.0, 1.0):
        forces[1] = [-0.03, 0.04, load]  # a foot with hardly any load slides for other reasons
        update(monitor, tilt, velocities(1, 0.5 + 0.1 * load), forces)
        assert monitor.coefficient == pytest.approx(0.4)
    forces[1, 2] = 2.0  # and one with more of it perhaps: no further than by half
    update(monitor, tilt, velocities(1, 0.7), forces)
    assert monitor.coefficient == pytest.approx(0.2)


def test_a_foot_that_was_faster_in_the_same_slide_proves_nothing(tilt: np.ndarray) -> None:
    """One that chatters on the ground is faster now and then, and comes to rest."""
    monitor, forces = FrictionMonitor(0.6, 1e-3, fall_time=1e6), FORCES.copy()
    for _ in range(12):
        update(monitor, tilt, velocities(1, 1.0), forces)
    assert monitor.coefficient == pytest.approx(0.6)
    steep = monitor.coefficient
    forces[1] = [-3.0, 4.0, 12.5]
    for k in range(20):
        assert update(monitor, tilt, velocities(1, 0.75 - 0.03 * k + 0.2 * (k % 2)), forces) == steep
    for _ in range(20):
        update(monitor, tilt, velocities(1, 0.0), forces)
    update(monitor, tilt, velocities(1, 0.4), forces)  # another slide
    assert monitor.coefficient == pytest.approx(0.4)


def test_a_foot_that_bounced_proves_nothing_while_it_comes_to_rest(tilt: np.ndarray) -> None:
    """It sinks at first, which is no slide, and then slides ever more slowly."""
    monitor, forces = FrictionMonitor(0.6, 1e-3), np.tile([0.0, 0.0, 8.0], (4, 1))
    for k in range(30):
        assert update(monitor, tilt, velocities(1, 0.7 * 0.7**k, up=-0.5 * 0.5**k), forces) == 0.6


def test_a_foot_that_slows_down_proves_nothing(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=0.05)
    for _ in range(20):
        update(monitor, tilt, velocities(1, 1.0), FORCES)
    low = monitor.coefficient
    assert low < 0.6
    for speed in np.linspace(0.99, 0.2, 50):
        assert update(monitor, tilt, velocities(1, speed), FORCES) == low


def test_a_foot_that_rolls_off_an_edge_proves_nothing(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=0.05)
    sinking = np.zeros((4, 3))
    sinking[1] = tilt @ [0.3, -0.4, -0.25]  # in the axes of the surface once it is turned back
    for _ in range(50):
        assert monitor.update(sinking, STANCE, FORCES @ tilt.T, np.tile(tilt[:, 2], (4, 1))) == 0.6


def test_a_sole_slides_if_all_of_its_points_do_under_the_slope_of_their_forces(tilt: np.ndarray) -> None:
    """One that rocks on a corner moves the others, however little they carry."""
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=1e6, points=FootPoints((4,), np.zeros((4, 3))))
    normals, forces = np.tile(tilt[:, 2], (4, 1)), np.array([[3.0, -4.0, 20.0], [0.0, 0.0, 0.0], [0, 5, 5], [0, 0, 0]])
    rocking = sum(velocities(foot, 1.0) for foot in (1, 2, 3))
    for speed in (1.0, 2.0):
        monitor.update(speed * rocking @ tilt.T, [True] * 4, forces @ tilt.T, normals)
        assert monitor.coefficient == 0.6
    monitor.update((3.0 * rocking + velocities(0, 1.0)) @ tilt.T, [True] * 4, forces @ tilt.T, normals)
    assert monitor.coefficient == pytest.approx(10.0 / 25.0)


def test_a_foot_on_ground_steeper_than_believed_is_judged_along_its_slide() -> None:
    monitor, ramp = (
        FrictionMonitor(0.6, 1e-3),
        np.array([math.cos(math.radians(15.0)), 0.0, math.sin(math.radians(15.0))]),
    )
    forces = np.tile(10.0 * np.array([math.sin(math.radians(20.0)), 0.0, math.cos(math.radians(20.0))]), (4, 1))
    for k in range(30):  # slides back down the ramp under a force outside of the cone of 0.6 there, inside of that here
        sliding = np.zeros((4, 3))
        sliding[1] = -(0.2 + 0.01 * k) * ramp
        monitor.update(sliding, STANCE, forces, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert monitor.coefficient == 0.6


def test_it_rises_again_slowly_towards_the_nominal(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=0.05, rise_time=2.0)
    for _ in range(50):
        update(monitor, tilt, velocities(0, 1.0), FORCES)
    for _ in range(20):  # until the smoothed velocity is below the threshold
        update(monitor, tilt, np.zeros((4, 3)), FORCES)
    low = monitor.coefficient
    assert low < 0.3
    for _ in range(2000):
        update(monitor, tilt, np.zeros((4, 3)), FORCES)
    assert monitor.coefficient == pytest.approx(0.6 - (0.6 - low) * np.exp(-1.0), rel=1e-12)


@pytest.mark.parametrize("harmless", [velocities(0, 0.09), velocities(0, 0.0, up=3.0), velocities(3, 5.0)])
def test_slow_creep_vertical_motion_and_feet_in_the_air_do_not_count(tilt: np.ndarray, harmless: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3)
    assert update(monitor, tilt, harmless, FORCES) == 0.6


def test_noise_beyond_the_sliding_speed_now_and_then_changes_nothing(tilt: np.ndarray) -> None:
    monitor, rng = FrictionMonitor(0.6, 1e-3), np.random.default_rng(0)
    highest = 0.0
    for _ in range(5000):
        noise = np.tile(0.03 * rng.normal(size=3), (4, 1))
        highest = max(highest, float(np.hypot(*noise[0, :2])))
        assert update(monitor, tilt, noise, FORCES) == 0.6
    assert highest > 0.11


def test_it_never_falls_below_the_least(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3, least=0.15)
    for _ in range(5000):
        update(monitor, tilt, velocities(2, 2.0), FORCES)
    assert monitor.coefficient == 0.15
    monitor.reset()
    assert monitor.coefficient == 0.6


def test_velocities_that_are_not_finite_change_nothing(tilt: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3)
    assert update(monitor, tilt, np.full((4, 3), np.nan), FORCES) == 0.6


@pytest.mark.parametrize(
    ("feet", "speed", "others", "learned"),
    [((0, 3), 0.6, 0.0, 0.4), ((0, 3), 0.4, 0.0, 0.6), ((0,), 0.6, 12.5, 0.6), ((0, 3), 0.6, 12.5, 0.6)],
)
def test_feet_that_have_just_landed_are_evidence_when_fast_and_if_they_carry_most_of_the_load(
    tilt: np.ndarray, feet: tuple[int, ...], speed: float, others: float, learned: float
) -> None:
    """Two corners of a sole that lands beside one that carries are no evidence."""
    monitor, normals = FrictionMonitor(0.6, 1e-3, fall_time=1e6), np.tile(tilt[:, 2], (4, 1))
    forces = np.tile([0.0, 0.0, others], (4, 1))
    forces[list(feet)] = [-3.0, 4.0, 12.5]
    for size in (0.0, 3.0 * speed):  # smoothed: 39 % of it
        moving = sum(velocities(foot, size) for foot in feet)
        monitor.update(moving @ tilt.T, [False] * 4, forces @ tilt.T, normals, [True, False, False, True])
    assert monitor.coefficient == pytest.approx(learned)
    monitor.reset()
    for _ in range(2):
        monitor.update(moving @ tilt.T, [False] * 4, forces @ tilt.T, normals, [False, True, True, False])
    assert monitor.coefficient == 0.6  # in the air


@pytest.mark.parametrize("argument", ["nominal", "period", "sliding_speed", "fall_time", "rise_time", "least"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_arguments_are_refused(argument: str, value: float) -> None:
    arguments = {"nominal": 0.6, "period": 1e-3} | {argument: value}
    with pytest.raises(InputError, match=argument):
        FrictionMonitor(**arguments)
