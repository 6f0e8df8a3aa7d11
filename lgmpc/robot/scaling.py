"""How weights and force limits grow with a robot's mass: the one place where settings meet the mass.

Settings hold numbers for a robot of :data:`REFERENCE_MASS`. Unscaled, the momentum of a robot of 50 kg would count 400
times as much beside costs of accelerations and positions.
"""

from __future__ import annotations

__all__ = ["REFERENCE_MASS", "normal_force_range", "weight_factor"]

REFERENCE_MASS = 2.5
"""kg; mass of Solo12, for which weights of squared forces and momenta are stated."""


def weight_factor(mass: float) -> float:
    """Return the factor on weights of squared forces and momenta, ``(REFERENCE_MASS / mass)^2``."""
    return float((REFERENCE_MASS / mass) ** 2)


def normal_force_range(
    given: tuple[float, float] | None, per_kilogram: tuple[float, float], mass: float
) -> tuple[float, float]:
    """Return the lowest and highest normal force of a foot, N.

    Args:
        given: as set, N; None for a range in proportion to the mass.
        per_kilogram: N/kg, used where none is given.
        mass: of the robot, kg.
    """
    return given if given is not None else (per_kilogram[0] * mass, per_kilogram[1] * mass)
