"""Disturbance observer: the external wrench on the robot, from its centroidal momentum and the contact forces."""

from __future__ import annotations

import math

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["WrenchObserver"]

_NOISE_MEMORY = 0.2  # s


class WrenchObserver:
    r"""First-order momentum observer of the external wrench about the centre of mass, world axes.

    The centroidal momentum obeys ``h' = r + w``, where ``r = sum_i [f_i; (p_i - c) x f_i] + [m g; 0]``. The controller
    computes the rate that its own forces and the present estimate of ``w`` should give, ``A_G a + A_G' v`` at the
    acceleration ``a`` that it commands; ``r`` is this without the estimate. The deviation of the measured rate is the
    estimate's error, and is filtered with time constant ``T``:
    ``w <- w + (1 - exp(-dt / T)) ((h - h_last) / dt - r - w)``. Where commands act with a delay, ``r``
    is that of the commands which acted between the two measurements.

    Noise of the measured momentum, of standard deviation ``s``, makes one of ``s / T`` in the estimate: where that is
    more than ``noise_force``, ``T`` grows until it is not. Successive errors are alike where a wrench changes, and
    opposite where they are white noise: their covariance is ``-s^2 / dt^2`` then, averaged over the last 0.2 s.
    Same idea as the generalised-momentum observer of De Luca and Mattone (ICRA 2005), at the centroidal level.

    Args:
        period: time between two updates, s.
        time_constant: filter time constant, s, at least; longer is calmer and slower.
        force_limit: N; the estimate is scaled back to this force, so that a fault cannot demand impossible forces.
        delay: from a measurement of the momentum until the command that it led to acts, s.
        noise_force: largest standard deviation of the estimated force in each axis, N, as far as noise causes it.

    Attributes:
        time_constant: the present one, s.
        wrench: (6,) current estimate [force; moment], N and N.m.

    Raises:
        InputError: if period, time constant or limit is not positive, or the delay negative.
    """

    def __init__(
        self,
        period: float,
        time_constant: float = 0.01,
        force_limit: float = math.inf,
        delay: float = 0.0,
        noise_force: float = math.inf,
    ) -> None:
        for name, value in (("period", period), ("time_constant", time_constant)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(name, value, "a positive number")
        for name, value in (("force_limit", force_limit), ("noise_force", noise_force)):
            if not value > 0:
                raise InputError(name, value, "a positive number")
        if not 0.0 <= delay < math.inf:
            raise InputError("delay", delay, "a number of seconds that is not negative")
        self._rate = 1.0 / period
        self._period, self._least_time, self._noise_force = period, time_constant, noise_force
        self._memory = -math.expm1(-period / _NOISE_MEMORY)
        self._covariance = 0.0  # of successive errors, mean of the three axes, N2
        self.time_constant = time_constant
        self._force_limit = force_limit
        self._momentum = np.full(6, math.nan)
        # An interval between two measurements overlaps those of at most two commands.
        whole, part = divmod(round(delay / period, 6), 1.0)
        shares = [1.0 - part, part] if part else [1.0]
        self._shares = np.array(shares)
        self._rates = np.full((int(whole) + len(shares), 6), math.nan)  # r of the commands, the newest first
        self._error, self._error_before = np.zeros((2, 6))
        self.wrench = np.zeros(6)
        self._force, self._force_error, self._force_error_before = (
            each[:3] for each in (self.wrench, self._error, self._error_before)
        )

    def reset(self) -> None:
        """Clear the history: the estimate is zero until a first expectation has been compared."""
        self._momentum[:] = math.nan
        self._rates[:] = math.nan
        self.wrench[:] = self._error_before[:] = 0.0
        self._covariance, self.time_constant = 0.0, self._least_time

    def update(self, momentum: Array) -> Array:
        """Take the measured centroidal momentum (6,) of this tick and return the new estimate (6,), a live buffer."""
        error = np.subtract(momentum, self._momentum, out=self._error)
        error *= self._rate
        error -= self._forces()
        error -= self.wrench
        if math.isfinite(error.dot(error)):
            self._adapt(error)
            error *= -math.expm1(-self._period / self.time_constant)
            self.wrench += error
            force = self._force
            size = math.sqrt(force.dot(force))
            if size > self._force_limit:
                self.wrench *= self._force_limit / size
        self._momentum[:] = momentum
        return self.wrench

    def expect(self, momentum_rate: Array) -> None:
        """Store the momentum rate (6,) of the command that was just computed, the estimated wrench included."""
        if len(self._rates) > 1:
            self._rates[1:] = self._rates[:-1]
        np.subtract(momentum_rate, self.wrench, out=self._rates[0])

    def skip(self) -> None:
        """Leave the command that was just computed out of the estimate: its forces are not known."""
        self._rates[1:] = self._rates[:-1]
        self._rates[0] = math.nan

    def miss(self, ticks: int) -> None:
        """Account for ``ticks`` without update before the next one: the last command went on, nothing was measured."""
        for _ in range(min(ticks, len(self._rates))):
            self._rates[1:] = self._rates[:-1]
        self._momentum[:] = math.nan

    def _adapt(self, error: Array) -> None:
        """Choose the time constant by the noise of the errors (6,)."""
        covariance = float(self._force_error.dot(self._force_error_before)) / 3.0
        self._covariance += self._memory * (covariance - self._covariance)
        self._error_before[:] = error
        noise = self._period * math.sqrt(max(0.0, -self._covariance))
        self.time_constant = max(self._least_time, noise / self._noise_force)

    def _forces(self) -> Array:
        """Return (6,) the r of the commands that acted between the last two measurements."""
        shares, rates = self._shares, self._rates
        acted: Array = rates[-1] if len(shares) == 1 else shares @ rates[-2:]
        return acted
