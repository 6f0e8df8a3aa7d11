"""The friction monitor: a lower coefficient while a foot slides, and slowly the nominal one again."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.estimation import FrictionMonitor

STANCE = [True, True, True, False]


def velocities(foot: int, sideways: float, up: float = 0.0) -> np.ndarray:
    v = np.zeros((4, 3))
    v[foot] = [0.6 * sideways, -0.8 * sideways, up]
    return v


def test_while_a_stance_foot_slides_it_falls_with_its_time_constant() -> None:
    monitor = FrictionMonitor(0.6, 1e-3, sliding_speed=0.1, fall_time=0.05)
    for _ in range(50):
        monitor.update(velocities(1, 0.11), STANCE)
    assert monitor.coefficient == pytest.approx(0.6 * np.exp(-1.0), rel=1e-12)


def test_it_rises_again_slowly_towards_the_nominal() -> None:
    monitor = FrictionMonitor(0.6, 1e-3, fall_time=0.05, rise_time=2.0)
    for _ in range(50):
        monitor.update(velocities(0, 1.0), STANCE)
    low = monitor.coefficient
    for _ in range(2000):
        monitor.update(np.zeros((4, 3)), STANCE)
    assert monitor.coefficient == pytest.approx(0.6 - (0.6 - low) * np.exp(-1.0), rel=1e-12)


@pytest.mark.parametrize("harmless", [velocities(0, 0.09), velocities(0, 0.0, up=3.0), velocities(3, 5.0)])
def test_slow_creep_vertical_motion_and_feet_in_the_air_do_not_count(harmless: np.ndarray) -> None:
    monitor = FrictionMonitor(0.6, 1e-3)
    assert monitor.update(harmless, STANCE) == 0.6


def test_it_never_falls_below_the_least() -> None:
    monitor = FrictionMonitor(0.6, 1e-3, least=0.15)
    for _ in range(5000):
        monitor.update(velocities(2, 2.0), STANCE)
    assert monitor.coefficient == 0.15
    monitor.reset()
    assert monitor.coefficient == 0.6


def test_velocities_that_are_not_finite_change_nothing() -> None:
    monitor = FrictionMonitor(0.6, 1e-3)
    assert monitor.update(np.full((4, 3), np.nan), STANCE) == 0.6


@pytest.mark.parametrize("argument", ["nominal", "period", "sliding_speed", "fall_time", "rise_time", "least"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_arguments_are_refused(argument: str, value: float) -> None:
    arguments = {"nominal": 0.6, "period": 1e-3} | {argument: value}
    with pytest.raises(InputError, match=argument):
        FrictionMonitor(**arguments)
