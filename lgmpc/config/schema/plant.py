"""Config section ``plant``: the simulated world, which may differ from what the controller believes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from lgmpc.settings import NonNegative, Positive, Settings, Vector3

__all__ = ["PlantSection"]


class PlantSection(Settings):
    """The physics engine and its parameters."""

    kind: Literal["mujoco", "pinocchio"] = Field(default="mujoco", description="Physics engine.")
    rate_hz: Annotated[Positive, Field(le=1e5)] = Field(
        default=1000.0, description="Steps of the engine per second, Hz."
    )
    friction: Positive = Field(default=0.6, description="Coulomb friction coefficient between feet and floor.")
    joint_friction_nm: NonNegative = Field(default=0.0, description="Coulomb friction of every joint, N.m.")
    joint_damping_nms: NonNegative = Field(default=0.0, description="Viscous friction of every joint, N.m.s/rad.")
    mass_scale: Positive = Field(default=1.0, description="Factor on every mass and inertia of the simulated robot.")
    base_added_mass_kg: NonNegative = Field(
        default=0.0, description="Payload at the base's centre of mass that the controllers do not know of, kg."
    )
    base_com_offset_m: Vector3 = Field(
        default=(0.0, 0.0, 0.0),
        description="Shift of the base's centre of mass unknown to the controllers, base axes, m.",
    )
