"""Scaling of weights and force limits with the robot's mass.

Settings are values for a robot of :data:`REFERENCE_MASS`. Unscaled, the squared momentum of a robot of 50 kg would be
400 times as large relative to costs of accelerations and positions.
"""

REFERENCE_MASS = 2.5
"""kg; mass of Solo12, for which weights of squared forces and momenta are stated."""


def weight_factor(mass: float) -> float:
    """Return the factor on weights of squared forces and momenta, ``(REFERENCE_MASS / mass)^2``."""
    return float((REFERENCE_MASS / mass) ** 2)


def turning_factor(mass: float) -> float:
    """Return the factor on weights of squared angular accelerations: ``(mass / REFERENCE_MASS)^(2/3)``.

    Robots of one shape and of lengths L have masses in proportion to L^3, linear accelerations that do not depend on
    L, and angular ones in proportion to 1 / L.
    """
    return float((mass / REFERENCE_MASS) ** (2.0 / 3.0))


def normal_force_range(
    given: tuple[float, float] | None, per_kilogram: tuple[float, float], mass: float
) -> tuple[float, float]:
    """Return the lowest and highest normal force of a foot, N.

    Args:
        given: the setting, N; None for a range proportional to the mass.
        per_kilogram: N/kg, used where none is given.
        mass: of the robot, kg.
    """
    return given if given is not None else (per_kilogram[0] * mass, per_kilogram[1] * mass)
