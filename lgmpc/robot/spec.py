"""The settings of a robot: its files, and properties that these lack."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Union

from pydantic import Discriminator, Field, Tag, model_validator

from lgmpc.robot.collision import AnyShape
from lgmpc.robot.soles import FootSpec
from lgmpc.settings import Finite, NonNegative, PerJoint, PerJointRange, Positive, Settings, key, problem


def _posture_kind(value: Any) -> str:
    return "angles" if isinstance(value, Mapping) else "name"


Posture = Annotated[
    Union[Annotated[str, Tag("name")], Annotated[dict[str, Finite], Tag("angles")]],  # noqa: UP007
    Discriminator(_posture_kind),
]

Torque = Annotated[Positive, Field(ge=1e-6, le=1e5)]
"""N.m."""
Speed = Annotated[Positive, Field(ge=1e-3, le=1e4)]
"""rad/s; the largest is 100,000 rpm."""
Inertia = Annotated[NonNegative, Field(le=1e3)]
"""kg.m2 of a rotor, reflected through its gears."""
Friction = Annotated[NonNegative, Field(le=1e4)]
"""N.m."""
Distance = Annotated[NonNegative, Field(le=10.0)]
"""rad or m."""


class RobotSpec(Settings):
    """The robot that is controlled and simulated.

    Tables have joint names or glob patterns (``"*_KFE"``, ``"F?_HFE"``) as keys. An exact name has
    precedence over patterns, and the last matching pattern over others. Joints that no key matches keep the values of
    the model's file. For prismatic joints the units are m instead of rad and N instead of N.m.
    """

    model: str | None = Field(
        default=None, min_length=1, description="Name in example-robot-data, such as solo12; excludes urdf."
    )
    urdf: Path | None = key(None, "URDF file, relative to the config file; excludes model.")
    srdf: Path | None = key(
        None,
        "SRDF file with reference configurations and rotor parameters, relative to the config file. null: "
        "that of the named model.",
    )
    package_dirs: tuple[Path, ...] = key((), "Folders of the URDF's packages, relative to the config file.")
    floating_base: bool | None = Field(
        default=None,
        strict=True,
        description="Whether the base moves freely. null: as in the named model; true for a URDF.",
    )
    contact_frames: tuple[str, ...] = key((), "Frames that touch the ground, in the order of the logs.")
    contact_radius_m: Annotated[NonNegative, Field(le=0.5)] = key(
        0.0,
        "Radius of the spherical feet in m, at most 0.5; 0 for point feet. The contact point is this far "
        "below the frame's origin.",
    )
    feet: tuple[FootSpec, ...] = key((), "Feet with soles, in the order of the logs; instead of contact_frames.")
    posture: Posture | None = key(
        None,
        "Reference posture: name of an SRDF reference configuration, or {joint name or pattern: rad or m}. "
        "null: that of the named model.",
    )
    effort_limit_nm: PerJoint[Torque] | None = key(
        None, "Largest torque in N.m: a number, or {joint name or pattern: number}. null: the URDF's."
    )
    velocity_limit_rad_s: PerJoint[Speed] | None = key(
        None, "Largest joint speed in rad/s: a number, or {joint name or pattern: number}. null: the URDF's."
    )
    position_limit_rad: PerJointRange | None = key(
        None, "[lowest, highest] joint position in rad, or {pattern: [lowest, highest]}. null: the URDF's."
    )
    one_sided_rad: PerJoint[Distance] | None = key(
        None,
        "Least distance from zero, in rad, of joints that stay on the side on which they are in the "
        "reference posture, such as knees: a number, or {joint name or pattern: number}. null: none.",
    )
    armature_kg_m2: PerJoint[Inertia] | None = key(
        None, "Reflected rotor inertia in kg.m2: a number, or {joint name or pattern: number}. null: the SRDF's, or 0."
    )
    joint_friction_nm: PerJoint[Friction] | None = key(
        None,
        "Coulomb friction in N.m, as identified, which the controllers compensate: a number, or {joint "
        "name or pattern: number}. null: none.",
    )

    collision_shapes: tuple[AnyShape, ...] | None = key(
        None,
        "Collision shapes with the floor besides the feet: spheres, boxes and capsules on links. null: one "
        "around each part of the URDF's collision geometry, except on bodies with a contact frame.",
    )

    @model_validator(mode="after")
    def _one_source(self) -> "RobotSpec":
        if self.model is None and self.urdf is None:
            raise problem("a robot's name here, or a file in the key urdf", key="model", got=None)
        if self.model is not None and self.urdf is not None:
            raise problem(f"no file here, because model is given ({self.model})", key="urdf", got=str(self.urdf))
        return self

    @model_validator(mode="after")
    def _distinct_frames(self) -> "RobotSpec":
        for i, frame in enumerate(self.contact_frames):
            if frame in self.contact_frames[:i]:
                raise problem("each frame once", key=f"contact_frames.{i}", got=frame)
        names = [foot.frame for foot in self.feet]
        for i, frame in enumerate(names):
            if frame in names[:i]:
                raise problem("each frame once", key=f"feet.{i}.frame", got=frame)
        if self.feet and self.contact_frames:
            raise problem("none, because feet are given", key="contact_frames", got=", ".join(self.contact_frames))
        if self.feet and self.contact_radius_m:
            raise problem("0, because feet have soles", key="contact_radius_m", got=self.contact_radius_m)
        return self
