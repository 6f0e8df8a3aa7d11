"""Elliptic functions for arguments of any size, accurate up to the separatrix.

The parameter is ``m = k^2``, given with its complement ``m1 = 1 - m``, which determines the accuracy near the
separatrix (``scipy.special.ellipj`` has m alone, and is inaccurate there near a quarter period).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from lgmpc.typing import Array

_SMALLEST = 1e-100
"""Smaller arguments are treated as zero: powers of their cotangent would overflow."""


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

    def jacobi(self, u: Array) -> tuple[Array, Array, Array]:
        """Return sn, cn and dn of real arguments of any shape."""
        turns, rest = self._reduced(u)
        sn, cn, dn = self._central(rest)
        sign = 1.0 - 2.0 * (turns % 2.0)
        return sign * sn, sign * cn, dn

    def first_kind(self, sine: float, cosine: float) -> float:
        """Return the u between -2 K and 2 K with ``sn u`` and ``cn u`` proportional to sine and cosine."""
        length = math.hypot(sine, cosine)
        s, c = sine / length, cosine / length
        partial = s * float(special.elliprf(c**2, self.m1 + self.m * c**2, 1.0))
        return partial if c >= 0.0 else math.copysign(2.0 * self.quarter_period, s) - partial

    def _reduced(self, u: Array) -> tuple[Array, Array]:
        """Return the nearest multiples of 2 K and the remainders; zero multiples if the period is infinite."""
        array = np.asarray(u, dtype=np.float64)
        if self.m1 == 0.0:
            return np.zeros_like(array), array
        turns = np.rint(array / (2.0 * self.quarter_period))
        return turns, array - turns * 2.0 * self.quarter_period

    def _central(self, u: Array) -> tuple[Array, Array, Array]:
        """Return sn, cn and dn of arguments between -K and K, from the arithmetic-geometric mean of 1 and m1.

        Bulirsch, "Numerical calculation of elliptic integrals and elliptic functions", Numerische Mathematik 7 (1965).
        """
        if self.m1 == 0.0:
            decay = np.exp(-np.abs(u))
            secant = 2.0 * decay / (1.0 + decay**2)
            return np.tanh(u), secant, secant
        means = [(1.0, math.sqrt(self.m1))]
        while abs(means[-1][0] - means[-1][1]) > 1e-8 * means[-1][0]:
            a, b = means[-1]
            means.append(((a + b) / 2.0, math.sqrt(a * b)))
        mean = sum(means[-1]) / 2.0
        zero = np.abs(u) < _SMALLEST
        angle = np.where(zero, 1.0, mean * u)
        ratio = 1.0 / np.tan(angle)
        c, dn = mean * ratio, np.ones_like(ratio)
        for a, b in reversed(means):
            ratio = ratio * c
            c = c * dn
            dn = (b + ratio) / (a + ratio)
            ratio = c / a
        sn = np.copysign(1.0 / np.sqrt(c**2 + 1.0), np.sin(angle))
        return np.where(zero, u, sn), np.where(zero, 1.0, c * sn), np.where(zero, 1.0, dn)
