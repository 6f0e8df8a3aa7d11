"""How numbers of a config grow with the robot, so that the same ones suit light and heavy ones."""

from __future__ import annotations

from lgmpc.robot import Robot

__all__ = ["normal_force_range", "weight_factor"]

_WEIGHTS_MASS = 2.5
"""kg. Weights of momenta and forces are those of a robot of this mass, so that the same ones suit light and heavy ones:
unscaled, the momentum of a robot of 50 kg would count 400 times as much beside tasks that are accelerations."""


def weight_factor(robot: Robot) -> float:
    """Return what turns weights of squared momenta and forces of a robot of 2.5 kg into those of this one."""
    return float((_WEIGHTS_MASS / robot.mass) ** 2)


def normal_force_range(
    given: tuple[float, float] | None, per_kilogram: tuple[float, float], robot: Robot
) -> tuple[float, float]:
    """Return the lowest and highest normal force of a foot, N: as given, or in proportion to the robot's mass."""
    return given if given is not None else (per_kilogram[0] * robot.mass, per_kilogram[1] * robot.mass)
