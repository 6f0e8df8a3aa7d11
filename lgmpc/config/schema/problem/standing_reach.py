"""Problem ``standing_reach``: a humanoid on both feet puts its hand at a place and keeps its balance."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from lgmpc.settings import Count, NonNegative, Positive, Settings, Vector3, problem

__all__ = ["StandingReachProblem", "StandingReachWeightsSection"]


class StandingReachWeightsSection(Settings):
    """Weights of the cost; those of the running cost are per second of the horizon."""

    position: Positive = Field(default=1e4, description="Hand from its target at the end, 1/m2.")
    rotation: NonNegative = Field(default=1e3, description="Hand's rotation from its target at the end, 1/rad2.")
    rest: NonNegative = Field(default=1e2, description="All velocities at the end.")
    base: NonNegative = Field(default=1.0, description="Trunk from upright, 1/rad2.")
    posture: NonNegative = Field(default=0.3, description="Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = Field(default=0.1, description="Velocities of base and joints.")
    acceleration: NonNegative = Field(
        default=1e-2, description="Joint accelerations, 1/(rad/s2)2; without it the joints brake in the last moment."
    )
    effort: Positive = Field(default=0.1, description="Squared torques, as fractions of their limits.")


class StandingReachProblem(Settings):
    """A robot stands on soles at its contact frames and moves a hand from its reference posture to a target.

    Hard constraints keep joints and efforts within their limits, forces in friction cones, and pressure within the
    soles: a solver that takes constraints is needed (sqp, ipopt).
    """

    kind: Literal["standing_reach"] = Field(description="A hand reaches a place, standing.")
    frame: str = Field(min_length=1, description="Name of the hand's frame.")
    position_m: Vector3 = Field(description="[x, y, z] where its origin should be at the end, world axes, m.")
    rpy_deg: Vector3 | None = Field(
        default=None,
        description="[roll, pitch, yaw] of the frame at the end, about the world's x, y, z in this order, degrees. "
        "null: any rotation.",
    )
    sole_half_size_m: tuple[Positive, Positive] = Field(
        default=(0.1, 0.065), description="Half length and half width of the soles, centred at the contact frames, m."
    )
    sole_margin_m: NonNegative = Field(
        default=0.02, description="How far from a sole's edge its centre of pressure is kept, m."
    )
    friction: Positive = Field(default=0.5, description="Coefficient of the cones that the contact forces are kept in.")
    nodes: Count = Field(default=30, description="Number of intervals.")
    node_s: Positive = Field(default=0.05, description="Length of each interval, s.")
    weights: StandingReachWeightsSection = Field(
        default=StandingReachWeightsSection(), description="Weights of the cost."
    )

    @model_validator(mode="after")
    def _something_is_left(self) -> StandingReachProblem:
        if self.sole_margin_m >= min(self.sole_half_size_m):
            expected = f"less than {min(self.sole_half_size_m):g}, half of a sole's width"
            raise problem(expected, key="sole_margin_m", got=self.sole_margin_m)
        return self
