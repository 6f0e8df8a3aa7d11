"""The distance of two shapes, with a derivative that is exact wherever the distance has one."""

from typing import Any

import casadi as ca
import numpy as np

from lgmpc.costs.library.motion import root_of
from lgmpc.costs.residual import Residual
from lgmpc.costs.symbols import StageSymbols
from lgmpc.errors import InputError
from lgmpc.robot.collision import Box, Capsule, CollisionShape, Sphere

_LEAST_SINE_SQUARED = 1e-12
"""Below it two axes count as parallel: the error is at most 1e-12 of their length's square over the distance."""


class ShapePairDistance(Residual):
    """Signed distance of two spheres or capsules, or of a sphere and a box (1,), m: below zero where they overlap.

    Of spheres and capsules it is the distance of their axes, a point or a segment each, minus the radii: of segments
    the least of the distances of their ends from the other segment and, where the nearest points of their lines lie on
    both, of the lines (Ericson, Real-Time Collision Detection, 2005, section 5.1.9). Where two of these are equal, as
    for parallel axes side by side, the derivative is that of one of them; where the axes meet it is zero.

    Of a sphere and a box it is the distance of the centre from the box, or within the box minus that from the nearest
    face, minus the radius. Of a box and a capsule or another box there is no such formula: spheres along the edges of
    one of them have it.

    As a constraint: ``lower=0.02, upper=inf``. As a cost: ``QuadraticBarrier(0.02, np.inf)``.

    Args:
        first: a shape on a joint of the robot.
        second: another, or one of the world (joint 0).

    Raises:
        InputError: no shape, a box and a shape other than a sphere, or two on the same joint, whose distance is
            constant.
    """

    nr = 1

    def __init__(self, first: CollisionShape, second: CollisionShape) -> None:
        for name, shape in (("first", first), ("second", second)):
            if not isinstance(shape, CollisionShape):
                raise InputError(name, type(shape).__name__, "a CollisionShape")
        if first.joint == second.joint:
            raise InputError("first, second", f"'{first.name}', '{second.name}' on one joint", "shapes that can move")
        for name, shape, other in (("first", first, second), ("second", second, first)):
            if isinstance(other.shape, Box) and not isinstance(shape.shape, Sphere):
                got = f"'{shape.name}', a {shape.shape.kind}"
                raise InputError(name, got, f"a sphere, because '{other.name}' is a box")
        self.first, self.second = first, second

    def expression(self, s: StageSymbols) -> Any:
        """Return the distance."""
        for box, sphere in ((self.first, self.second), (self.second, self.first)):
            if isinstance(box.shape, Box) and isinstance(sphere.shape, Sphere):
                return _from_box(s, box, box.shape, _Axis(sphere).placed(s)[0]) - sphere.shape.radius_m
        first, second = _Axis(self.first), _Axis(self.second)
        (a, h), (b, k) = first.placed(s), second.placed(s)
        if first.length == 0.0:
            square = _point_segment(a, b, k, second.length)
        elif second.length == 0.0:
            square = _point_segment(b, a, h, first.length)
        else:
            ends = [_point_segment(a + side * h, b, k, second.length) for side in (-1, 1)]
            ends += [_point_segment(b + side * k, a, h, first.length) for side in (-1, 1)]
            square = _lines(b - a, h, k, first.length * second.length, least(ends))
        return root_of(square) - first.radius - second.radius


class _Axis:
    """The segment of points at a distance of ``radius`` from a shape's surface, fixed to a joint.

    Attributes:
        length: half of its length, m; 0 for a sphere.
        radius: m.
    """

    def __init__(self, part: CollisionShape) -> None:
        shape = part.shape
        assert isinstance(shape, (Sphere, Capsule))
        self.radius = shape.radius_m
        self.length = shape.half_length_m if isinstance(shape, Capsule) else 0.0
        self._joint = part.joint
        self._center = ca.DM(np.asarray(part.placement.translation))
        self._half = ca.DM(self.length * np.asarray(part.placement.rotation)[:, 2])

    def placed(self, s: StageSymbols) -> tuple[Any, Any]:
        """Return its centre and half of it, world axes, m."""
        if self._joint == 0:
            return self._center, self._half
        joint = s.robot.joint_placement(s.q, self._joint)
        return joint.translation + joint.rotation @ self._center, joint.rotation @ self._half


def _from_box(s: StageSymbols, part: CollisionShape, box: Box, point: Any) -> Any:
    """Return the signed distance of a point from a box; within it, that from the nearest face."""
    if part.joint:
        joint = s.robot.joint_placement(s.q, part.joint)
        point = joint.rotation.T @ (point - joint.translation)
    rotation, center = ca.DM(np.asarray(part.placement.rotation)), ca.DM(np.asarray(part.placement.translation))
    return box_distance(rotation.T @ (point - center), box.half_size_m)


def box_distance(point: Any, half_size: Any) -> Any:
    """Return the signed distance of a point from a box about the origin; within it, that from the nearest face.

    Args:
        point: (3,) column, axes of the box, m.
        half_size: three numbers or expressions, m.
    """
    beyond = [ca.fabs(point[i]) - half_size[i] for i in range(3)]
    square = sum(ca.if_else(x > 0, x, 0.0) ** 2 for x in beyond)
    nearest = -least([-x for x in beyond])
    return ca.if_else(nearest > 0, root_of(square), nearest)


def _point_segment(p: Any, center: Any, half: Any, length: float) -> Any:
    """Return the squared distance of a point from a segment."""
    if length == 0.0:
        return ca.sumsqr(p - center)
    along = ca.dot(half, p - center) / length**2
    clamped = ca.if_else(along < -1, -1.0, ca.if_else(along > 1, 1.0, along))
    return ca.sumsqr(p - center - clamped * half)


def _lines(r: Any, h: Any, k: Any, scale: float, otherwise: Any) -> Any:
    """Return the squared distance of two lines if their nearest points are on both segments, else another value.

    Args:
        r: from the first segment's centre to the second's.
        h: half of the first segment.
        k: half of the second.
        scale: product of their lengths.
        otherwise: the value else, or where the lines are parallel.
    """
    normal = ca.cross(h, k)
    across = ca.sumsqr(normal)
    skew = across > _LEAST_SINE_SQUARED * scale**2
    below = ca.if_else(skew, across, 1.0)
    # The nearest points are at these multiples of h and k from the centres, times ``below``.
    at_first, at_second = ca.dot(ca.cross(r, k), normal), ca.dot(ca.cross(r, h), normal)
    inside = ca.logic_and(ca.fabs(at_first) <= below, ca.fabs(at_second) <= below)
    return ca.if_else(ca.logic_and(skew, inside), ca.dot(normal, r) ** 2 / below, otherwise)


def least(values: list[Any]) -> Any:
    """Return the least of some expressions."""
    least = values[0]
    for value in values[1:]:
        least = ca.if_else(value < least, value, least)
    return least
