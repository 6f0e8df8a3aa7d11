"""Geometry of the legs from the robot's model: hips, feet, lengths."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.lie import attitude
from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.swing import SwingTrajectory
from lgmpc.robot import Robot, leg_chain, leg_joints, leg_normals
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import Array

_SWEEPS = 20


@dataclass(frozen=True)
class LegGeometry:
    """The legs in the reference posture, relative to the centre of mass, axes of the base.

    Attributes:
        feet: (nf, 3) contact points, of soles their centres, m.
        hips: (nf, 3) hips: positions of each leg's second joint (the first one is the abduction), or of the first one
            of a leg with two joints, m. Of a leg with a sole, moved by the vector from the ankle, its last joint, to
            the sole's centre: soles stay flat, so the distance from there to the centre is that from hip to ankle.
        knees: (nf, 3) positions of each leg's last joint, m.
        length: (nf,) largest distance from hip to foot or ankle within the range of the joints between, m.
        base: (3,) origin of the base, m.
        radius: radius of the spherical feet, m.
        sole: length and width of the largest sole along the axes of the base, m; 0 of point feet.
        beside: distance to the side between two soles at which legs touch below their knees, m; 0 of point feet.
        normals: (nf, 3) unit vectors along which legs cannot move their feet (see :func:`~lgmpc.robot.leg_normals`).
    """

    feet: Array
    hips: Array
    knees: Array
    length: Array
    base: Array
    radius: float
    normals: Array
    sole: tuple[float, float] = (0.0, 0.0)
    beside: float = 0.0

    @cached_property
    def height(self) -> float:
        """Height of the centre of mass above the mean contact point, m."""
        return -float(self.feet[:, 2].mean())

    @property
    def scale(self) -> float:
        """Height that clearances and unevenness of feet are shares of, m: soles, of heavy legs, clear a third."""
        return 1.0 / 3.0 * self.height if self.sole[1] > 0.0 else self.height

    def above(self, points: Array, yaw: float) -> Array:
        """Return (3,) where the centre of mass of the reference posture is, its feet at ``points`` (n, 3), m.

        Args:
            points: contact points, world, m; those of the reference posture if they have moved with the base.
            yaw: heading of the base, rad.
        """
        x, y, _ = self.feet.mean(axis=0).tolist()
        return points.mean(axis=0) + [*attitude.turn(yaw, -x, -y), self.height]

    @classmethod
    def of(cls, robot: Robot) -> "LegGeometry":
        """Return the geometry of a robot's legs.

        Raises:
            InputError: the base is fixed, there is no contact frame, or one that no joint moves.
        """
        if not (robot.floating_base and robot.nc):
            raise InputError("robot", robot.name, "a floating base and contact frames")
        model, data, q = robot.model, robot.create_data(), robot.q_reference
        com = pin.centerOfMass(model, data, q).copy()
        pin.framesForwardKinematics(model, data, q)
        base = pin.XYZQUATToSE3(q[:7])
        feet, hips, knees, lengths = [], [], [], []
        for name, frame in zip(robot.foot_names, robot.foot_ids, strict=True):
            joints = leg_chain(robot, frame)
            if not joints:
                raise InputError("contact_frames", name, "a frame that a joint of the leg moves")
            tip, sole = data.oMf[frame].translation, not robot.foot_points.single and len(joints) > 2
            hip, ankle = joints[0], data.oMi[joints[-1]].translation
            hips.append(data.oMi[hip].translation + (tip - ankle if sole else 0.0))
            knees.append(data.oMi[joints[-1]].translation.copy())
            between, end = (joints[1:-1], joints[-1]) if sole else (joints[1:], None)
            lengths.append(_longest(robot, hip, between, end, frame))
            feet.append(tip + robot.foot_points.lever())
        turn = base.rotation
        return cls(
            (np.array(feet) - com) @ turn,
            (np.array(hips) - com) @ turn,
            (np.array(knees) - com) @ turn,
            np.array(lengths),
            (base.translation - com) @ turn,
            robot.foot_points.radius,
            leg_normals(robot),
            robot.foot_points.size,
            0.0 if robot.foot_points.single else _side_by_side(robot, np.array(feet) @ turn),
        )


def _side_by_side(robot: Robot, feet: Array) -> float:
    """Return the distance to the side between soles, at (nf, 3) in the reference posture, at which legs touch, m."""
    width, legs = robot.foot_points.size[1], [leg_joints(robot, frame) for frame in robot.foot_ids]
    if robot.nf != 2:
        return width
    below_knees = robot.link_pairs.between([joints[len(joints) // 2 :] for joints in legs])
    least = robot.link_pairs.distances(robot.q_reference[None], below_knees)[0]
    return max(width, abs(float(feet[0, 1] - feet[1, 1])) - float(least[0]))


def leg_inertias(robot: Robot) -> Array:
    """Return (nf, 3, 3) angular momentum about the centre of mass per velocity of each foot relative to the base.

    In the reference posture, axes of the base, N.m.s per m/s: soles do not turn, the base and all other joints are at
    rest.
    """
    model, data, q = robot.model, robot.create_data(), robot.q_reference
    momenta = pin.computeCentroidalMap(model, data, q)[3:]
    turn = data.oMi[1].rotation
    inertias = np.zeros((robot.nf, 3, 3))
    for foot, frame in enumerate(robot.foot_ids):
        columns = [model.joints[joint].idx_v for joint in leg_joints(robot, frame)]
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:, columns]
        rates = np.linalg.pinv(jacobian)[:, :3]
        inertias[foot] = turn.T @ momenta[:, columns] @ rates @ turn
    return inertias


def leg_momentum(
    inertias: Array,
    yaw: float,
    clock: GaitClock,
    swings: Sequence[SwingTrajectory],
    places: Array,
    normal: Array,
    com_velocity: Array,
    grid: TimeGrid,
) -> Array:
    """Return (N+1, 3) angular momentum that legs have by the motion of their soles over a horizon, world axes, N.m.s.

    The legs of humanoids are heavy: if all angular momentum were to vanish, the trunk would have to turn against them.

    Args:
        inertias: see :func:`leg_inertias`.
        yaw: heading of the robot, rad.
        clock: the schedule.
        swings: (nf,) paths of the present swings; later ones are quintics from rest to rest.
        places: (N, nf, 3) where each foot stands or will touch down next in each interval, m.
        normal: (3,) of the ground, along which their motion is left out.
        com_velocity: (N+1, 3) of the centre of mass at the nodes, m/s.
        grid: intervals of the horizon.
    """
    time, times, feet = grid.start, grid.nodes, places.shape[1]
    moving, (position, acceleration) = np.zeros((len(times), feet, 3)), np.zeros((2, 3))
    for foot, path in enumerate(swings):
        for swing in clock.swings(foot, time, float(times[-1])):
            if swing.liftoff <= time:
                for k in np.flatnonzero(times < path.touchdown).tolist():
                    path.sample(times[k], position, moving[k, foot], acceleration)
                continue
            begin, duration = max(grid.first_from(swing.liftoff), 1), swing.touchdown - swing.liftoff
            if begin < grid.count:
                s = np.clip((times - swing.liftoff) / duration, 0.0, 1.0)[:, None]
                step = (places[begin, foot] - places[begin - 1, foot]) / duration
                moving[:, foot] += 30.0 * (s * (1.0 - s)) ** 2 * step
    moving -= (moving @ normal)[..., None] * normal
    turn = pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
    relative = (moving - com_velocity[:, None]) @ turn
    return np.einsum("fij,kfj->ki", inertias, relative) @ turn.T


def _longest(robot: Robot, hip: int, joints: list[int], ankle: int | None, frame: int) -> float:
    """Return the largest distance from a hip to an ankle, or a contact frame, within the range of the joints between.

    In the angle of one joint the squared distance is ``a + b cos + c sin``: largest at ``atan2(c, b)`` or, if that is
    out of range, at one of its ends. Several joints are maximised in turn.
    """
    model, data, q = robot.model, robot.create_data(), robot.q_reference.copy()

    def way() -> Array:
        pin.framesForwardKinematics(model, data, q)
        end = data.oMf[frame] if ankle is None else data.oMi[ankle]
        return end.translation - data.oMi[hip].translation

    def squared(at: int, angle: float) -> float:
        q[at] = angle
        return float(np.sum(way() ** 2))

    for _ in range(_SWEEPS if len(joints) > 1 else 1):
        for at in (model.joints[joint].idx_q for joint in joints):
            ahead, aside, behind = (squared(at, angle) for angle in (0.0, 0.5 * math.pi, math.pi))
            best = math.atan2(aside - 0.5 * (ahead + behind), 0.5 * (ahead - behind))
            lowest, highest = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
            best += 2.0 * math.pi * math.ceil((lowest - best) / (2.0 * math.pi))
            if best > highest:
                best = lowest if squared(at, lowest) > squared(at, highest) else highest
            q[at] = best
    return float(np.linalg.norm(way()))
