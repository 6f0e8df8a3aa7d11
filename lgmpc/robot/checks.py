"""Checks of a robot model: problems that name the joint, link or frame, the value found, and the remedy."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin

from lgmpc.errors import ModelError, nearest
from lgmpc.robot.actuators import ActuatedJoint
from lgmpc.robot.names import is_floating, some
from lgmpc.state.configuration import configuration_blocks
from lgmpc.typing import Array, BoolArray

_FASTEST = 200.0
"""rad/s or m/s; larger limits are placeholders: no geared joint reaches them."""

_LARGEST = 1e9
"""m, kg, kg.m2; no robot is larger."""

_POINT = 1e-4
"""Radius of gyration, m, below which a body is a point mass."""

_DENSITY = 1000.0
"""kg/m3 of the spheres whose inertias are proposed."""

_LIFTS = 10.0
"""Larger effort limits, in the robot's weight times its reach (for prismatic joints its weight), are placeholders."""


def check_contact_frames(model: pin.Model, frames: Sequence[str]) -> list[str]:
    """Return a problem for each contact frame that is missing, and one if the base cannot move."""
    names = tuple(dict.fromkeys(frame.name for frame in model.frames[1:]))
    problems = []
    for frame in frames:
        if frame not in names:
            close = nearest(frame, names)
            hint = f"did you mean {' or '.join(close)}?" if close else f"there are {some(names, 8)}"
            problems.append(f"contact frame '{frame}' is not in the model; {hint}")
    if frames and not is_floating(model):
        problems.append(
            f"contact_frames are given ({some(frames)}) but the base is fixed: a robot on feet needs a free-flyer"
            " (floating_base: true)"
        )
    return problems


def check_joints(model: pin.Model, root_added: bool) -> list[str]:
    """Return a problem for each joint of an unsupported kind, for each free-flyer other than the base's, or for none.

    Args:
        model: the model.
        root_added: whether joint 1 is a free-flyer that is not in the URDF.
    """
    problems: list[str] = []
    if model.nv == 0:
        return ["nothing moves: its base is fixed and it has no joints (floating_base: true)"]
    try:
        configuration_blocks(model)
    except ModelError as error:
        problems += error.problems
    for parent, name, joint in zip(model.parents[2:], model.names[2:], model.joints[2:], strict=True):
        if joint.shortname() == "JointModelFreeFlyer" and parent == 1 and root_added:
            problems.append(
                f"the URDF's root has a floating joint of its own, '{name}': a second free-flyer above it makes the"
                " dynamics singular (floating_base: false)"
            )
        elif joint.shortname() == "JointModelFreeFlyer":
            problems.append(f"joint '{name}' floats inside the robot: only the base may, no actuator moves it")
    return problems


def check_magnitudes(model: pin.Model) -> list[str]:
    """Return a problem for each joint, frame or body whose place or inertia overflows in the first product."""
    problems = []
    places = [(f"joint '{name}'", place) for name, place in zip(model.names, model.jointPlacements, strict=True)]
    places += [(f"frame '{frame.name}'", frame.placement) for frame in model.frames]
    for name, place in places:
        if not np.abs(place.homogeneous).max() <= _LARGEST:
            problems.append(f"{name} is {np.abs(place.translation).max():g} m from its parent")
    for index, inertia in enumerate(model.inertias[1:], start=1):
        numbers = np.abs([inertia.mass, *inertia.lever, *inertia.inertia.ravel()])
        if (numbers > _LARGEST).any():
            largest = np.nanmax(numbers)
            problems.append(f"{_body_name(model, index)}: its mass, centre or inertia has a number of {largest:g}")
    return problems


def check_inertias(model: pin.Model) -> tuple[list[str], list[str]]:
    """Return problems and notes about the inertia of each rigid body.

    A body's inertia about its centre of mass must be positive semi-definite, and no principal moment may exceed the sum
    of the other two. Bodies without mass are noted; :func:`check_mass_matrix` reports those that matter.
    """
    problems: list[str] = []
    massless: list[str] = []
    for index in range(1, model.njoints):
        body, inertia = _body_name(model, index), model.inertias[index]
        moments = np.linalg.eigvalsh(inertia.inertia)
        tolerance = 1e-12 + 1e-6 * float(np.abs(moments).max())
        if not np.isfinite(inertia.toDynamicParameters()).all():
            problems.append(f"{body}: its inertia is not finite")
        elif inertia.mass < 0:
            problems.append(f"{body}: its mass is negative, {inertia.mass:g} kg")
        elif moments[0] < -tolerance:
            problems.append(f"{body}: its inertia is not positive definite; moments {_moments(moments)} kg.m2")
        elif moments[2] > moments[0] + moments[1] + tolerance:
            problems.append(f"{body}: its inertia violates the triangle inequality; moments {_moments(moments)} kg.m2")
        elif inertia.mass == 0:
            massless.append(body)
    if is_floating(model) and model.inertias[1].mass == 0:
        problems.append(f"{_body_name(model, 1)}: the floating base has no mass (missing <inertial>?)")
        massless.remove(_body_name(model, 1))
    notes = [f"no mass: {some(massless)}"] if massless else []
    if points := point_masses(model):
        words = ", ".join(
            f'{name} (<inertia ixx="{i:.2g}" iyy="{i:.2g}" izz="{i:.2g}"/>)' for name, i in points.items()
        )
        notes.append(f"no rotational inertia, and that of a sphere of its mass and the density of water: {words}")
    return problems, notes


def point_masses(model: pin.Model) -> dict[str, float]:
    """Return the bodies with mass but without rotational inertia, with that of as heavy a sphere of water, kg.m2."""
    found = {}
    for index, inertia in enumerate(model.inertias[1:], start=1):
        mass = inertia.mass
        if mass > 0 and np.abs(np.linalg.eigvalsh(inertia.inertia)).max() < mass * _POINT**2:
            radius = (0.75 * mass / (math.pi * _DENSITY)) ** (1.0 / 3.0)
            found[_body_name(model, index)] = 0.4 * mass * radius**2
    return found


def check_mass_matrix(model: pin.Model, q: Array, joints: Iterable[ActuatedJoint]) -> list[str]:
    """Return a problem if joints move no inertia, with their names, or if the mass matrix is singular otherwise."""
    mass_matrix = pin.crba(model, model.createData(), q)
    mass_matrix = np.triu(mass_matrix) + np.triu(mass_matrix, 1).T
    diagonal = np.diag(mass_matrix)
    idle = [joint.name for joint in joints if (np.abs(diagonal[joint.v]) < 1e-12).any()]
    if idle:
        return [
            f"joints that move no inertia: {some(idle)}; give the links after them an <inertial>, or the joints an"
            " armature"
        ]
    if model.nv and (
        diagonal.min() <= 0 or np.linalg.eigvalsh(mass_matrix / np.sqrt(np.outer(diagonal, diagonal)))[0] < 1e-12
    ):
        return ["its mass matrix is not positive definite in the reference posture: some links lack inertia"]
    return []


def check_limits(
    joints: Sequence[ActuatedJoint],
    effort: Array,
    velocity: Array,
    lower: Array,
    upper: Array,
    weight: float,
    reach: float,
) -> tuple[list[str], list[str]]:
    """Return problems and notes about limits that never bind, or that forbid all motion.

    Args:
        joints: the actuated joints.
        effort: (nv,) of the URDF; entries given by the user are NaN and not checked.
        velocity: (nv,) likewise.
        lower: (nq,) lowest positions.
        upper: (nq,) highest positions.
        weight: of the robot, N.
        reach: length of its longest chain, m.
    """
    problems: list[str] = []
    strongest = {False: _LIFTS * weight * reach, True: _LIFTS * weight}
    efforts = np.array([strongest[joint.prismatic] for joint in joints])
    speeds = np.full(len(joints), _FASTEST)
    kinds = (
        ("effort", "effort_limit_nm", effort, efforts, "N.m"),
        ("velocity", "velocity_limit_rad_s", velocity, speeds, "rad/s"),
    )
    for kind, key, values, bounds, unit in kinds:
        endless = [j for j, bound in zip(joints, bounds, strict=True) if bool((values[j.v] > bound).any())]
        zero = [j for j in joints if bool((values[j.v] <= 0).any())]
        for group, verdict in ((endless, "never binds"), (zero, "forbids all motion")):
            if group:
                found = sorted({float(values[j.v].max()) for j in group})
                shown = " to ".join(_number(x, unit) for x in dict.fromkeys((found[0], found[-1])))
                names = some([j.name for j in group])
                problems.append(f"the URDF's {kind} limit of {names} {verdict} ({shown}): give {key}")
    scalar = [j for j in joints if j.scalar]
    endless = [j for j in scalar if not _bounded(lower[j.q], upper[j.q]).all()]
    if endless:
        problems.append(f"no finite position limits: {some([j.name for j in endless])}: give position_limit_rad")
    wide = [
        j
        for j in scalar
        if j not in endless and not j.prismatic and float((upper[j.q] - lower[j.q]).max()) > 2 * math.pi
    ]
    notes = [f"position limits wider than a full turn: {some([j.name for j in wide])}"] if wide else []
    return problems, notes


def check_posture(joints: Iterable[ActuatedJoint], q: Array, lower: Array, upper: Array) -> list[str]:
    """Return a problem for each joint that is outside its limits in the reference posture."""
    problems = []
    for joint in joints:
        if joint.scalar:
            position, lowest, highest = (float(values[joint.q][0]) for values in (q, lower, upper))
            if not lowest - 1e-9 <= position <= highest + 1e-9:
                problems.append(
                    f"the reference posture has {joint.name} at {position:.4g}, outside its limits"
                    f" [{lowest:.4g}, {highest:.4g}]"
                )
    return problems


def check_mimic(model: pin.Model, mimics: Iterable[str]) -> list[str]:
    """Return a note if the URDF has mimic joints, which are independent here."""
    moving = [name for name in mimics if model.existJointName(name)]
    return [f"mimic joints of the URDF are independent joints here: {some(moving)}"] if moving else []


def _bounded(lower: Array, upper: Array) -> BoolArray:
    return np.asarray((np.abs(lower) < 1e300) & (np.abs(upper) < 1e300))


def _body_name(model: pin.Model, joint: int) -> str:
    for frame in model.frames:
        if frame.type == pin.BODY and frame.parentJoint == joint:
            return f"link '{frame.name}'"
    return f"the body of joint '{model.names[joint]}'"


def _moments(moments: Array) -> str:
    return ", ".join(f"{moment:.4g}" for moment in moments)


def _number(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if value < 1e300 else "infinite"
