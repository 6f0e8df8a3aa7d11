"""The rotors of problems that fly."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from lgmpc.settings import Finite, Positive, Settings, problem

__all__ = ["RotorsSection"]


class RotorsSection(Settings):
    """What a URDF does not say about rotors; each pushes along its frame's z axis, from 0 to the largest thrust."""

    frames: tuple[str, ...] = Field(min_length=1, description="Names of the rotors' frames.")
    turning: tuple[Literal["ccw", "cw"], ...] = Field(
        description="Sense of each rotor seen from above; its drag turns the body the other way."
    )
    max_thrust_n: Positive = Field(description="Largest thrust of each rotor, N.")
    drag_ratio_m: Finite = Field(default=0.0, ge=0.0, description="Moment about its axis per thrust, m.")

    @model_validator(mode="after")
    def _one_sense_each(self) -> RotorsSection:
        if len(self.turning) != len(self.frames):
            raise problem(f"{len(self.frames)} of ccw and cw, one a frame", key="turning", got=list(self.turning))
        return self
