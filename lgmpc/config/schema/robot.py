"""Config section ``robot``: which model, and what the model's file does not say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Union

from pydantic import Discriminator, Field, Tag, model_validator

from lgmpc.settings import Finite, NonNegative, PerJoint, PerJointPositive, PerJointRange, Settings, problem

__all__ = ["RobotSection"]


def _posture_kind(value: Any) -> str:
    return "angles" if isinstance(value, Mapping) else "name"


Posture = Annotated[
    Union[Annotated[str, Tag("name")], Annotated[dict[str, Finite], Tag("angles")]],  # noqa: UP007
    Discriminator(_posture_kind),
]


class RobotSection(Settings):
    """The robot that is controlled, and that the plant simulates."""

    model: str | None = Field(
        default=None, min_length=1, description="Name in example-robot-data, such as solo12. Give this or urdf."
    )
    urdf: Path | None = Field(default=None, description="URDF file, relative to the config file. Give this or model.")
    srdf: Path | None = Field(
        default=None, description="SRDF file with reference configurations, relative to the config file."
    )
    package_dirs: tuple[Path, ...] = Field(
        default=(),
        description="Folders in which package:// addresses of the URDF are looked up, relative to the config file.",
    )
    floating_base: bool | None = Field(
        default=None,
        strict=True,
        description="Whether the base moves freely. null: as the named model has it; true for a URDF.",
    )
    contact_frames: tuple[str, ...] = Field(
        default=(), description="Frames that touch the ground, in the order of the logs."
    )
    contact_radius_m: NonNegative = Field(
        default=0.0,
        description="Radius of the spherical feet in m; 0 for point feet. The contact point lies this far below.",
    )
    posture: Posture | None = Field(
        default=None,
        description="Reference posture: name of an SRDF reference configuration, or {joint name or pattern: rad or m}. "
        "null: the named model's own.",
    )
    effort_limit_nm: PerJointPositive | None = Field(
        default=None,
        description="Largest torque in N.m: a number, or {joint name or pattern: number}. null: the URDF's.",
    )
    velocity_limit_rad_s: PerJointPositive | None = Field(
        default=None,
        description="Largest joint speed in rad/s: a number, or {joint name or pattern: number}. null: the URDF's.",
    )
    position_limit_rad: PerJointRange | None = Field(
        default=None,
        description="[lowest, highest] joint position in rad, or {pattern: [lowest, highest]}. null: the URDF's.",
    )
    armature_kg_m2: PerJoint | None = Field(
        default=None,
        description="Reflected rotor inertia in kg.m2: a number, or {joint name or pattern: number}. null: the SRDF's, "
        "or 0.",
    )

    @model_validator(mode="after")
    def _one_source(self) -> RobotSection:
        if self.model is None and self.urdf is None:
            raise problem("a robot's name here, or a file in robot.urdf", key="model", got=None)
        if self.model is not None and self.urdf is not None:
            raise problem(f"no file here, because robot.model is given ({self.model})", key="urdf", got=str(self.urdf))
        return self

    @model_validator(mode="after")
    def _distinct_frames(self) -> RobotSection:
        for i, frame in enumerate(self.contact_frames):
            if frame in self.contact_frames[:i]:
                raise problem("each frame once", key=f"contact_frames.{i}", got=frame)
        return self
