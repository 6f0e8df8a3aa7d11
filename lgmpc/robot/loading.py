"""Loading of robots: files, model, limits, posture and checks."""

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError, ModelError
from lgmpc.robot import checks, posture
from lgmpc.robot.actuators import ActuatedJoint, actuated_joints, joint_ranges, joint_values, one_side
from lgmpc.robot.collision import ModelSource, check_shapes
from lgmpc.robot.model import Robot
from lgmpc.robot.names import frame_index, is_floating
from lgmpc.robot.soles import Foot, make_feet
from lgmpc.robot.sources import ResolvedSource, build_model, find_packages, resolve
from lgmpc.robot.spec import RobotSpec
from lgmpc.robot.urdf_text import read_urdf_text
from lgmpc.typing import GRAVITY, Array

MOST_VELOCITIES = 200
"""Largest number of degrees of freedom: Pinocchio's data grow with its cube, to 4 GB and 6 s each for 500 joints."""


def load_robot(spec: RobotSpec) -> Robot:
    """Return the robot that ``spec`` describes. No mesh is read.

    Raises:
        InputError: the robot's name is unknown (the nearest are named), or a file does not exist.
        ModelError: the URDF or SRDF cannot be read, or the model lacks something; all problems are listed.
    """
    if not isinstance(spec, RobotSpec):
        raise InputError("spec", type(spec).__name__, "a RobotSpec, as lgmpc.RobotSpec(model='solo12')")
    robot, problems = _load(spec)
    if problems:
        raise ModelError(robot.name, problems)
    return robot


@dataclass(frozen=True)
class _Actuators:
    effort: Array
    velocity: Array
    armature: Array
    friction: Array
    problems: list[str]
    notes: list[str]


@dataclass(frozen=True)
class _Contacts:
    frames: tuple[str, ...]
    ids: tuple[int, ...]
    soles: tuple[Foot, ...]
    problems: list[str]


def _load(spec: RobotSpec) -> tuple[Robot, list[str]]:
    """Return a robot and the problems that prevent its use."""
    source = resolve(spec)
    model, notes = build_model(source)
    if model.nv > MOST_VELOCITIES:
        raise ModelError(model.name, [f"{model.nv} degrees of freedom; at most {MOST_VELOCITIES} are supported"])
    if problems := checks.check_magnitudes(model):
        raise ModelError(model.name, problems)
    text = read_urdf_text(source.files.urdf)
    files, package_notes = find_packages(source.files, text.packages)
    name = spec.model or model.name
    _read_srdf(model, source)
    joints = actuated_joints(model)
    q, posture_problems, posture_notes = posture.reference_posture(model, joints, spec.posture, source.posture)
    actuators = _set_actuators(model, joints, spec, q)

    inertia_problems, inertia_notes = checks.check_inertias(model)
    contacts = _set_contacts(model, spec, None if posture_problems else q, files)
    problems = [*text.problems, *actuators.problems, *posture_problems, *inertia_problems, *contacts.problems]
    problems += check_shapes(model, spec.collision_shapes)
    problems += checks.check_posture(joints, q, model.lowerPositionLimit, model.upperPositionLimit)
    problems += checks.check_joints(model, source.floating_base) or checks.check_mass_matrix(model, q, joints)

    q = posture.put_on_ground(model, q, contacts.ids, spec.contact_radius_m)
    uneven = _unevenness(model, q, contacts.ids, spec.contact_radius_m)
    mimics = checks.check_mimic(model, text.mimics)
    if spec.posture is None and contacts.ids and not problems:
        known = [entry.key() for entry in model.referenceConfigurations]
        if not spec.feet:
            posture_notes += posture.propose_posture(model, joints, q, contacts.ids)
        elif source.posture not in known:
            soles = [[frame_index(model, corner) for corner in sole.frames] for sole in contacts.soles]
            problems += posture.propose_standing(model, joints, q, soles)
    notes = (*notes, *text.notes, *package_notes, *mimics, *posture_notes, *actuators.notes, *inertia_notes, *uneven)
    lower, upper = _degree_limits(model, joints)
    start = 6 if is_floating(model) else 0
    robot = Robot(
        name=name,
        model=model,
        contact_frames=contacts.frames,
        contact_ids=contacts.ids,
        contact_radius=float(spec.contact_radius_m),
        q_reference=q,
        effort_limit=actuators.effort[start:],
        velocity_limit=actuators.velocity[start:],
        joint_lower=lower[start:],
        joint_upper=upper[start:],
        armature=actuators.armature[start:],
        joint_friction=actuators.friction[start:],
        source=files,
        soles=contacts.soles,
        given_shapes=spec.collision_shapes,
        notes=notes,
    )
    return robot, problems


def _set_contacts(model: pin.Model, spec: RobotSpec, q: Array | None, files: ModelSource) -> _Contacts:
    """Add the corners of soles to the model, and return all contact frames; ``q`` (nq,) is the reference posture."""
    frames, soles = spec.contact_frames, list[Foot]()
    problems = checks.check_contact_frames(model, [*frames, *(foot.frame for foot in spec.feet)])
    if spec.feet and not problems and q is not None:
        soles, problems = make_feet(model, q, spec.feet, files)
    if not problems and spec.feet:
        for sole in soles:
            sole.add_to(model)
        frames = tuple(name for sole in soles for name in sole.frames)
    ids = () if problems else tuple(frame_index(model, frame) for frame in frames)
    return _Contacts(frames, ids, tuple(soles), problems)


def _unevenness(model: pin.Model, q: Array, ids: tuple[int, ...], radius: float) -> tuple[str, ...]:
    """Return a note if the contact points differ in height in the reference posture (nq,)."""
    difference = float(np.ptp(posture.contact_heights(model, q, ids, radius))) if ids else 0.0
    if difference <= posture.LEVEL_TOLERANCE:
        return ()
    return (f"in the reference posture the contact points differ by {1e3 * difference:.1f} mm in height",)


def _read_srdf(model: pin.Model, source: ResolvedSource) -> None:
    """Add reference configurations and, from rotor parameters, armature to the model."""
    if source.files.srdf is None:
        return
    path = str(source.files.srdf)
    try:
        pin.loadReferenceConfigurations(model, path, False)
        if "<rotor_params" in source.files.srdf.read_text(encoding="utf-8", errors="replace"):
            pin.loadRotorParameters(model, path, False)
            model.armature = np.asarray(model.rotorInertia) * np.asarray(model.rotorGearRatio) ** 2
    except (RuntimeError, ValueError) as error:
        raise ModelError(source.name, [f"{path}: {' '.join(str(error).split())}"]) from error


def _set_actuators(model: pin.Model, joints: tuple[ActuatedJoint, ...], spec: RobotSpec, q: Array) -> _Actuators:
    """Write limits and armature into the model, and return the problems and notes of those in the files.

    Args:
        model: the model.
        joints: its actuated joints.
        spec: the settings.
        q: (nq,) reference posture.
    """
    unknown = np.full(model.nv, np.nan)
    given_effort, effort_problems = joint_values(spec.effort_limit_nm, joints, unknown, "effort_limit_nm")
    given_velocity, velocity_problems = joint_values(spec.velocity_limit_rad_s, joints, unknown, "velocity_limit_rad_s")
    armature, armature_problems = joint_values(
        spec.armature_kg_m2, joints, np.asarray(model.armature), "armature_kg_m2"
    )
    friction, friction_problems = joint_values(spec.joint_friction_nm, joints, np.zeros(model.nv), "joint_friction_nm")

    def own_range(joint: ActuatedJoint) -> tuple[float, float]:
        return float(model.lowerPositionLimit[joint.q][0]), float(model.upperPositionLimit[joint.q][0])

    ranges, range_problems = joint_ranges(spec.position_limit_rad, joints, own_range)
    distances, side_problems = joint_values(spec.one_sided_rad, joints, unknown, "one_sided_rad")
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    for joint in joints:
        if joint.name in ranges:
            distance = float(distances[joint.v][0])
            lower[joint.q], upper[joint.q] = one_side(ranges[joint.name], float(q[joint.q][0]), distance)

    own_effort = np.where(np.isnan(given_effort), model.effortLimit, np.nan)
    own_velocity = np.where(np.isnan(given_velocity), model.velocityLimit, np.nan)
    weight = float(pin.computeTotalMass(model)) * GRAVITY
    urdf_limits = (own_effort, own_velocity, lower, upper)
    limit_problems, notes = checks.check_limits(joints, *urdf_limits, weight=weight, reach=_reach(model))

    effort = np.where(np.isnan(given_effort), model.effortLimit, given_effort)
    velocity = np.where(np.isnan(given_velocity), model.velocityLimit, given_velocity)
    model.effortLimit, model.velocityLimit, model.armature = effort, velocity, armature
    if hasattr(model, "lowerEffortLimit"):  # Pinocchio stores both signs; its setters above write only the upper one.
        model.lowerEffortLimit, model.lowerVelocityLimit = -effort, -velocity
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    problems = [*effort_problems, *velocity_problems, *armature_problems, *friction_problems, *range_problems]
    problems += side_problems
    return _Actuators(effort, velocity, armature, friction, [*problems, *limit_problems], notes)


def _degree_limits(model: pin.Model, joints: tuple[ActuatedJoint, ...]) -> tuple[Array, Array]:
    """Return (nv,) position limits of each degree of freedom, infinite where a joint's position is not one number."""
    lower, upper = np.full(model.nv, -math.inf), np.full(model.nv, math.inf)
    for joint in joints:
        if joint.scalar:
            lower[joint.v] = model.lowerPositionLimit[joint.q]
            upper[joint.v] = model.upperPositionLimit[joint.q]
    return lower, upper


def _reach(model: pin.Model) -> float:
    """Return the length of the longest chain of joints, m, which bounds the distance of masses from joint axes."""
    reach = [0.0] * int(model.njoints)
    for index in range(1, model.njoints):
        reach[index] = reach[model.parents[index]] + float(np.linalg.norm(model.jointPlacements[index].translation))
    levers = (float(np.linalg.norm(inertia.lever)) for inertia in model.inertias)
    return max(length + lever for length, lever in zip(reach, levers, strict=True))
