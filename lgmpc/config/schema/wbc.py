"""Config section ``wbc``: the whole-body controller that turns tasks and forces into joint torques."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lgmpc.config.schema.base import NonNegative, Positive, Range, Section

__all__ = ["WbcGains", "WbcSection", "WbcWeights"]


class WbcWeights(Section):
    """Weights of the tasks in the quadratic programme."""

    com: NonNegative = Field(default=10.0, description="Acceleration of the centre of mass.")
    base_orientation: NonNegative = Field(default=10.0, description="Angular acceleration of the base.")
    angular_momentum: NonNegative = Field(default=1.0, description="Rate of the centroidal angular momentum.")
    posture: NonNegative = Field(default=0.1, description="Joint accelerations towards the reference posture.")
    feet: NonNegative = Field(default=1e3, description="Acceleration of the feet in contact (they should not move).")
    force_tracking: NonNegative = Field(default=1e-2, description="Contact forces, towards those of the MPC.")
    regularisation: NonNegative = Field(default=1e-5, description="All accelerations and forces.")


class WbcGains(Section):
    """Proportional gains of the tasks; their damping is critical (2 sqrt(kp)) unless given."""

    com: NonNegative = Field(default=100.0, description="Centre of mass, 1/s2.")
    base_orientation: NonNegative = Field(default=200.0, description="Orientation of the base, 1/s2.")
    angular_momentum: NonNegative = Field(default=10.0, description="Centroidal angular momentum, 1/s.")
    posture: NonNegative = Field(default=50.0, description="Joint positions, 1/s2.")
    feet: NonNegative = Field(default=0.0, description="Drift of the feet in contact, 1/s2.")
    joint_kp_nm: NonNegative = Field(default=0.0, description="Joint stiffness around the commanded torque, N.m/rad.")
    joint_kd_nms: NonNegative = Field(default=0.0, description="Joint damping around the commanded torque, N.m.s/rad.")


class WbcSection(Section):
    """Whole-body quadratic programme over accelerations and contact forces."""

    rate_hz: Positive = Field(default=1000.0, description="Ticks per second, Hz.")
    friction: Positive = Field(default=0.6, description="Friction coefficient that the controller relies on.")
    friction_facets: Annotated[int, Field(strict=True, ge=3, le=32)] = Field(
        default=8, description="Sides of the pyramid inscribed in the friction cone."
    )
    normal_force_n: Range = Field(
        default=(0.1, 40.0), description="[lowest, highest] normal force of a foot in contact, N."
    )
    fallback_damping_nms: NonNegative = Field(
        default=0.05, description="Joint damping added to the last command when the programme is not solved, N.m.s/rad."
    )
    weights: WbcWeights = Field(default=WbcWeights(), description="Weights of the tasks.")
    gains: WbcGains = Field(default=WbcGains(), description="Gains of the tasks.")
