"""Elliptic functions as mechanics needs them: for arguments of any size, and accurate up to the separatrix.

The parameter is ``m = k^2``, given with its complement ``m1 = 1 - m``, which near the separatrix carries the digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from lgmpc.typing import Array

__all__ = ["Modulus"]


@dataclass(frozen=True)
class Modulus:
    """The parameter of Jacobi's functions.

    Attributes:
        m: 0 (trigonometric functions) to 1 (hyperbolic).
        m1: 1 - m.
    """

    m: float
    m1: float

    @property
    def quarter_period(self) -> float:
        """K, infinite for m = 1."""
        return float(special.ellipkm1(self.m1))

    def jacobi(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Return sn, cn, dn and the amplitude am of real arguments of any shape."""
        half = 2.0 * self.quarter_period
        turns = np.rint(u / half)  # zero on the separatrix; else what is left is where ellipj is most accurate
        sn, cn, dn, am = special.ellipj(u - turns * half if self.m1 > 0.0 else u, self.m)
        sign = 1.0 - 2.0 * (turns % 2.0)
        return sign * sn, sign * cn, dn, am + np.pi * turns

    def first_kind(self, amplitude: float) -> float:
        """Incomplete integral F of the first kind from 0 to an amplitude, the inverse of am."""
        half_turns, sine, squared, delta = self._reduced(np.asarray(amplitude))
        complete = 2.0 * float(half_turns) * self.quarter_period if half_turns else 0.0
        return complete + float(sine * special.elliprf(squared, delta, 1.0))

    def third_kind(self, n: float, amplitude: Array) -> Array:
        """Integral of ``1 / ((1 - n sin^2) sqrt(1 - m sin^2))`` from 0 to amplitudes of any size, n < 1.

        Carlson's symmetric forms, "Numerical computation of real or complex elliptic integrals", Numerical Algorithms
        10 (1995); DLMF 19.25.14.
        """
        half_turns, sine, squared, delta = self._reduced(amplitude)
        one = np.ones_like(squared)
        partial = sine * special.elliprf(squared, delta, one) + n / 3.0 * sine**3 * special.elliprj(
            squared, delta, one, 1.0 - n * sine**2
        )
        if not half_turns.any():
            return np.asarray(partial, dtype=np.float64)
        complete = special.elliprf(0.0, self.m1, 1.0) + n / 3.0 * special.elliprj(0.0, self.m1, 1.0, 1.0 - n)
        return np.asarray(partial + 2.0 * half_turns * complete, dtype=np.float64)

    def _reduced(self, amplitude: Array) -> tuple[Array, Array, Array, Array]:
        """Half turns nearest to an amplitude; sine, squared cosine and ``1 - m sin^2`` of what is left of it."""
        half_turns = np.rint(amplitude / np.pi)
        rest = amplitude - np.pi * half_turns
        squared = np.cos(rest) ** 2
        return half_turns, np.sin(rest), squared, self.m1 + self.m * squared
