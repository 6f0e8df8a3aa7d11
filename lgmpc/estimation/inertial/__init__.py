"""Motion from an inertial measurement unit: kinematics on SE_2(3), increments, preintegration."""

from lgmpc.estimation.inertial.increments import (
    Increment,
    IncrementRule,
    exponential_increment,
    zero_order_hold_increment,
)
from lgmpc.estimation.inertial.kinematics import (
    error_dynamics,
    flow_differential,
    free_flow,
    gravity_increment,
    propagate,
    vector_field,
)
from lgmpc.estimation.inertial.preintegration import ImuNoise, Preintegration

__all__ = [
    "ImuNoise",
    "Increment",
    "IncrementRule",
    "Preintegration",
    "error_dynamics",
    "exponential_increment",
    "flow_differential",
    "free_flow",
    "gravity_increment",
    "propagate",
    "vector_field",
    "zero_order_hold_increment",
]
