"""Symbolic rigid-body algorithms over a ``pin.Model``, in CasADi."""

from lgmpc.robot.symbolic.factor import Factored as Factored, LdlFactor as LdlFactor, MassFactor as MassFactor
from lgmpc.robot.symbolic.model import SymbolicModel as SymbolicModel
from lgmpc.robot.symbolic.passes import Placement as Placement
