"""The reference posture: joint angles by name, and the base placed on the ground."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from lgmpc.errors import nearest
from lgmpc.robot.actuators import ActuatedJoint, match_joints
from lgmpc.robot.names import is_floating, some
from lgmpc.typing import Array

LEVEL_TOLERANCE = 1e-3
"""Largest deviation of contact points from a plane that is levelled, m."""

_LARGEST_TILT = math.radians(45.0)

_BENT = 0.95
"""Distance from thigh to ankle in a proposed posture, as a share of that of the stretched leg."""


def reference_posture(
    model: pin.Model, joints: Sequence[ActuatedJoint], posture: str | Mapping[str, float] | None, usual: str | None
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
        note = f"its own posture '{usual}' is outside the limits of {', '.join(moved)}; they are at the nearest limit"
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
    data, hips = model.createData(), [leg[:2][-1:] for leg in _legs(model, frames)]

    def deviations(full: Array) -> Array:
        pin.forwardKinematics(model, data, full)
        feet = [pin.updateFramePlacement(model, data, frame).translation for frame in frames]
        beside = [foot[:2] - data.oMi[hip[-1]].translation[:2] for foot, hip in zip(feet, hips, strict=True) if hip]
        return np.concatenate(beside)

    index = [joint.q.start for joint in joints if joint.scalar]
    low, high = model.lowerPositionLimit[index], model.upperPositionLimit[index]
    at_limit = (q[index] <= low) | (q[index] >= high)
    rest = q[index]
    rest[at_limit] = 0.5 * (low[at_limit] + high[at_limit])
    if not at_limit.any() or (found := _nearest(model, joints, q, rest, deviations)) is None:
        return []
    there = some([joint.name for joint, here in zip(_scalar(joints), at_limit, strict=True) if here])
    words = _words(zip(_scalar(joints), found, strict=True))
    return [f"without a posture {there} start at a limit; one that is far from the limits: {words}"]


def propose_standing(
    model: pin.Model, joints: Sequence[ActuatedJoint], q: Array, soles: Sequence[Sequence[int]]
) -> list[str]:
    """Return a problem of a robot with soles and without a posture, with one to give.

    A straight leg cannot lift its hip. In the proposed posture the knees are bent, the corners of all soles are at one
    height, each sole is below the thigh of its leg to the side, and the centre of mass above the middle of the soles.

    Args:
        model: with position limits.
        joints: the model's joints without the floating base.
        q: (nq,) neutral configuration within the limits.
        soles: frames of the corners of each.
    """
    data, legs = model.createData(), _legs(model, [corners[0] for corners in soles])
    if any(len(leg) < 3 for leg in legs):
        return []
    lengths = [sum(float(np.linalg.norm(model.jointPlacements[j].translation)) for j in leg[2:]) for leg in legs]

    def deviations(full: Array) -> Array:
        com = pin.centerOfMass(model, data, full)
        corners = [[pin.updateFramePlacement(model, data, k).translation for k in frames] for frames in soles]
        points, centres = np.array([point for sole in corners for point in sole]), np.mean(corners, axis=1)
        hips, ankles = (np.array([data.oMi[leg[k]].translation for leg in legs]) for k in (1, -1))
        stretch = np.linalg.norm(ankles - hips, axis=1) / lengths - _BENT
        level = 10.0 * (points[:, 2] - points[:, 2].mean())
        return np.concatenate([level, stretch, centres[:, 1] - hips[:, 1], [com[0] - centres[:, 0].mean()]])

    scalar = _scalar(joints)
    found = _nearest(model, joints, q, q[[joint.q.start for joint in scalar]], deviations)
    if found is None:
        return []
    moved = [pair for pair in zip(scalar, found, strict=True) if abs(pair[1] - q[pair[0].q.start]) > 0.01]
    return [
        "posture: none is given, and its files have none; expected one with flat soles and bent knees, such as"
        f" {_words(moved)}"
    ]


def _legs(model: pin.Model, frames: Sequence[int]) -> list[list[int]]:
    """Return the joints from the base, whose free-flyer is joint 1, to each frame."""
    return [[joint for joint in model.supports[model.frames[frame].parentJoint] if joint > 1] for frame in frames]


def _scalar(joints: Sequence[ActuatedJoint]) -> list[ActuatedJoint]:
    return [joint for joint in joints if joint.scalar]


def _words(values: Iterable[tuple[ActuatedJoint, float]]) -> str:
    return f"posture: {{{', '.join(f'{joint.name}: {value:.2f}' for joint, value in values)}}}"


def _nearest(
    model: pin.Model, joints: Sequence[ActuatedJoint], q: Array, rest: Array, deviations: Callable[[Array], Array]
) -> Array | None:
    """Return the scalar joints' positions with the least deviations of a configuration, far from their limits.

    They are near ``rest``; the other joints are as in ``q``. None without finite ranges.
    """
    index = [joint.q.start for joint in _scalar(joints)]
    low, high = model.lowerPositionLimit[index], model.upperPositionLimit[index]
    width = high - low
    if not np.isfinite(width).all() or not (width > 0.0).all():
        return None

    def of_joints(values: Array) -> Array:
        full = q.copy()
        full[index] = values
        return np.concatenate([deviations(full), 0.05 * (values - rest) / width])

    edge = 0.1 * width
    start = np.clip(rest, low + edge, high - edge)
    from scipy.optimize import least_squares  # here, because only a robot without a posture needs it

    found: Array = least_squares(of_joints, start, bounds=(low + 0.99 * edge, high - 0.99 * edge)).x
    return found.round(2) + 0.0


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
