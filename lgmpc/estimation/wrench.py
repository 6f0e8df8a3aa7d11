"""Disturbance observer: the external wrench on the robot, from its centroidal momentum and the contact forces."""

from __future__ import annotations

import math

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["WrenchObserver"]


class WrenchObserver:
    r"""First-order momentum observer of the external wrench about the centre of mass, world axes.

    The centroidal momentum obeys ``h' = sum_i [f_i; (p_i - c) x f_i] + [m g; 0] + w``. The controller computes
    the rate that its own forces and the present estimate of ``w`` should give, ``A_G a + A_G' v`` at the acceleration
    ``a`` that it commands; the deviation of the measured rate is the estimate's error, and is filtered with time
    constant ``T``: ``w <- w + (1 - exp(-dt / T)) ((h - h_last) / dt - expected rate)``.
    Same idea as the generalised-momentum observer of De Luca and Mattone (ICRA 2005), at the centroidal level.

    Args:
        period: time between two updates, s.
        time_constant: filter time constant, s; longer is calmer and slower.
        force_limit: N; the estimate is scaled back to this force, so that a fault cannot demand impossible forces.

    Attributes:
        wrench: (6,) current estimate [force; moment], N and N.m.

    Raises:
        InputError: if period, time constant or limit is not positive.
    """

    def __init__(self, period: float, time_constant: float = 0.01, force_limit: float = math.inf) -> None:
        for name, value in (("period", period), ("time_constant", time_constant)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(name, value, "a positive number")
        if not force_limit > 0:
            raise InputError("force_limit", force_limit, "a positive number")
        self._rate = 1.0 / period
        self._gain = 1.0 - math.exp(-period / time_constant)
        self._force_limit = force_limit
        self._momentum = np.zeros(6)
        self._expected_rate = np.zeros(6)
        self._expecting = False
        self.wrench = np.zeros(6)

    def reset(self) -> None:
        """Clear the history: the estimate is zero until a first expectation has been compared."""
        self._expecting = False
        self.wrench[:] = 0.0

    def update(self, momentum: Array) -> Array:
        """Take the measured centroidal momentum (6,) of this tick and return the new estimate (6,), a live buffer."""
        if self._expecting:
            error = (momentum - self._momentum) * self._rate - self._expected_rate
            if math.isfinite(error @ error):
                self.wrench += self._gain * error
                force = self.wrench[:3]
                size = math.sqrt(force @ force)
                if size > self._force_limit:
                    self.wrench *= self._force_limit / size
        self._momentum[:] = momentum
        return self.wrench

    def expect(self, momentum_rate: Array) -> None:
        """Store the momentum rate (6,) expected until the next update, the estimated wrench included."""
        self._expected_rate[:] = momentum_rate
        self._expecting = True

    def skip(self) -> None:
        """Leave the time until the next update out of the estimate, because the forces meanwhile are not known."""
        self._expecting = False
