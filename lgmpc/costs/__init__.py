"""Costs and constraints of a node: residuals, activations, named parameters; ready-made ones in ``costs.library``."""

from lgmpc.costs.activations import (
    Activation as Activation,
    Huber as Huber,
    Quadratic as Quadratic,
    QuadraticBarrier as QuadraticBarrier,
)
from lgmpc.costs.parameters import Parameter as Parameter, ParameterLayout as ParameterLayout
from lgmpc.costs.residual import (
    Bounded as Bounded,
    ConstraintItem as ConstraintItem,
    Cost as Cost,
    CostItem as CostItem,
    CostTerm as CostTerm,
    LeastSquares as LeastSquares,
    Residual as Residual,
    constraint_of as constraint_of,
    cost_of as cost_of,
)
from lgmpc.costs.symbols import MissingQuantityError as MissingQuantityError, StageSymbols as StageSymbols
