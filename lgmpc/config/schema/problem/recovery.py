"""Problem ``recovery``: a multirotor that is upside down, or tumbles, turns upright and hovers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.config.schema.problem.rotors import RotorsSection
from lgmpc.settings import Count, NonNegative, Positive, Settings, Vector3

__all__ = ["RecoveryProblem", "RecoveryWeightsSection"]


class RecoveryWeightsSection(Settings):
    """Weights of the cost; all but that of the goal are per second of the horizon."""

    position: NonNegative = Field(default=1.0, description="From where it began, on the way, 1/m2.")
    rotation: NonNegative = Field(
        default=1.0, description="From the attitude of the goal, on the way, 1/rad2 for small angles."
    )
    speed: NonNegative = Field(default=1e-2, description="Velocity on the way, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = Field(default=1e-2, description="Thrust of each rotor from hovering, 1/N2.")
    goal: Positive = Field(default=1e3, description="Position, attitude and velocity at the end.")


class RecoveryProblem(Settings):
    """A multirotor in any attitude turns upright and comes to rest where it began; thrusts are bounded."""

    kind: Literal["recovery"] = Field(description="A multirotor recovers from any attitude.")
    rotors: RotorsSection = Field(description="What pushes.")
    position_m: Vector3 = Field(
        default=(0.0, 0.0, 5.0), description="[x, y, z] where it begins, and should end, world axes, m."
    )
    rotation_deg: Vector3 = Field(
        default=(0.0, 180.0, 0.0), description="Attitude at first as a rotation vector (axis times angle), degrees."
    )
    velocity_m_s: Vector3 = Field(default=(0.0, 0.0, 0.0), description="Velocity at first, body axes, m/s.")
    angular_velocity_rad_s: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="Angular velocity at first, body axes, rad/s."
    )
    goal_rotation_deg: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Attitude at the end, degrees. More than half a turn tells the guess which way round: from "
        "[0, 150, 0] to [0, 360, 0], which is level, it goes on over its back.",
    )
    nodes: Count = Field(default=100, description="Number of intervals.")
    node_s: Positive = Field(default=0.025, description="Length of each interval, s.")
    weights: RecoveryWeightsSection = Field(default=RecoveryWeightsSection(), description="Weights of the cost.")
