"""Config section ``mpc``: the predictive controller above the whole-body controller."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.config.schema.base import Count, NonNegative, Positive, Range, Section

__all__ = ["MpcSection", "MpcWeights"]


class MpcWeights(Section):
    """Weights of the squared deviations that the MPC minimises."""

    com: NonNegative = Field(default=1e3, description="Position of the centre of mass, 1/m2.")
    linear_momentum: NonNegative = Field(default=10.0, description="Linear momentum, 1/(kg.m/s)2.")
    angular_momentum: NonNegative = Field(
        default=1e3, description="Angular momentum about the centre of mass, 1/(kg.m2/s)2."
    )
    force: NonNegative = Field(default=1e-3, description="Contact forces, from an even share of the weight, 1/N2.")
    terminal: NonNegative = Field(default=10.0, description="Factor on the state's weights at the last node.")


class MpcSection(Section):
    """Model-predictive control of the momenta by contact forces over a receding horizon."""

    enabled: bool = Field(default=True, strict=True, description="false: the whole-body controller works alone.")
    model: Literal["centroidal"] = Field(default="centroidal", description="Model that predicts.")
    rate_hz: Positive = Field(default=100.0, description="Updates per second, Hz.")
    nodes: Count = Field(default=20, description="Number of nodes of the horizon.")
    node_s: Positive = Field(default=0.02, description="Time between nodes, s.")
    qp_solver: Literal["osqp", "piqp", "proxqp"] = Field(
        default="osqp", description="Solver of each quadratic programme."
    )
    sqp_iterations: Count = Field(
        default=1, description="Quadratic programmes per update; 1 is the real-time iteration."
    )
    friction: Positive = Field(default=0.6, description="Friction coefficient that the MPC relies on.")
    normal_force_n: Range = Field(
        default=(0.5, 30.0), description="[lowest, highest] normal force of a foot in contact, N."
    )
    weights: MpcWeights = Field(default=MpcWeights(), description="Weights of the cost.")
