"""Symbolic rigid-body algorithms over a ``pin.Model``, in CasADi."""

from lgmpc.robot.symbolic.factor import Factored, LdlFactor, MassFactor
from lgmpc.robot.symbolic.model import SymbolicModel
from lgmpc.robot.symbolic.passes import Placement

__all__ = ["Factored", "LdlFactor", "MassFactor", "Placement", "SymbolicModel"]
