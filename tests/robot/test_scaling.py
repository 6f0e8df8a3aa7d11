"""Weights of squared forces and momenta scale so that a robot and a larger copy of it are controlled alike."""

import pytest

from lgmpc.robot.scaling import REFERENCE_MASS, normal_force_range, turning_factor, weight_factor


def test_weighted_squares_of_forces_are_the_same_for_a_heavier_copy() -> None:
    for ratio in (0.5, 1.0, 4.0):
        mass = ratio * REFERENCE_MASS
        force = mass * 9.81  # of the same motion
        assert weight_factor(mass) * force**2 == pytest.approx((REFERENCE_MASS * 9.81) ** 2)


def test_weighted_squares_of_angular_accelerations_are_the_same_for_a_larger_copy() -> None:
    for length in (0.5, 1.0, 3.0):
        mass = REFERENCE_MASS * length**3
        angular = 9.81 / length  # of the same linear acceleration
        assert turning_factor(mass) * angular**2 == pytest.approx(9.81**2)


def test_force_limits_are_those_given_or_in_proportion_to_the_mass() -> None:
    assert normal_force_range((1.0, 40.0), (0.04, 10.0), 50.0) == (1.0, 40.0)
    assert normal_force_range(None, (0.04, 10.0), 50.0) == pytest.approx((2.0, 500.0))
