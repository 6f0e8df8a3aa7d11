"""The robot in MuJoCo, built from its Pinocchio model; the only file that depends on MuJoCo's conventions.

MuJoCo has quaternions as w x y z, and the free joint's linear velocity in world axes (at the body's origin, as
Pinocchio); everything else that is exchanged here is the same on both sides. The tree is made joint by joint from the
``pin.Model``, so links joined by fixed joints are one body, and there is no difference between two URDF readers.
"""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from lgmpc.errors import ModelError
from lgmpc.robot import Box, CollisionShape, Robot, Sphere
from lgmpc.simulation.parameters import PlantSettings, default_world, real_effort_limit, simulated_model
from lgmpc.simulation.plant import BodyWrenches, PlantSample, check_speed, check_state, check_torque
from lgmpc.typing import Array, IntArray
from lgmpc.world import HeightField, Plane, Softness, World

_LOG = logging.getLogger(__name__)
_CONTACT: Mapping[str, Any] = {"solref": (0.005, 1.0), "solimp": (0.95, 0.99, 0.001, 0.5, 2.0), "condim": 3}
_HARD = 1.0 / 0.95 - 1.0  # regularizer of a contact of impedance 0.95, in inverse inertias
_GROUND, _ROBOT = 1, 2  # contact type bits: the robot has contacts with the ground, not with itself
_UP = np.array([0.0, 0.0, 1.0])
_POINT = 1e-6  # m; radius that stands for a point foot
_NET_FORCE = (1 << mujoco.mjtConDataField.mjCONDATA_FORCE.value, 3, 1)  # of a contact sensor: world axes, one row


class MujocoPlant:
    """A robot on the ground of a world in MuJoCo (elliptic friction cones).

    Feet are spheres at the contact frames (``robot.foot_points``), and ``robot.collision_shapes`` touch the ground
    as well. Joint position limits are not modelled.

    Args:
        robot: the robot; its ``effort_limit`` clips the torques.
        params: parameters of the engine and of the simulated robot.
        world: its surfaces; a level floor with the friction of ``params`` unless given.

    Attributes:
        model: MuJoCo's model.
        data: MuJoCo's state.
        dt: duration of one step, s.
        bodies: names of the bodies that a wrench can act on.

    Raises:
        ModelError: if the model has a joint without a counterpart in MuJoCo, or inertias that MuJoCo rejects.
    """

    def __init__(self, robot: Robot, params: PlantSettings | None = None, world: World | None = None) -> None:
        params = PlantSettings() if params is None else params
        if mujoco.get_mju_user_warning() is None:
            # By itself MuJoCo prints, and writes a file into the working folder. Divergence is raised by step().
            mujoco.set_mju_user_warning(_LOG.info)
        self._robot = robot
        source = simulated_model(robot, params)
        self.model = _compile(robot, source, params, default_world(params) if world is None else world)
        self.data = mujoco.MjData(self.model)
        self.dt, self.bodies = params.dt, robot.body_names
        self._nu, self._nc = robot.nu, robot.nc
        self._floating = robot.floating_base
        self._effort = real_effort_limit(robot, params)
        self._lowest_effort, self._least_effort = -self._effort, float(self._effort.min(initial=math.inf))
        self._wrenches = BodyWrenches(robot)
        self._layout = _Layout.of(source)
        # Views into the engine's memory, whose address is constant: a look-up takes longer than their use.
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._quaternion, self._velocity = self._qpos[3:7], self._qvel[:3]
        self._joint_force = self.data.qfrc_applied[self._robot.joint_v]
        self._applied = self.data.xfrc_applied
        self._contact_forces = self.data.sensordata.reshape(self._nc, 3)
        self._tau = np.zeros(self._nu)
        self._steps = 0
        self.reset(robot.x_reference)

    def reset(self, x: Array) -> None:
        """Put the robot into state ``x = (q, v)``, clear wrenches and set the time to zero.

        Raises:
            InputError: if ``x`` is not a finite state with a unit quaternion.
        """
        q, v = check_state(self._robot.model, x)
        mujoco.mj_resetData(self.model, self.data)
        self._layout.write(q, self._qpos)
        self._qvel[:] = v
        if self._floating:
            mujoco.mju_rotVecQuat(self._velocity, v[:3], self._quaternion)
        self._wrenches.clear()
        self._tau = np.zeros(self._nu)
        self._steps = 0

    def resume(self, sample: PlantSample) -> None:
        """Continue, without wrenches, from a sample of another plant of the same robot and engine."""
        self.reset(np.concatenate([sample.q, sample.v]))
        self._contact_forces[...] = sample.contact_forces
        self._tau, self._steps = sample.tau, round(sample.time / self.dt)

    def step(self, tau: Array) -> None:
        """Advance by ``dt`` under joint torques ``tau`` (nu,), N.m, clipped at the actuators' limits.

        Raises:
            InputError: if ``tau`` does not have nu finite elements.
            SolverError: if the simulation diverged.
        """
        within = check_torque(tau, self._nu) <= self._least_effort
        self._tau = np.array(tau) if within else np.minimum(np.maximum(tau, self._lowest_effort), self._effort)
        self._joint_force[...] = self._tau
        mujoco.mj_step(self.model, self.data)
        self._steps += 1
        check_speed(self._qvel, "MuJoCo plant", self._steps * self.dt)

    def sense(self) -> PlantSample:
        """Return the state reached by the last step."""
        q, v = self._layout.read(self._qpos), self._qvel.copy()
        if self._floating:
            v[0], v[1], v[2] = _turned_back(self._quaternion.tolist(), self._velocity.tolist())
        return PlantSample(self._steps * self.dt, q, v, self._tau, self._contact_forces.copy())

    def set_wrench(self, body: str, wrench: Array) -> None:
        """Apply ``wrench`` (6,) = [force; torque] in world axes at the centre of mass of ``body`` until it is changed.

        Links joined by fixed joints are one body: its centre of mass is that of all of them together, payload included,
        and wrenches on several of them add up.

        Raises:
            InputError: if the body is unknown (names the nearest) or the wrench is not six finite numbers.
        """
        joint, total = self._wrenches.set(body, wrench)
        self._applied[joint] = total  # MuJoCo's body i is the one that Pinocchio's joint i moves

    def body_point(self, body: str) -> Array:
        """Return the (3,) world position of the centre of mass of ``body``."""
        joint = self._wrenches.joint(body)
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.xipos[joint].copy()


@dataclass(frozen=True)
class _Layout:
    """Places of the elements of Pinocchio's q in MuJoCo's qpos.

    Attributes:
        nq: size of Pinocchio's q.
        ours: (n,) places in q of the elements that MuJoCo also has.
        theirs: (n,) their places in qpos.
        cosines: (k,) places in q of the cosine of each unbounded joint, whose sine follows.
        angles: (k,) places in qpos of their angles.
    """

    nq: int
    ours: IntArray
    theirs: IntArray
    cosines: IntArray
    angles: IntArray

    @classmethod
    def of(cls, model: pin.Model) -> "_Layout":
        pairs: list[tuple[int, int]] = []
        unbounded: list[tuple[int, int]] = []
        end = 0
        for joint in list(model.joints)[1:]:
            start, i = end, joint.idx_q
            if (joint.nq, joint.nv) == (2, 1):
                unbounded.append((i, start))
                end += 1
                continue
            end += joint.nq
            order = list(range(joint.nq))
            if joint.nq != joint.nv:
                order = [*order[:-4], *(order[k] for k in (-3, -2, -1, -4))]  # x y z w of what is stored as w x y z
            pairs += [(i + k, start + order[k]) for k in range(joint.nq)]
        columns = [np.array(column, dtype=int) for side in (pairs, unbounded) for column in _transpose(side)]
        return cls(model.nq, *columns)

    def read(self, qpos: Array) -> Array:
        if not self.cosines.size:
            return qpos[self.theirs]
        q = np.empty(self.nq)
        q[self.ours] = qpos[self.theirs]
        q[self.cosines] = np.cos(qpos[self.angles])
        q[self.cosines + 1] = np.sin(qpos[self.angles])
        return q

    def write(self, q: Array, qpos: Array) -> None:
        qpos[self.theirs] = q[self.ours]
        qpos[self.angles] = np.arctan2(q[self.cosines + 1], q[self.cosines])


def _turned_back(quaternion: list[float], vector: list[float]) -> tuple[float, float, float]:
    """Return a vector turned by the inverse of a unit quaternion w x y z."""
    (w, x, y, z), (a, b, c) = quaternion, vector
    u, v, s = w * a - y * c + z * b, w * b - z * a + x * c, w * c - x * b + y * a
    return a - 2.0 * (y * s - z * v), b - 2.0 * (z * u - x * s), c - 2.0 * (x * v - y * u)


def _transpose(pairs: list[tuple[int, int]]) -> tuple[list[int], list[int]]:
    return [a for a, _ in pairs], [b for _, b in pairs]


def _compile(robot: Robot, model: pin.Model, params: PlantSettings, world: World) -> mujoco.MjModel:
    """Return MuJoCo's model of the robot in its world."""
    spec = mujoco.MjSpec()
    spec.option.timestep = params.dt
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{params.integrator.upper()}")
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.option.gravity = model.gravity.linear
    # A diverged state must raise an error, not be silently replaced by the initial one.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    bodies = _add_tree(spec, robot.name, model, params)
    _add_ground(spec, world)
    _add_shapes(spec, bodies, robot, model)
    try:
        compiled = spec.compile()
    except ValueError as error:
        raise ModelError(robot.name, [f"MuJoCo refuses it: {' '.join(str(error).split())}"]) from error
    compiled.dof_damping[compiled.nv - robot.nu :] = params.joint_damping_nms
    if world.soft is not None:
        _soften(compiled, world.soft)
    return compiled


def _add_tree(spec: mujoco.MjSpec, name: str, model: pin.Model, params: PlantSettings) -> list[Any]:
    """Add one MuJoCo body for each Pinocchio joint; return them with the world first."""
    bodies = [spec.worldbody]
    problems = []
    data, neutral = model.createData(), pin.neutral(model)
    for index in range(1, model.njoints):
        joint, placement, inertia = model.joints[index], model.jointPlacements[index], model.inertias[index]
        body = bodies[model.parents[index]].add_body(
            name=model.names[index], pos=placement.translation, quat=_wxyz(placement.rotation)
        )
        # MuJoCo's own principal axes (fullinertia) have only eight digits before version 4.
        moments, axes = np.linalg.eigh(inertia.inertia)
        axes[:, 0] *= np.linalg.det(axes)
        body.explicitinertial = True
        body.mass, body.ipos = inertia.mass, inertia.lever
        body.inertia, body.iquat = moments, _wxyz(axes)
        bodies.append(body)
        # Pinocchio gives a plain vector where there is one degree of freedom in all.
        jacobian = pin.computeJointJacobian(model, data, neutral, index).reshape(6, model.nv)
        subspace = jacobian[:, joint.idx_v : joint.idx_v + joint.nv]
        kind = _joint_type(joint, subspace)
        if kind is None or (kind == mujoco.mjtJoint.mjJNT_FREE and not placement.isIdentity()):
            problems.append(f"joint '{model.names[index]}' ({joint.shortname()}) has no twin in MuJoCo")
        elif kind == mujoco.mjtJoint.mjJNT_FREE:
            body.add_freejoint(name=model.names[index])
        else:
            twin = body.add_joint(name=model.names[index], type=kind)
            twin.armature, twin.frictionloss = model.armature[joint.idx_v], params.joint_friction_nm
            if joint.nv == 1:
                twin.axis = subspace[:3, 0] + subspace[3:, 0]
    if problems:
        raise ModelError(name, problems)
    return bodies


def _joint_type(joint: pin.JointModel, subspace: Array) -> mujoco.mjtJoint | None:
    """Return MuJoCo's type of a joint from the size of its configuration and its motion subspace (6, nv)."""
    turns, slides = bool(subspace[3:].any()), bool(subspace[:3].any())
    return {
        (7, 6, True, True): mujoco.mjtJoint.mjJNT_FREE,
        (4, 3, True, False): mujoco.mjtJoint.mjJNT_BALL,
        (1, 1, True, False): mujoco.mjtJoint.mjJNT_HINGE,
        (2, 1, True, False): mujoco.mjtJoint.mjJNT_HINGE,
        (1, 1, False, True): mujoco.mjtJoint.mjJNT_SLIDE,
    }.get((joint.nq, joint.nv, turns, slides))


def _add_ground(spec: mujoco.MjSpec, world: World) -> None:
    """Add the world's surfaces, whose friction and softness are those of every contact with them."""
    for surface in world.surfaces:
        common = {
            **_CONTACT,
            "contype": _GROUND,
            "conaffinity": _ROBOT,
            "priority": 1,
            "friction": (surface.coefficient, 0.005, 0.0001),
        }
        if isinstance(surface, Plane):
            turn = _wxyz(pin.Quaternion.FromTwoVectors(_UP, np.array(surface.normal_vector)).matrix())
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1), pos=surface.point, quat=turn, **common
            )
        elif isinstance(surface, HeightField):
            _add_heights(spec, surface, common)
        else:
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=surface.half_size,
                pos=surface.center,
                quat=_wxyz(surface.rotation),
                **common,
            )


def _soften(model: mujoco.MjModel, soft: Softness) -> None:
    """Make the ground give way under feet; under other parts of the robot it is the stiffer the heavier they are.

    A contact's force is ``f = (a_ref - a) / R`` with ``a_ref = -b v - k r`` at the beginning of a step. The regularizer
    R for which ``1 / R = C dt + K dt^2`` makes it the spring and the damper, K and C, at the step's end, without a mass
    of the ground. MuJoCo scales R by the inverse inertia of the foot, and has impedance d for ``R / (R + inverse)``.
    """
    feet = np.unique(model.geom_bodyid[np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)])
    inverse, dt = float(model.body_invweight0[feet, 0].mean()), model.opt.timestep
    regularizer = 1.0 / (dt * (soft.damping_ns_m + soft.stiffness_n_m * dt))
    impedance = inverse / (inverse + regularizer)
    ground = model.geom_contype == _GROUND
    stiffness = soft.stiffness_n_m * regularizer
    damping = (soft.damping_ns_m + soft.stiffness_n_m * dt) * regularizer
    model.geom_solref[ground] = -impedance * np.array([stiffness, damping])
    model.geom_solimp[ground, :2] = impedance
    model.opt.impratio *= max(regularizer / (_HARD * inverse), 1.0)  # friction as on hard ground


def _add_heights(spec: mujoco.MjSpec, field: HeightField, common: Mapping[str, Any]) -> None:
    """Add a height field: in MuJoCo its heights are from 0 to 1, and its middle is the geom's origin."""
    name, lowest = f"heights {len(spec.hfields)}", float(field.heights.min())
    low, high = field.corners
    rise = max(float(field.heights.max()) - lowest, 1e-6)
    rows, columns = field.heights.shape
    size = (*(0.5 * (high - low)), rise, 0.1)
    # The first value is the lowest corner of MuJoCo's grid, as here; flat fields have no scale of their own.
    data = (field.heights - lowest).ravel() / rise
    spec.add_hfield(name=name, nrow=rows, ncol=columns, size=size, userdata=data)
    pos = (*(0.5 * (low + high)), lowest)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=name, pos=pos, **common)


def _add_shapes(spec: mujoco.MjSpec, bodies: list[Any], robot: Robot, model: pin.Model) -> None:
    """Add the feet and the other shapes of the robot that can touch the ground."""
    shape = {**_CONTACT, "contype": _ROBOT, "conaffinity": _GROUND, "mass": 0.0}
    for name, index in zip(robot.contact_frames, robot.contact_ids, strict=True):
        frame, radius = model.frames[index], max(robot.foot_points.radius, _POINT)
        pos = frame.placement.translation
        foot = {"name": f"foot {name}", "type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": (radius, 0, 0)}
        bodies[frame.parentJoint].add_geom(**foot, pos=pos, **shape)
        spec.add_sensor(
            name=foot["name"],
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,  # of the two in contact the second: then the force acts on it
            refname=foot["name"],
            intprm=_NET_FORCE,
        )
    for part in robot.collision_shapes:
        kind, size = _geom(part)
        pos, quat = part.placement.translation, _wxyz(part.placement.rotation)
        bodies[part.joint].add_geom(name=part.name, type=kind, size=size, pos=pos, quat=quat, **shape)


def _geom(part: CollisionShape) -> tuple[mujoco.mjtGeom, tuple[float, float, float]]:
    """Return MuJoCo's type and size of a shape."""
    shape = part.shape
    if isinstance(shape, Sphere):
        return mujoco.mjtGeom.mjGEOM_SPHERE, (shape.radius_m, 0.0, 0.0)
    if isinstance(shape, Box):
        return mujoco.mjtGeom.mjGEOM_BOX, shape.half_size_m
    return mujoco.mjtGeom.mjGEOM_CAPSULE, (shape.radius_m, shape.half_length_m, 0.0)


def _wxyz(rotation: Array) -> tuple[float, float, float, float]:
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return w, x, y, z
