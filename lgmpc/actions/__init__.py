"""Actions: the intervals of an optimal control problem, written once as CasADi expressions."""

from lgmpc.actions.base import Action, Stage, StageValue
from lgmpc.actions.centroidal import CentroidalAction
from lgmpc.costs import Bounded, Cost, CostTerm, LeastSquares, Parameter, ParameterLayout

__all__ = [
    "Action",
    "Bounded",
    "CentroidalAction",
    "Cost",
    "CostTerm",
    "LeastSquares",
    "Parameter",
    "ParameterLayout",
    "Stage",
    "StageValue",
]
