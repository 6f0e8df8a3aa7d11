"""Config section ``reference``: what the robot is asked to do."""

from __future__ import annotations

from typing import Annotated, Literal, Union

from pydantic import Field

from lgmpc.settings import NonNegative, Positive, Settings

__all__ = ["ComCircleReference", "ReferenceSection", "StandReference"]


class StandReference(Settings):
    """Stand still in the reference posture."""

    kind: Literal["stand"] = Field(default="stand", description="Stand still.")


class ComCircleReference(Settings):
    """Move the centre of mass along a horizontal circle while all feet stay."""

    kind: Literal["com_circle"] = Field(default="com_circle", description="Move the centre of mass along a circle.")
    radius_m: Positive = Field(default=0.03, description="Radius of the circle, m.")
    frequency_hz: Positive = Field(default=0.5, description="Turns per second, Hz.")
    start_s: NonNegative = Field(default=1.0, description="When the movement begins, s.")
    ramp_s: Positive = Field(default=1.0, description="Time over which the radius grows from 0, s.")


ReferenceSection = Annotated[
    Union[StandReference, ComCircleReference],  # noqa: UP007
    Field(discriminator="kind"),
]
