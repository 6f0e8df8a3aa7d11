"""Problem ``reach``: an arm puts a frame at a place and is at rest there."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.settings import Count, NonNegative, Positive, Settings, Vector3

__all__ = ["ReachProblem", "ReachWeightsSection"]


class ReachWeightsSection(Settings):
    """Weights of the cost; those of the running cost are per second of the horizon."""

    position: Positive = Field(default=1e5, description="Frame from its target at the end, 1/m2.")
    rotation: NonNegative = Field(default=1e4, description="Frame's rotation from its target at the end, 1/rad2.")
    rest: NonNegative = Field(default=1e3, description="Joint velocities at the end, 1/(rad/s)2.")
    posture: NonNegative = Field(default=1.0, description="Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = Field(default=1.0, description="Joint velocities, 1/(rad/s)2.")
    effort: Positive = Field(
        default=1e-3, description="Efforts from those that hold the robot against gravity, 1/(N.m)2."
    )
    limits: NonNegative = Field(
        default=1e4, description="Joints beyond their position and velocity limits, 1/rad2 and 1/(rad/s)2."
    )


class ReachProblem(Settings):
    """A robot with a fixed base moves a frame from where its reference posture has it to a target."""

    kind: Literal["reach"] = Field(description="A frame reaches a place.")
    frame: str = Field(min_length=1, description="Name of the frame that reaches.")
    position_m: Vector3 = Field(description="[x, y, z] where its origin should be at the end, world axes, m.")
    rpy_deg: Vector3 | None = Field(
        default=None,
        description="[roll, pitch, yaw] of the frame at the end, about the world's x, y, z in this order, degrees. "
        "null: any rotation.",
    )
    nodes: Count = Field(default=100, description="Number of intervals.")
    node_s: Positive = Field(default=0.01, description="Length of each interval, s.")
    weights: ReachWeightsSection = Field(default=ReachWeightsSection(), description="Weights of the cost.")
