"""Disturbance observer: what pushes the robot, from its centroidal momentum and the contact forces."""

from __future__ import annotations

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["WrenchObserver"]


class WrenchObserver:
    r"""First-order momentum observer of the external wrench about the centre of mass, world axes.

    The centroidal momentum obeys ``h' = sum_i [f_i; (p_i - c) x f_i] + [m g; 0] + w``. Between two ticks the contact
    forces are known (those the whole-body QP asked for), so what is left of the measured change of ``h`` is ``w``;
    it is filtered with time constant ``T``: ``w <- w + (1 - exp(-dt / T)) ((h - h_last) / dt - known rate - w)``.
    Same idea as the generalised-momentum observer of De Luca and Mattone (ICRA 2005), at the centroidal level.

    Args:
        mass: kg.
        gravity: (3,) m/s^2.
        period: time between two updates, s.
        time_constant: filter time constant, s; longer is calmer and slower.
        force_limit: N; the estimate's force is scaled back to this norm, so that a fault cannot ask for the impossible.

    Attributes:
        wrench: (6,) current estimate [force; moment], N and N.m.

    Raises:
        InputError: if mass, period, time constant or limit is not positive.
    """

    def __init__(
        self, mass: float, gravity: Array, period: float, time_constant: float = 0.02, force_limit: float = np.inf
    ) -> None:
        for name, value in (("mass", mass), ("period", period), ("time_constant", time_constant)):
            if not (np.isfinite(value) and value > 0):
                raise InputError(name, value, "a positive number")
        if not force_limit > 0:
            raise InputError("force_limit", force_limit, "a positive number")
        self._weight = np.zeros(6)
        self._weight[:3] = mass * np.asarray(gravity)
        self._rate = 1.0 / period
        self._gain = 1.0 - float(np.exp(-period / time_constant))
        self._force_limit = force_limit
        self._momentum = np.zeros(6)
        self._known_rate = np.zeros(6)
        self._started = False
        self.wrench = np.zeros(6)

    def reset(self) -> None:
        """Forget the past: the estimate starts from zero at the next update."""
        self._started = False
        self.wrench[:] = 0.0

    def update(self, momentum: Array) -> Array:
        """Take the measured centroidal momentum (6,) of this tick and return the new estimate (6,), a live buffer."""
        if self._started:
            residual = (momentum - self._momentum) * self._rate - self._known_rate - self.wrench
            if np.isfinite(residual).all():
                self.wrench += self._gain * residual
                self._limit()
        self._momentum[:] = momentum
        return self.wrench

    def expect(self, com: Array, contact_points: Array, forces: Array) -> None:
        """Tell which contact forces (nc, 3) act at ``contact_points`` (nc, 3) until the next update."""
        total = forces.sum(axis=0)
        self._known_rate[:3] = total
        # sum (p - c) x f without np.cross, which costs more than the rest of the tick's observer
        moments = contact_points.T @ forces
        x, y, z = com
        self._known_rate[3] = moments[1, 2] - moments[2, 1] - (y * total[2] - z * total[1])
        self._known_rate[4] = moments[2, 0] - moments[0, 2] - (z * total[0] - x * total[2])
        self._known_rate[5] = moments[0, 1] - moments[1, 0] - (x * total[1] - y * total[0])
        self._known_rate += self._weight
        self._started = True

    def _limit(self) -> None:
        norm = float(np.sqrt(self.wrench[:3] @ self.wrench[:3]))
        if norm > self._force_limit:
            self.wrench *= self._force_limit / norm
