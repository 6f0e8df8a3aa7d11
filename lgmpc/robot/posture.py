"""The reference posture: joint angles by name, and the base placed on the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from lgmpc.errors import nearest
from lgmpc.robot.actuators import ActuatedJoint, match_joints
from lgmpc.robot.names import is_floating, some
from lgmpc.typing import Array

__all__ = ["LEVEL_TOLERANCE", "contact_heights", "propose_posture", "put_on_ground", "reference_posture"]

LEVEL_TOLERANCE = 1e-3
"""Largest deviation of contact points from a plane that is levelled, m."""

_LARGEST_TILT = math.radians(45.0)


def reference_posture(
    model: pin.Model,
    joints: Sequence[ActuatedJoint],
    posture: str | Mapping[str, float] | None,
    usual: str | None,
) -> tuple[Array, list[str], list[str]]:
    """Return (nq,) the configuration that ``posture`` describes, the problems of its keys, and notes.

    Args:
        model: with position limits and reference configurations.
        joints: the model's joints without the floating base.
        posture: name of a reference configuration, or {joint name or pattern: rad or m}, or None.
        usual: name of the reference configuration if ``posture`` is None; clipped to the limits.
    """
    known = {entry.key(): entry.data() for entry in model.referenceConfigurations}
    if isinstance(posture, str):
        if posture not in known:
            close = nearest(posture, known) or tuple(known)
            there = f"there are {', '.join(close)}" if close else "the model has none"
            return pin.neutral(model), [f"posture: no reference configuration is named '{posture}'; {there}"], []
        return _normalized(model, known[posture]), [], []
    if posture is None and usual in known:
        own = _normalized(model, known[usual])
        q, moved = _within_limits(model, joints, own)
        note = (
            f"its own posture '{usual}' is outside the limits of {', '.join(moved)}; they are set to the nearest limit"
        )
        return q, [], [note] if moved else []
    q, _ = _within_limits(model, joints, _normalized(model, pin.neutral(model)))
    if posture is None:
        return q, [], []
    movable = [joint for joint in joints if joint.scalar or joint.circular]
    given, problems = match_joints(posture, [joint.name for joint in movable], "posture")
    for joint in movable:
        if joint.name in given:
            angle = given[joint.name]
            q[joint.q] = angle if joint.scalar else (math.cos(angle), math.sin(angle))
    return q, problems, []


def propose_posture(model: pin.Model, joints: Sequence[ActuatedJoint], q: Array, frames: Sequence[int]) -> list[str]:
    """Return a note with a posture to give if joints are at a limit in ``q``, where nothing is left to control.

    In the proposed posture each foot is below the second joint of its leg, that of the thigh, and joints are far from
    their limits.
    """
    movable = [joint for joint in joints if joint.scalar]
    index = [joint.q.start for joint in movable]
    low, high = model.lowerPositionLimit[index], model.upperPositionLimit[index]
    at_limit = (q[index] <= low) | (q[index] >= high)
    if not at_limit.any() or not np.isfinite(high - low).all() or not (high > low).all():
        return []
    data, width = model.createData(), high - low
    hips = [[joint for joint in model.supports[model.frames[frame].parentJoint] if joint > 1][:2] for frame in frames]
    rest = np.where(at_limit, 0.5 * (low + high), q[index])

    def deviations(values: Array) -> Array:
        full = q.copy()
        full[index] = values
        pin.forwardKinematics(model, data, full)
        feet = [pin.updateFramePlacement(model, data, frame).translation for frame in frames]
        beside = [foot[:2] - data.oMi[hip[-1]].translation[:2] for foot, hip in zip(feet, hips, strict=True) if hip]
        return np.concatenate([*beside, 0.05 * (values - rest) / width])

    edge = 0.1 * width
    start = np.clip(rest, low + edge, high - edge)
    from scipy.optimize import least_squares  # here, because only a robot without a posture needs it

    found = least_squares(deviations, start, bounds=(low + 0.99 * edge, high - 0.99 * edge)).x
    pairs = zip(movable, found.round(2) + 0.0, strict=True)
    words = ", ".join(f"{joint.name}: {value:.2f}" for joint, value in pairs)
    there = some([joint.name for joint, here in zip(movable, at_limit, strict=True) if here])
    return [f"without a posture {there} start at a limit; one that is far from the limits: posture: {{{words}}}"]


def contact_heights(model: pin.Model, q: Array, frames: Sequence[int], radius: float) -> Array:
    """Return (nc,) the height of each contact point in configuration ``q``, m."""
    return _points(model, q, frames)[:, 2] - radius


def put_on_ground(model: pin.Model, q: Array, frames: Sequence[int], radius: float) -> Array:
    """Return ``q`` with the lowest contact point at z = 0 and the contact points' plane, if there is one, level."""
    q = q.copy()
    if not frames or not is_floating(model):
        return q
    tilt = _levelling(_points(model, q, frames))
    base = pin.Quaternion(tilt) * pin.Quaternion(q[3:7])
    q[3:7] = base.coeffs()
    q[2] -= contact_heights(model, q, frames, radius).min()
    return q


def _normalized(model: pin.Model, q: Array) -> Array:
    return np.array(pin.normalize(model, np.array(q)), dtype=np.float64)


def _within_limits(model: pin.Model, joints: Sequence[ActuatedJoint], q: Array) -> tuple[Array, list[str]]:
    """Return ``q`` with all joints within their limits, and the names of those that were moved."""
    q, moved = q.copy(), []
    for joint in joints:
        if joint.scalar:
            lowest, highest = model.lowerPositionLimit[joint.q], model.upperPositionLimit[joint.q]
            if not (lowest <= q[joint.q] <= highest):
                moved.append(joint.name)
            q[joint.q] = np.clip(q[joint.q], lowest, highest)
    return q, moved


def _points(model: pin.Model, q: Array, frames: Sequence[int]) -> Array:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.array([pin.updateFramePlacement(model, data, frame).translation for frame in frames])


def _levelling(points: Array) -> Array:
    """Return the smallest rotation that levels ``points``; the identity if they are not close to a plane."""
    if len(points) < 3:
        return np.eye(3)
    centred = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred)
    if spread[1] < 10 * LEVEL_TOLERANCE or np.abs(centred @ axes[2]).max() > LEVEL_TOLERANCE:
        return np.eye(3)
    normal = axes[2] * np.copysign(1.0, axes[2, 2])
    tilt = math.atan2(math.hypot(normal[0], normal[1]), normal[2])
    if not 1e-9 < tilt < _LARGEST_TILT:
        return np.eye(3)
    return np.array(pin.Quaternion.FromTwoVectors(normal, np.array([0.0, 0.0, 1.0])).toRotationMatrix())
