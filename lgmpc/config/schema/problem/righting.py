"""Problem ``righting``: a legged robot that falls upside down turns upright in the air."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.settings import Count, Finite, NonNegative, Positive, Settings, Vector3

__all__ = ["RightingProblem", "RightingWeightsSection", "StrokesSection"]


class StrokesSection(Settings):
    """Cycles of the legs: stretched one way, folded back. The guess, which is drawn on."""

    stretched_rad: dict[str, Finite] = Field(
        description="Posture in which they swing forth, {joint name or pattern: rad}; joints not named are at 0."
    )
    folded_rad: dict[str, Finite] = Field(description="Posture in which they swing back, {joint name or pattern: rad}.")
    sweep_rad: dict[str, Finite] = Field(
        description="Amplitude of the swing, {joint name or pattern: rad}; the robot turns against its sign."
    )
    count: Count = Field(default=5, description="Number of cycles.")
    ramp_s: Positive = Field(
        default=0.12, description="Time in which they begin from the reference posture, and end in it, s."
    )


class RightingWeightsSection(Settings):
    """Weights of the cost; the first three are per second of the horizon."""

    strokes: NonNegative = Field(default=1.0, description="Joints from the strokes, 1/rad2.")
    rates: NonNegative = Field(default=1e-3, description="Joint rates from those of the strokes, 1/(rad/s)2.")
    effort: Positive = Field(default=1e-2, description="Torques, 1/(N.m)2.")
    rotation: Positive = Field(default=1e2, description="From the attitude of the goal, at the end, 1/rad2.")
    posture: NonNegative = Field(default=1e2, description="Joints from the reference posture, at the end, 1/rad2.")
    rest: NonNegative = Field(default=1.0, description="Joint rates at the end, 1/(rad/s)2.")


class RightingProblem(Settings):
    """A falling robot without angular momentum turns upright by moving its legs only.

    Torques, joint positions and joint rates are hard constraints: a solver that takes them is needed (sqp, ipopt).
    """

    kind: Literal["righting"] = Field(description="A falling robot lands on its feet.")
    strokes: StrokesSection = Field(description="How the legs move in the guess.")
    position_m: Vector3 = Field(default=(0.0, 0.0, 8.0), description="[x, y, z] of the base at first, world axes, m.")
    rotation_deg: Vector3 = Field(
        default=(180.0, 0.0, 0.0), description="Its attitude at first as a rotation vector (axis times angle), degrees."
    )
    velocity_m_s: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Velocity at first, world axes, m/s: upwards for a toss."
    )
    goal_rotation_deg: Vector3 = Field(default=(0.0, 0.0, 0.0), description="Attitude at the end, degrees.")
    trunk_half_size_m: tuple[Positive, Positive, Positive] = Field(
        default=(0.2, 0.08, 0.03), description="Half sizes of the box from which the shanks' distance is measured, m."
    )
    nodes: Count = Field(default=240, description="Number of intervals.")
    node_s: Positive = Field(default=0.005, description="Length of each interval, s.")
    weights: RightingWeightsSection = Field(default=RightingWeightsSection(), description="Weights of the cost.")
