"""Estimation of what is not measured."""

from lgmpc.estimation.friction import FrictionMonitor
from lgmpc.estimation.wrench import WrenchObserver

__all__ = ["FrictionMonitor", "WrenchObserver"]
