"""The initial state of a simulated robot."""

import fnmatch

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.robot import Robot
from lgmpc.robot.actuators import actuated_joints, match_joints
from lgmpc.robot.lying import lowest_point, lying_posture
from lgmpc.robot.posture import put_on_ground
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.typing import Array
from lgmpc.world import World

_TOUCHING = 1e-3  # m; what is nearer to the start's plane than this stands on it
_UNEVEN = 2e-3  # m


def initial_state(robot: Robot, settings: PlantSettings, world: World | None = None) -> Array:
    """Return (nq + nv,) the initial state for ``settings``, with the robot's lowest point on the ground.

    Postures are those on a level floor at z = 0, moved by :attr:`~lgmpc.world.World.start_pose`; a robot whose base is
    fixed stays where it is.

    Args:
        robot: the robot.
        settings: posture and velocity.
        world: the world; a level floor unless given.

    Raises:
        InputError: a key of ``initial_posture`` matches no joint, the robot has no feet to lie on, the ground at the
            start is not flat, or the world has steps higher than the robot's legs.
        ModelError: a mesh of the collision geometry cannot be read.
    """
    posture = settings.initial_posture
    if posture == "reference":
        q = robot.q_reference
    elif posture == "lying":
        q = lying_posture(robot)
    else:
        q = _displaced(robot, posture)
    v = np.zeros(robot.nv)
    if robot.floating_base:
        world = World() if world is None else world
        q = _moved(q, *world.start_pose)
        _check_start(robot, q, world)
        q[2] += settings.initial_height_m
        if any(settings.initial_attitude_deg):
            turn = quaternion.from_matrix(so3.exp(np.radians(settings.initial_attitude_deg)))
            q[3:7] = quaternion.compose(q[3:7], turn)
        v[:3], v[3:6] = settings.initial_velocity_m_s, settings.initial_rotation_rad_s
    return np.concatenate([q, v])


def _check_start(robot: Robot, q: Array, world: World) -> None:
    """Check that the ground where the robot starts is that of its start pose: no step through it, no hole below it."""
    height, key = world.largest_step
    legs = float(robot.q_reference[2])
    if height > legs:
        raise InputError(key, height, f"at most {legs:.3g}, m, the height at which {robot.name} stands")
    if world.planar:
        return
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    spheres = [(data.oMf[i].translation, robot.foot_points.radius) for i in robot.contact_ids]
    spheres += [((data.oMi[p.joint] * at).translation, r) for p in robot.collision_shapes for at, r in p.corners]
    centres, radii = (np.array(each) for each in zip(*spheres, strict=True))
    axes, point = world.start_pose
    flat, gap = (centres - point) @ axes[:, 2] - radii, world.distance(centres)[0] - radii
    sunk, held = np.minimum(flat, 0.0) - gap, np.where(flat < _TOUCHING, gap, 0.0)
    for depth, words in ((sunk.max(), "into the ground"), (held.max(), "above a hole")):
        if depth > _UNEVEN:
            got = f"{list(world.start)}, where the robot reaches {1e3 * depth:.0f} mm {words}"
            raise InputError("world.start_m", got, "a start on flat ground: another one, or a larger world.ahead_m")


def _displaced(robot: Robot, angles: dict[str, float]) -> Array:
    """Return the reference posture with other angles of some joints."""
    joints = [joint for joint in actuated_joints(robot.model) if joint.scalar]
    names = [joint.name for joint in joints]
    for key in angles:
        if not fnmatch.filter(names, key):
            raise InputError("plant.initial_posture", key, "the name of a joint, or a pattern of names", names)
    given, _ = match_joints(angles, names, "plant.initial_posture")
    q = robot.q_reference.copy()
    for joint in joints:
        if joint.name in given:
            q[joint.q] = given[joint.name]
    q = put_on_ground(robot.model, q, robot.contact_ids, robot.foot_points.radius)
    if robot.floating_base:
        q[2] += max(0.0, -lowest_point(robot, q))
    return q


def _moved(q: Array, axes: Array, point: Array) -> Array:
    """Return a configuration of a floating base moved by a pose; unchanged by the identity, to the last bit."""
    q = q.copy()
    if not np.array_equal(axes, np.eye(3)):
        q[:3] = axes @ q[:3]
        q[3:7] = (pin.Quaternion(axes) * pin.Quaternion(q[3:7])).normalized().coeffs()
    q[:3] += point
    return q
