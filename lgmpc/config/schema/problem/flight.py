"""Problem ``flight``: a multirotor flies through waypoints, at some of them in given attitudes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from lgmpc.config.schema.problem.rotors import RotorsSection
from lgmpc.settings import NonNegative, Positive, Settings, Vector3

__all__ = ["FlightProblem", "FlightWaypointSection", "FlightWeightsSection"]


class FlightWaypointSection(Settings):
    """A place and, if it matters, an attitude at a time."""

    name: str = Field(min_length=1, description="For the replay.")
    time_s: Positive = Field(description="When, s; a multiple of problem.node_s.")
    position_m: Vector3 = Field(description="[x, y, z] of the body, world axes, m.")
    rotation_deg: Vector3 | None = Field(
        default=None,
        description="Attitude as a rotation vector (axis times angle), degrees; null: any. More than half a turn tells "
        "the solver's guess which way round: [0, -180, 0] and then [0, -360, 0] is a loop, nose up.",
    )


class FlightWeightsSection(Settings):
    """Weights of the cost; those of speed and thrust are per second of the horizon."""

    position: Positive = Field(default=1e3, description="From a waypoint, 1/m2.")
    rotation: Positive = Field(default=1e3, description="From a waypoint's attitude, 1/rad2 for small angles.")
    rest: NonNegative = Field(default=1e2, description="Velocity at the end, 1/(m/s)2 and 1/(rad/s)2.")
    speed: NonNegative = Field(default=1e-2, description="Velocity on the way, 1/(m/s)2 and 1/(rad/s)2.")
    thrust: Positive = Field(default=1e-2, description="Thrust of each rotor from hovering, 1/N2.")


class FlightProblem(Settings):
    """A multirotor flies through waypoints and comes to rest at the last; thrusts are bounded."""

    kind: Literal["flight"] = Field(description="A multirotor flies through waypoints.")
    rotors: RotorsSection = Field(description="What pushes.")
    start_m: Vector3 = Field(description="[x, y, z] where it hovers at first, level, world axes, m.")
    waypoints: Annotated[tuple[FlightWaypointSection, ...], Field(min_length=1)] = Field(
        description="In the order of their times."
    )
    node_s: Positive = Field(default=0.03, description="Length of each interval, s.")
    weights: FlightWeightsSection = Field(default=FlightWeightsSection(), description="Weights of the cost.")
