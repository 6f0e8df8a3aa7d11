"""All settings of locomotion, as a controller takes them."""

from __future__ import annotations

from pydantic import Field, model_validator
from typing_extensions import Self

from lgmpc.locomotion.clock import GaitClockSettings
from lgmpc.locomotion.command import CommandLimits
from lgmpc.locomotion.contacts import ContactEventSettings
from lgmpc.locomotion.footholds import FootholdSettings
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.reaction import StepReactionSettings
from lgmpc.locomotion.reference import ReferenceSettings
from lgmpc.locomotion.swing import SwingSettings
from lgmpc.settings import Problem, Settings, problems

__all__ = ["LocomotionSettings"]


class LocomotionSettings(Settings):
    """How a legged robot steps: gaits, footholds, swings, contact events, and the limits of commands."""

    gaits: tuple[Gait, ...] = Field(
        default=(), description="Gaits besides stand, walk, trot, pace, bound and pronk, or in place of them."
    )
    clock: GaitClockSettings = Field(default=GaitClockSettings(), description="Gait transitions.")
    footholds: FootholdSettings = Field(default=FootholdSettings(), description="Where feet are put down.")
    swing: SwingSettings = Field(default=SwingSettings(), description="The paths of feet through the air.")
    contacts: ContactEventSettings = Field(
        default=ContactEventSettings(), description="When a measured contact overrides the schedule."
    )
    reference: ReferenceSettings = Field(default=ReferenceSettings(), description="How commands are integrated.")
    reaction: StepReactionSettings = Field(
        default=StepReactionSettings(), description="Steps of a standing robot against pushes."
    )
    limits: CommandLimits = Field(default=CommandLimits(), description="Limits of commands and of their rates.")

    @model_validator(mode="after")
    def _distinct_names(self) -> Self:
        names = [gait.name for gait in self.gaits]
        found = [
            Problem(f"gaits.{i}.name", name, "a name of its own for each gait")
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        if found:
            raise problems(found)
        return self
