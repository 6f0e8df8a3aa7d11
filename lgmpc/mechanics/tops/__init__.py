"""Spinning bodies in closed form: torque-free, Poinsot's construction, Lagrange's top; and benchmarks."""

from lgmpc.mechanics.tops.benchmarks import BRULS_TOP, SIMO_WONG_TOP, HeavyTopBenchmark
from lgmpc.mechanics.tops.lagrange_top import LagrangeTop, Nutation
from lgmpc.mechanics.tops.poinsot import Poinsot
from lgmpc.mechanics.tops.torque_free import EulerTop, symmetric_top_precession

__all__ = [
    "BRULS_TOP",
    "SIMO_WONG_TOP",
    "EulerTop",
    "HeavyTopBenchmark",
    "LagrangeTop",
    "Nutation",
    "Poinsot",
    "symmetric_top_precession",
]
