"""Estimation of what is not measured: the floating base's motion, pushes, friction."""

from lgmpc.estimation.friction import FrictionMonitor
from lgmpc.estimation.inertial import ImuNoise, Preintegration, exponential_increment, zero_order_hold_increment
from lgmpc.estimation.invariant_ekf import InvariantEkf
from lgmpc.estimation.wrench import WrenchObserver

__all__ = [
    "FrictionMonitor",
    "ImuNoise",
    "InvariantEkf",
    "Preintegration",
    "WrenchObserver",
    "exponential_increment",
    "zero_order_hold_increment",
]
