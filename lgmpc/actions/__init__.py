"""Actions: the intervals of an optimal control problem, written once as CasADi expressions."""

from lgmpc.actions.base import Action, Bounded, LeastSquares, StageValue
from lgmpc.actions.centroidal import CentroidalAction
from lgmpc.actions.parameters import Parameter, ParameterLayout

__all__ = [
    "Action",
    "Bounded",
    "CentroidalAction",
    "LeastSquares",
    "Parameter",
    "ParameterLayout",
    "StageValue",
]
