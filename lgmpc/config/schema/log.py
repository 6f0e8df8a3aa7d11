"""Config section ``log``: what is recorded."""

from __future__ import annotations

from pydantic import Field

from lgmpc.config.schema.base import Positive, Section

__all__ = ["LogSection"]


class LogSection(Section):
    """The recording of a run."""

    rate_hz: Positive = Field(default=500.0, description="Recorded ticks per second, Hz; divides wbc.rate_hz.")
