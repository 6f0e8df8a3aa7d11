"""Problem ``com_circle``: the centre of mass follows a circle while all feet stay."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.settings import Count, NonNegative, Positive, Settings

__all__ = ["ComCircleProblem", "ComCircleWeightsSection"]


class ComCircleWeightsSection(Settings):
    """Weights of the squared deviations, per second of the horizon."""

    com: Positive = Field(default=1e4, description="Centre of mass from the circle, 1/m2.")
    com_velocity: NonNegative = Field(default=0.1, description="Velocity of the centre of mass, 1/(m/s)2.")
    base_orientation: NonNegative = Field(default=10.0, description="Base from upright, 1/rad2.")
    posture: NonNegative = Field(default=0.5, description="Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = Field(default=0.1, description="Velocities of base and joints.")
    effort: NonNegative = Field(
        default=0.1, description="Torques from those that hold the robot at rest under its contact forces, 1/(N.m)2."
    )
    cone: NonNegative = Field(default=1.0, description="Contact forces outside their friction cones, 1/N2.")


class ComCircleProblem(Settings):
    """A robot on its feet draws a horizontal circle with its centre of mass; contact forward dynamics."""

    kind: Literal["com_circle"] = Field(description="The centre of mass follows a circle.")
    radius_m: Positive = Field(default=0.065, description="Radius of the circle, m; it begins at its foremost point.")
    frequency_hz: Positive = Field(default=0.2, description="Turns per second, Hz.")
    nodes: Count = Field(default=50, description="Number of intervals.")
    node_s: Positive = Field(default=0.02, description="Length of each interval, s.")
    friction: Positive = Field(
        default=0.6, description="Friction coefficient of the cones that the contact forces are drawn into."
    )
    weights: ComCircleWeightsSection = Field(default=ComCircleWeightsSection(), description="Weights of the cost.")
