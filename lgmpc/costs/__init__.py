"""Costs and constraints of a node: residuals, activations, named parameters; ready-made ones in ``costs.library``."""

from lgmpc.costs.activations import (
    Activation,
    Huber,
    Quadratic,
    QuadraticBarrier,
)
from lgmpc.costs.parameters import Parameter, ParameterLayout
from lgmpc.costs.residual import (
    Bounded,
    ConstraintItem,
    Cost,
    CostItem,
    CostTerm,
    LeastSquares,
    Residual,
    constraint_of,
    cost_of,
)
from lgmpc.costs.symbols import MissingQuantityError, StageSymbols

__all__ = [
    "Activation",
    "Bounded",
    "ConstraintItem",
    "Cost",
    "CostItem",
    "CostTerm",
    "Huber",
    "LeastSquares",
    "MissingQuantityError",
    "Parameter",
    "ParameterLayout",
    "Quadratic",
    "QuadraticBarrier",
    "Residual",
    "StageSymbols",
    "constraint_of",
    "cost_of",
]
