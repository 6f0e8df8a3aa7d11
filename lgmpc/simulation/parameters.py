"""What a simulated world may have different from the controller's model, and the robot model that results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError

if TYPE_CHECKING:
    from lgmpc.robot import Robot

__all__ = ["SOLO12_GEOMETRY", "BodyGeometry", "PlantParameters", "body_geometry", "simulated_model"]


def _check(name: str, value: float, lowest: float = -math.inf, *, open_end: bool = False) -> None:
    """Refuse what is not a finite number from ``lowest`` on (above it, if ``open_end``)."""
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or value < lowest or (open_end and value == lowest):
        bound = "" if lowest == -math.inf else f" above {lowest:g}" if open_end else f" not below {lowest:g}"
        raise InputError(name, repr(value), f"a finite number{bound}")


def _check_triple(name: str, value: tuple[float, float, float], lowest: float = -math.inf) -> None:
    if not isinstance(value, tuple) or len(value) != 3:
        raise InputError(name, repr(value), "a tuple of three numbers")
    for axis, number in zip("xyz", value, strict=True):
        _check(f"{name}.{axis}", number, lowest, open_end=True)


@dataclass(frozen=True)
class BodyGeometry:
    """What else of the robot than its feet can touch the floor.

    Attributes:
        sphere_frames: glob pattern of the frames that carry a sphere; empty for none.
        sphere_radius: radius of those spheres, m.
        box_half_sizes: half sizes of a box about the origin of the first moving body, m; ``None`` for no box.

    Raises:
        InputError: if a size is not a finite number above zero.
    """

    sphere_frames: str = ""
    sphere_radius: float = 0.01
    box_half_sizes: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        _check("sphere_radius", self.sphere_radius, 0.0, open_end=True)
        if self.box_half_sizes is not None:
            _check_triple("box_half_sizes", self.box_half_sizes, 0.0)


SOLO12_GEOMETRY = BodyGeometry("*_LOWER_LEG", 0.012, (0.20, 0.08, 0.03))
"""Knees and trunk of Solo12, as the benchmark plant has them."""

_KNOWN_GEOMETRY = {"solo12": SOLO12_GEOMETRY}


@dataclass(frozen=True)
class PlantParameters:
    """Parameters of the simulated world.

    Attributes:
        timestep: duration of one step, s.
        friction: Coulomb coefficient between robot and floor.
        mass_scale: factor on every mass and inertia.
        base_added_mass: point mass fixed to the first moving body at its centre of mass, kg (not scaled).
        base_com_offset: displacement of that body's centre of mass (payload included), its own axes, m.
        joint_friction: Coulomb friction of every joint, N.m.
        joint_damping: viscous friction of every joint, N.m.s/rad.
        geometry: what else than the feet touches the floor; ``None`` takes what is known for the robot's name
            (:data:`SOLO12_GEOMETRY` for solo12), else nothing.

    Raises:
        InputError: if a value is not finite or has the wrong sign; it names the parameter.
    """

    timestep: float = 1e-3
    friction: float = 0.6
    mass_scale: float = 1.0
    base_added_mass: float = 0.0
    base_com_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joint_friction: float = 0.0
    joint_damping: float = 0.0
    geometry: BodyGeometry | None = None

    def __post_init__(self) -> None:
        for name in ("timestep", "friction", "mass_scale"):
            _check(name, getattr(self, name), 0.0, open_end=True)
        for name in ("base_added_mass", "joint_friction", "joint_damping"):
            _check(name, getattr(self, name), 0.0)
        _check_triple("base_com_offset", self.base_com_offset)


def body_geometry(robot: Robot, params: PlantParameters) -> BodyGeometry:
    """Return the collision geometry besides the feet: the one asked for, else the one known for this robot."""
    return params.geometry or _KNOWN_GEOMETRY.get(robot.name, BodyGeometry())


def simulated_model(robot: Robot, params: PlantParameters) -> pin.Model:
    """Return a copy of the robot's model with the masses of the simulated world; both plants are built from it."""
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        mass, lever, inertia = body.mass * params.mass_scale, body.lever, body.inertia * params.mass_scale
        if joint == 1:
            mass += params.base_added_mass
            lever = lever + np.asarray(params.base_com_offset)
        model.inertias[joint] = pin.Inertia(mass, lever, inertia)
    return model
