"""Symbolic rigid-body algorithms over a ``pin.Model``, in CasADi."""

from lgmpc.robot.symbolic.contacts import ContactPoints
from lgmpc.robot.symbolic.factor import Factored, LdlFactor, MassFactor
from lgmpc.robot.symbolic.model import SymbolicModel
from lgmpc.robot.symbolic.passes import Placement

__all__ = ["ContactPoints", "Factored", "LdlFactor", "MassFactor", "Placement", "SymbolicModel"]
