"""Config section ``log``: what is recorded."""

from __future__ import annotations

from pydantic import Field

from lgmpc.settings import Positive, Settings

__all__ = ["LogSection"]


class LogSection(Settings):
    """The recording of a run."""

    rate_hz: Positive = Field(default=500.0, description="Recorded ticks per second, Hz; divides wbc.rate_hz.")
