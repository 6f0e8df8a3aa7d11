"""Actuated joints of a model, and values assigned to them by name patterns."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TypeVar

import numpy as np
import pinocchio as pin

from lgmpc.errors import nearest
from lgmpc.robot.names import is_floating
from lgmpc.typing import Array

T = TypeVar("T")

_PRISMATIC = ("JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismaticUnaligned")


@dataclass(frozen=True)
class ActuatedJoint:
    """A joint that is not the floating base.

    Attributes:
        name: its name.
        index: its index in the model.
        q: its entries of the configuration.
        v: its entries of the velocity.
        prismatic: whether it is prismatic.
        scalar: whether its position is one number, so that it can have position limits.
        circular: whether its position is an angle without limits, stored as (cos, sin).
    """

    name: str
    index: int
    q: slice
    v: slice
    prismatic: bool
    scalar: bool
    circular: bool


def actuated_joints(model: pin.Model) -> tuple[ActuatedJoint, ...]:
    """Return all joints of ``model`` but the floating base (and any other free-flyer), in order."""
    joints = []
    for index in range(2 if is_floating(model) else 1, model.njoints):
        joint = model.joints[index]
        if joint.nv == 6:
            continue
        joints.append(
            ActuatedJoint(
                model.names[index],
                index,
                slice(joint.idx_q, joint.idx_q + joint.nq),
                slice(joint.idx_v, joint.idx_v + joint.nv),
                prismatic=joint.shortname() in _PRISMATIC,
                scalar=joint.nq == 1,
                circular=(joint.nq, joint.nv) == (2, 1),
            )
        )
    return tuple(joints)


def match_joints(
    values: Mapping[str, T], names: Sequence[str], argument: str, kind: str = "joint"
) -> tuple[dict[str, T], list[str]]:
    """Return for each joint the value of the key that matches it: its own name, else the last pattern that matches.

    Returns:
        The values by joint name, and one problem for each key that matches no joint.
    """
    found = {}
    for name in names:
        keys = [key for key in values if fnmatchcase(name, key)]
        if name in values:
            found[name] = values[name]
        elif keys:
            found[name] = values[keys[-1]]
    problems = []
    for key in values:
        if not any(key == name or fnmatchcase(name, key) for name in names):
            close = nearest(key, names) or tuple(names)
            problems.append(f"{argument}: '{key}' matches no {kind}; there are {', '.join(close) or 'none'}")
    return found, problems


def joint_values(
    values: float | Mapping[str, float] | None, joints: Iterable[ActuatedJoint], own: Array, argument: str
) -> tuple[Array, list[str]]:
    """Return (nv,) ``own`` with the joints' ``values`` substituted, and the problems of their keys."""
    joints = tuple(joints)
    result = np.array(own, dtype=np.float64)
    problems: list[str] = []
    if isinstance(values, Mapping):
        given, problems = match_joints(values, [j.name for j in joints], argument)
        for joint in joints:
            if joint.name in given:
                result[joint.v] = given[joint.name]
    elif values is not None:
        for joint in joints:
            result[joint.v] = values
    return result, problems


def joint_ranges(
    ranges: tuple[float, float] | Mapping[str, tuple[float, float]] | None,
    joints: Iterable[ActuatedJoint],
    own: Callable[[ActuatedJoint], tuple[float, float]],
) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Return (lowest, highest) of each joint with scalar position, and the problems of the keys of ``ranges``."""
    joints = tuple(joint for joint in joints if joint.scalar)
    names = [joint.name for joint in joints]
    given: dict[str, tuple[float, float]] = {}
    problems: list[str] = []
    if isinstance(ranges, Mapping):
        given, problems = match_joints(ranges, names, "position_limit_rad", "joint that can have position limits")
    elif ranges is not None:
        given = dict.fromkeys(names, (ranges[0], ranges[1]))
    return {j.name: given.get(j.name) or own(j) for j in joints}, problems


def one_side(limits: tuple[float, float], position: float, distance: float) -> tuple[float, float]:
    """Return the part of the limits on the same side of zero as ``position``, and at least ``distance`` from zero.

    Args:
        limits: (lowest, highest) position, rad.
        position: in the reference posture, rad.
        distance: rad; NaN for a joint that may be on both sides.
    """
    lowest, highest = limits
    if math.isnan(distance):
        return limits
    return (max(lowest, distance), highest) if position > 0.0 else (lowest, min(highest, -distance))
