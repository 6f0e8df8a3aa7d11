"""Symbolic rigid-body algorithms over a ``pin.Model``, in CasADi."""

from lgmpc.robot.symbolic.factor import MassFactor
from lgmpc.robot.symbolic.model import SymbolicModel
from lgmpc.robot.symbolic.passes import Placement

__all__ = ["MassFactor", "Placement", "SymbolicModel"]
