"""Costs and constraints of a node: residuals, activations, named parameters."""

from lgmpc.costs.activations import (
    Activation,
    Huber,
    Quadratic,
    QuadraticBarrier,
    SmoothOneNorm,
    WeightedQuadratic,
)
from lgmpc.costs.parameters import Parameter, ParameterLayout
from lgmpc.costs.terms import Bounded, Cost, CostTerm, LeastSquares

__all__ = [
    "Activation",
    "Bounded",
    "Cost",
    "CostTerm",
    "Huber",
    "LeastSquares",
    "Parameter",
    "ParameterLayout",
    "Quadratic",
    "QuadraticBarrier",
    "SmoothOneNorm",
    "WeightedQuadratic",
]
