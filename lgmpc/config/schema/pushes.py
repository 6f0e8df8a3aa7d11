"""Config section ``pushes``: disturbances that the plant applies."""

from __future__ import annotations

from pydantic import Field

from lgmpc.settings import NonNegative, Positive, Settings, Vector3

__all__ = ["PushSection"]


class PushSection(Settings):
    """A constant force at a body's centre of mass, for a while."""

    body: str = Field(min_length=1, description="Name of the pushed body (link).")
    time_s: NonNegative = Field(description="When the push begins, s.")
    duration_s: Positive = Field(default=0.2, description="How long it lasts, s.")
    impulse_ns: Vector3 = Field(description="[x, y, z] force times duration, world axes, N.s.")
