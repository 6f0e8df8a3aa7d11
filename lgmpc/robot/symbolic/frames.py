"""Frames fixed to bodies: placements, Jacobians, velocities and classical accelerations, in three choices of axes."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot.names import frame_index
from lgmpc.robot.symbolic.dynamics import Wrench
from lgmpc.robot.symbolic.passes import Acceleration, Placement, Rotation
from lgmpc.robot.symbolic.tree import Tree


@dataclass(frozen=True)
class Frame:
    """A frame fixed to a body.

    Attributes:
        joint: index of the joint that moves it; 0 is the world.
        placement: in that joint's frame, constant.
    """

    joint: int
    placement: Placement


def read_frame(model: pin.Model, frame: int | str) -> Frame:
    """Return the frame of this name or index.

    Raises:
        InputError: there is none; the nearest names are listed.
    """
    index = frame_index(model, frame) if isinstance(frame, str) else int(frame)
    if not 0 <= index < model.nframes:
        raise InputError("frame", frame, f"an index below {model.nframes}, or a name")
    found = model.frames[index]
    rotation, translation = np.asarray(found.placement.rotation), np.asarray(found.placement.translation)
    return Frame(int(found.parentJoint), Placement(ca.DM(rotation), ca.DM(translation)))


def jacobian(
    tree: Tree, frame: Frame, steps: list[Placement], placed: list[Placement], reference: Any, like: Any
) -> Any:
    """Return (6, nv), linear first: the Jacobian of ``frame`` in the axes of ``reference``.

    LOCAL accumulates placements from the frame to the root, independent of the base's placement; the others use world
    placements.
    """
    matrix = type(like)(6, tree.nv)
    target = placed[frame.joint].compose(frame.placement).translation
    reached = frame.placement
    back, offset = reached.rotation.T, -ca.mtimes(reached.rotation.T, reached.translation)
    for index in tree.support(frame.joint):
        joint = tree.joints[index - 1]
        if reference == pin.LOCAL:
            rotation, arm = back, offset
        else:
            rotation = placed[index].rotation
            arm = placed[index].translation
            arm = arm if reference == pin.WORLD else arm - target
        angular = ca.mtimes(rotation, joint.angular)
        linear = ca.mtimes(rotation, joint.linear) + ca.mtimes(ca.skew(arm), angular)
        matrix[:, joint.v] = ca.vertcat(linear, angular)
        if reference == pin.LOCAL:
            back = ca.mtimes(back, steps[index].rotation.T)
            offset = offset - ca.mtimes(back, steps[index].translation)
    return matrix


def velocity(frame: Frame, placed: list[Placement], turning: list[Rotation], moving: list[Any], reference: Any) -> Any:
    """Return (6,) [linear; angular] velocity of ``frame`` in the axes of ``reference``."""
    omega = turning[frame.joint].omega
    linear = moving[frame.joint] + ca.cross(omega, frame.placement.translation)
    axes = _axes(frame, placed, reference)
    linear, angular = ca.mtimes(axes, linear), ca.mtimes(axes, omega)
    if reference == pin.WORLD:
        linear += ca.cross(placed[frame.joint].compose(frame.placement).translation, angular)
    return ca.vertcat(linear, angular)


def acceleration(frame: Frame, placed: list[Placement], accelerating: list[Acceleration], reference: Any) -> Any:
    """Return (6,) [classical linear; angular] acceleration of ``frame`` in the axes of ``reference``.

    Raises:
        InputError: ``reference`` is WORLD, whose linear part is no acceleration of a point of the frame.
    """
    if reference == pin.WORLD:
        raise InputError("reference", "WORLD", "LOCAL or LOCAL_WORLD_ALIGNED for a classical acceleration")
    body = accelerating[frame.joint]
    linear = body.linear + ca.mtimes(body.field, frame.placement.translation)
    axes = _axes(frame, placed, reference)
    return ca.vertcat(ca.mtimes(axes, linear), ca.mtimes(axes, body.angular))


def local_wrench(frame: Frame, placed: list[Placement], wrench: Any) -> Wrench:
    """Return ``wrench``, world axes at the frame's origin, in the axes and about the origin of its joint.

    Raises:
        InputError: it is neither a force (3,) nor a wrench (6,).
    """
    if wrench.shape not in ((3, 1), (6, 1)):
        raise InputError("external wrench", f"shape {wrench.shape}", "a force (3,) or a wrench (6,), linear first")
    to_joint = placed[frame.joint].rotation.T
    force = ca.mtimes(to_joint, wrench[:3])
    moment = ca.cross(frame.placement.translation, force)
    return force, moment if wrench.shape[0] == 3 else moment + ca.mtimes(to_joint, wrench[3:])


def _axes(frame: Frame, placed: list[Placement], reference: Any) -> Any:
    return frame.placement.rotation.T if reference == pin.LOCAL else placed[frame.joint].rotation
