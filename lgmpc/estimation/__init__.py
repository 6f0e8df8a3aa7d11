"""Estimation of what is not measured."""

from lgmpc.estimation.wrench import WrenchObserver

__all__ = ["WrenchObserver"]
