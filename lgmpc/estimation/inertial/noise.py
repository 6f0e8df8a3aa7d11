"""How noisy an inertial measurement unit is."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from lgmpc.errors import InputError

__all__ = ["ImuNoise"]


@dataclass(frozen=True)
class ImuNoise:
    """Densities of white noise, as data sheets have them; a sample over ``dt`` has variance ``density^2 / dt``.

    Attributes:
        gyro: rad/s/sqrt(Hz).
        accelerometer: m/s2/sqrt(Hz).
        gyro_bias_walk: of the bias's rate, rad/s2/sqrt(Hz); it adds ``density^2 dt`` to the bias's variance.
        accelerometer_bias_walk: m/s3/sqrt(Hz).

    Raises:
        InputError: a density that is negative or not finite.
    """

    gyro: float = 1e-4
    accelerometer: float = 3e-4
    gyro_bias_walk: float = 1e-5
    accelerometer_bias_walk: float = 1e-4

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(field.name, value, "a density that is not negative")
