"""What the user says about a robot: which model it is, and what the model's file does not say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Union

from lgmpc.errors import InputError

__all__ = ["PerJoint", "PerJointRange", "RobotSpec"]

PerJoint = Union[float, Mapping[str, float]]  # noqa: UP007 (evaluated at run time, also by Python 3.10)
"""One number for all joints, or {joint name or glob pattern: number}."""

PerJointRange = Union[tuple[float, float], Mapping[str, tuple[float, float]]]  # noqa: UP007
"""One (lowest, highest) for all joints, or {joint name or glob pattern: (lowest, highest)}."""


@dataclass(frozen=True)
class RobotSpec:
    """Which robot to load, and its contact frames, posture and actuators.

    Mappings have joint names or glob patterns (``"*_KFE"``, ``"F?_HFE"``) as keys. An exact name wins over patterns,
    and among patterns the last that matches wins. Joints that no key matches keep what the model's file says.

    Attributes:
        model: name in example-robot-data, such as ``"solo12"``. Exactly one of ``model`` and ``urdf`` is given.
        urdf: path of a URDF file.
        srdf: SRDF with reference configurations and rotor parameters. A named model brings its own.
        package_dirs: folders in which ``package://`` addresses of the URDF's meshes are looked up.
        floating_base: whether the base moves freely. None: as example-robot-data has the named model; True for a URDF.
        contact_frames: frames that touch the ground, in the order of all contact arrays.
        contact_radius: radius of spherical feet, m; 0 for point feet.
        posture: name of an SRDF reference configuration, or {joint name or pattern: rad or m}; joints not named are at
            zero, or at the nearest limit. None: the named model's own reference configuration, else all joints so.
        effort_limit: largest torque, N.m (force, N, for prismatic joints). None: the URDF's.
        velocity_limit: largest joint speed, rad/s (m/s for prismatic joints). None: the URDF's.
        armature: reflected rotor inertia, kg.m2 (kg for prismatic joints). None: the SRDF's rotor parameters, else 0.
        position_limit: (lowest, highest) joint position, rad (m). None: the URDF's.

    Raises:
        InputError: a value that no robot could have; what depends on the model is checked by ``load_robot``.
    """

    model: str | None = None
    urdf: Path | None = None
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()
    floating_base: bool | None = None
    contact_frames: tuple[str, ...] = ()
    contact_radius: float = 0.0
    posture: str | Mapping[str, float] | None = None
    effort_limit: PerJoint | None = None
    velocity_limit: PerJoint | None = None
    armature: PerJoint | None = None
    position_limit: PerJointRange | None = None

    def __post_init__(self) -> None:
        if (self.model is None) == (self.urdf is None):
            got = "neither" if self.model is None else f"model={self.model!r} and urdf={str(self.urdf)!r}"
            raise InputError("model, urdf", got, "exactly one of the two: a name in example-robot-data or a file")
        for i, frame in enumerate(self.contact_frames):
            if frame in self.contact_frames[:i]:
                raise InputError("contact_frames", frame, "each frame once")
        _require(self.contact_radius, "contact_radius", "a length >= 0 m", lambda x: x >= 0)
        _require_each(self.effort_limit, "effort_limit", "a torque > 0 N.m", lambda x: x > 0)
        _require_each(self.velocity_limit, "velocity_limit", "a speed > 0 rad/s", lambda x: x > 0)
        _require_each(self.armature, "armature", "an inertia >= 0 kg.m2", lambda x: x >= 0)
        if isinstance(self.posture, Mapping):
            _require_each(self.posture, "posture", "an angle in rad", lambda x: True)
        ranges = self.position_limit
        for key, limits in ranges.items() if isinstance(ranges, Mapping) else [("", ranges)] if ranges else []:
            name = f"position_limit['{key}']" if key else "position_limit"
            if len(limits) != 2 or not all(math.isfinite(x) for x in limits) or limits[0] >= limits[1]:
                raise InputError(name, tuple(limits), "two finite numbers (lowest, highest), rising")


def _require_each(values: PerJoint | None, argument: str, expected: str, accept: Callable[[float], bool]) -> None:
    if isinstance(values, Mapping):
        for key, value in values.items():
            _require(value, f"{argument}['{key}']", expected, accept)
    elif values is not None:
        _require(values, argument, expected, accept)


def _require(value: float, argument: str, expected: str, accept: Callable[[float], bool]) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or not accept(value):
        raise InputError(argument, value, expected)
