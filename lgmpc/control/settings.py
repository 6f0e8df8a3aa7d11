"""Settings of the modes: lying and rising, giving up, and moving again afterwards."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lgmpc.control.fall_monitor import FallSettings
from lgmpc.control.lying import LyingSettings
from lgmpc.settings import Positive, Settings

__all__ = ["ModeSettings"]


class ModeSettings(Settings):
    """How a robot lies, rises, gives up, and begins again."""

    lying: LyingSettings = Field(default=LyingSettings(), description="Lying on the belly, rising and lying down.")
    fall: FallSettings = Field(default=FallSettings(), description="When balancing is given up.")
    rearm: Literal["on_command", "automatic"] = Field(
        default="on_command",
        description="When a damped robot that lies still on its belly folds its legs again: once the commanded mode"
        " has changed since it was damped, or by itself.",
    )
    rest_s: Positive = Field(default=0.3, description="How long it lies still before, s.")
    displaced_m: Positive = Field(
        default=0.05, description="Distance from its place beyond which a foot of a robot at rest steps back, m."
    )
    displaced_s: Positive = Field(default=0.3, description="How long it stands there before, s.")
