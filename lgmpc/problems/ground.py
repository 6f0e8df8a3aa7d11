"""The ground of legged problems: where a robot starts on it, the heights of footholds, distances of bodies from it.

Problems keep the signed distances of spheres fixed to the robot (on the box around its trunk, along its shanks, at its
feet) from the planes and boxes of the world, whose places and sizes are parameters of the compiled functions. Figures
are distances of more and finer spheres, on all collision shapes, by Pinocchio and :class:`~lgmpc.world.World`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.costs import Parameter, Residual, StageSymbols
from lgmpc.costs.library.collision import box_distance, least
from lgmpc.errors import InputError
from lgmpc.lie import quaternion
from lgmpc.problems.footsteps import Footsteps, SwingCurve
from lgmpc.robot import Box as BoxShape, Capsule, Robot
from lgmpc.typing import Array
from lgmpc.world import Box, Plane, World

_SPACING, _FINE = 0.1, 0.02
"""m between spheres of a body: of the optimised ones, and of those of figures."""
_SHANK = 0.75
"""Part of a shank, from the knee, that keeps a distance: the rest belongs to the foot."""
_MOST_BOXES = 8
_PARALLEL = 0.02
"""Largest difference between the unit normals of a foothold and of the start."""
_SMALLEST_FOOT = 0.005
"""m; radius of the ground that is examined below a foothold of a smaller foot."""


@dataclass(frozen=True, eq=False)
class BodySpheres:
    """Spheres fixed to a robot's bodies.

    Attributes:
        joints: (n,) that move them.
        centers: (n, 3) in the joints' frames, m.
        radii: (n,) m.
        shares: (n,) part of a distance that they keep: less on a shank the nearer to its foot.
    """

    joints: tuple[int, ...]
    centers: Array
    radii: Array
    shares: Array

    @classmethod
    def optimised(cls, robot: Robot) -> "BodySpheres":
        """Return spheres on the box around the trunk's shapes, of thighs, along shanks, and last those of feet."""
        ends = [(at.translation, r) for part in robot.collision_shapes if part.joint == 1 for at, r in part.corners]
        found = []
        if ends:
            low, high = np.min([at - r for at, r in ends], axis=0), np.max([at + r for at, r in ends], axis=0)
            found = [(1, 0.5 * (low + high) + point, 0.0, 1.0) for point in _on_box(0.5 * (high - low), _SPACING)]
        frames = [robot.model.frames[index] for index in robot.contact_ids]
        feet = [(f.parentJoint, f.placement.translation, robot.foot_points.radius, 1.0) for f in frames]
        knees = {
            robot.model.parents[f.parentJoint]: robot.model.jointPlacements[f.parentJoint].translation for f in frames
        }
        for part in robot.collision_shapes:
            # Of a thigh the ends at the knee; the others cannot reach the ground before the trunk does.
            if part.joint in knees and part.joint > 1:
                ends = [(at.translation, r) for at, r in part.corners]
                knee = knees[part.joint]
                found += [(part.joint, at, r, 1.0) for at, r in ends if at @ knee > 0.5 * knee @ knee]
        return cls._of([*found, *_shanks(robot, np.linspace(0.0, _SHANK, 4)), *feet])

    @classmethod
    def measured(cls, robot: Robot) -> "BodySpheres":
        """Return fine spheres on all collision shapes and along the upper parts of the shanks."""
        found = []
        for part in robot.collision_shapes:
            shape, radius = part.shape, 0.0
            if isinstance(shape, BoxShape):
                points = _on_box(np.array(shape.half_size_m), _FINE)
            else:
                radius, length = shape.radius_m, shape.half_length_m if isinstance(shape, Capsule) else 0.0
                points = np.linspace(-length, length, 1 + round(2.0 * length / _FINE))[:, None] * [0.0, 0.0, 1.0]
            found += [(part.joint, part.placement.act(point), radius, 1.0) for point in points]
        return cls._of([*found, *_shanks(robot, np.linspace(0.0, _SHANK, 10))])

    @classmethod
    def _of(cls, spheres: Sequence[tuple[int, Array, float, float]]) -> "BodySpheres":
        joints, centers, radii, shares = zip(*spheres, strict=True)
        return cls(tuple(map(int, joints)), np.array(centers), np.array(radii), np.array(shares))

    def distances(self, robot: Robot, xs: Array, world: World) -> Array:
        """Return (m, n) distances from the ground at states (m, nx), m."""
        data, found = robot.create_data(), np.empty((len(xs), len(self.radii), 3))
        groups = [(joint, np.flatnonzero(np.array(self.joints) == joint)) for joint in sorted(set(self.joints))]
        for x, points in zip(xs, found, strict=True):
            pin.forwardKinematics(robot.model, data, x[: robot.nq])
            for joint, rows in groups:
                placement = data.oMi[joint]
                points[rows] = self.centers[rows] @ placement.rotation.T + placement.translation
        return world.distance(found.reshape(-1, 3))[0].reshape(found.shape[:2]) - self.radii


class GroundDistance(Residual):
    """Signed distances of spheres from planes and boxes (n,), m: those from the nearest of them.

    Args:
        spheres: fixed to the robot.
        planes: number of planes; each has four parameters, its normal and its distance from the origin.
        boxes: number of boxes; each has fifteen: center, axes column by column, and half sizes.
    """

    def __init__(self, spheres: BodySpheres, planes: int, boxes: int) -> None:
        self.nr, self.spheres, self._planes, self._boxes = len(spheres.radii), spheres, planes, boxes
        self.parameters = (Parameter("solids", 4 * planes + 15 * boxes, "normals and offsets of planes; boxes", 0.0),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the distances."""
        solids, distances, first = s["solids"], [], 4 * self._planes
        for joint, center, radius in zip(self.spheres.joints, self.spheres.centers, self.spheres.radii, strict=True):
            placement = s.robot.joint_placement(s.q, joint)
            point = placement.translation + placement.rotation @ ca.DM(center)
            found = [ca.dot(p[:3], point) - p[3] for p in (solids[4 * i : 4 * i + 4] for i in range(self._planes))]
            for b in (solids[first + 15 * i : first + 15 * i + 15] for i in range(self._boxes)):
                found.append(box_distance(ca.reshape(b[3:12], 3, 3).T @ (point - b[:3]), b[12:]))
            distances.append(least(found) - radius)
        return ca.vertcat(*distances)


@dataclass(frozen=True, eq=False)
class ProblemGround:
    """A world of planes and boxes, and the place where a robot starts on it.

    Attributes:
        world: the world.

    Raises:
        InputError: other surfaces.
    """

    world: World

    def __post_init__(self) -> None:
        others = [type(each).__name__ for each in self.world.surfaces if not isinstance(each, (Plane, Box))]
        if others:
            raise InputError("world", f"a {others[0]}", "a world of planes and boxes")

    @cached_property
    def axes(self) -> Array:
        """(3, 3) axes of the start; the third one is the ground's normal."""
        return self.world.start_pose[0]

    @property
    def plain(self) -> bool:
        """Whether it is the plane on which robots stand in their reference posture."""
        point = self.world.start_pose[1]
        return self.world.planar and np.array_equal(self.axes, np.eye(3)) and not point.any()

    def placed(self, xs: Array) -> Array:
        """Return states (n, nx) of a robot that starts in its reference posture, moved to the start."""
        moved = xs.copy()
        if not self.plain:
            moved[:, :3] = self._points(xs[:, :3])
            moved[:, 3:7] = quaternion.compose(quaternion.from_matrix(self.axes), xs[:, 3:7])
        return moved

    def laid(self, steps: Footsteps, radius: float) -> Footsteps:
        """Return footsteps moved to the start, with footholds at the heights of the ground.

        Args:
            steps: on the plane on which the robot stands in its reference posture.
            radius: of the feet, m.

        Raises:
            InputError: a foothold where the ground is not flat, or not parallel to that of the start.
        """
        if self.plain:
            return steps
        start = self._foothold(steps.start, radius)
        return Footsteps(start, tuple(tuple(self._swing(each, radius) for each in swings) for swings in steps.swings))

    def raised(self, xs: Array, steps: Footsteps, times: Array) -> Array:
        """Return reference states (n, nx) raised as footholds are: on average of the feet, evenly over each swing.

        Args:
            xs: at the start, as over its plane.
            steps: on the ground.
            times: (n,) of the states, s; those of an impact are equal.
        """
        moved, lift = xs.copy(), np.zeros(len(times))
        for swings in steps.swings if not self.world.planar else ():
            knots = [(time, point) for each in swings for time, point in each.ends]
            if knots:
                relief = self._relief(np.array([point for _, point in knots]))
                lift += np.interp(times, [time for time, _ in knots], relief) / len(steps.swings)
        rates = np.append(np.diff(lift) / np.maximum(np.diff(times), 1e-9), 0.0)
        moved[:, 2] += lift
        nq = 7 + (xs.shape[1] - 13) // 2
        moved[:, nq : nq + 3] += rates[:, None] * quaternion.to_matrix(moved[:, 3:7])[:, 2]
        return moved

    def solids(self, spheres: BodySpheres, xs: Array) -> tuple[int, int, Array]:
        """Return the numbers of planes and of boxes near a motion, and the parameters of their distances.

        Args:
            spheres: fixed to the robot.
            xs: (n, nx) reference states.

        Raises:
            InputError: more boxes than the compiled functions are for.
        """
        reach = 2.0 * float(np.linalg.norm(xs[0, :3] - self.world.start_pose[1]))
        low, high = xs[:, :3].min(axis=0) - reach, xs[:, :3].max(axis=0) + reach
        planes = [each for each in self.world.surfaces if isinstance(each, Plane)]
        boxes = [each for each in self.world.surfaces if isinstance(each, Box)]
        boxes = [b for b in boxes if (b.corners.min(axis=0) < high).all() and (b.corners.max(axis=0) > low).all()]
        if len(boxes) > _MOST_BOXES:
            raise InputError("world", f"{len(boxes)} boxes near the motion", f"at most {_MOST_BOXES}")
        values = [[*p.normal_vector, float(np.dot(p.normal_vector, p.point))] for p in planes]
        values += [[*b.center, *b.rotation.ravel(order="F"), *b.half_size] for b in boxes]
        return len(planes), len(boxes), np.concatenate(values)

    def _points(self, points: Array) -> Array:
        """Return points (n, 3), given from the origin of a level floor, at the start."""
        return points @ self.axes.T + self.world.start_pose[1]

    def _relief(self, points: Array) -> Array:
        """Return (n,) heights of the ground above the plane of the start below points (n, 3), m."""
        axes, point = self.world.start_pose
        plane = Plane(
            (float(point[0]), float(point[1]), float(point[2])),
            (float(axes[0, 2]), float(axes[1, 2]), float(axes[2, 2])),
        )
        return self.world.height(points[:, :2]) - plane.height(points[:, :2])

    def _foothold(self, points: Array, radius: float) -> Array:
        """Return footholds (n, 3), given on the plane of a level floor, on the ground."""
        found = self._points(points)
        if self.world.planar:
            return found
        flat = self.world.steppable(found[:, :2], max(radius, _SMALLEST_FOOT))
        flat &= np.linalg.norm(self.world.normal(found[:, :2]) - self.axes[:, 2], axis=1) < _PARALLEL
        if not flat.all():
            at = ", ".join(f"{x:.3g}" for x in found[int(flat.argmin()), :2])
            words = "footholds on flat ground parallel to that of the start, away from edges"
            raise InputError("world", f"a foothold at [{at}] m, on an edge or a slope", words)
        found[:, 2] += self._relief(found)
        return found

    def _swing(self, swing: SwingCurve, radius: float) -> SwingCurve:
        """Return a swing on the ground, higher by what is higher than both of its ends below it."""
        ends = self._foothold(np.array([swing.start, swing.end]), radius)
        top = float(self.world.highest(ends[:1, :2], ends[1:, :2])[0] - self.world.height(ends[:, :2]).max())
        return replace(swing, start=ends[0], end=ends[1], height=swing.height + max(0.0, top), normal=self.axes[:, 2])


def _shanks(robot: Robot, shares: Array) -> list[tuple[int, Array, float, float]]:
    """Return spheres of the feet's radius from the last joint before each contact frame, the knee, towards it."""
    frames = [robot.model.frames[index] for index in robot.contact_ids]
    return [
        (frame.parentJoint, share * frame.placement.translation, robot.foot_points.radius, 1.0 - share)
        for frame in frames
        for share in shares
    ]


def _on_box(half: Array, spacing: float) -> Array:
    """Return (n, 3) points of a grid on the faces of a box about the origin, its corners among them."""
    axes = [np.linspace(-h, h, 2 + int(2.0 * h / spacing)) for h in half]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[(np.abs(points) >= half * (1.0 - 1e-9)).any(axis=1)]
