"""Feet as contact patches: soles with corners, and points; from quantities of feet to those of their points.

Whether a foot carries, when it swings, how much it may bear and where it goes are decided per foot; forces act at its
contact points. A sole has one at each corner: forces of friction cones there have their centre of pressure inside the
sole and their torsion within what friction allows, as the 6-D wrench of that patch. A point foot is the patch of one
point. :class:`FootPoints` is the only place where the one becomes the other.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Any, Literal, Union

import coal
import numpy as np
import pinocchio as pin
from pydantic import Discriminator, Field, Tag

from lgmpc.errors import InputError
from lgmpc.lie import attitude
from lgmpc.robot.collision import ModelSource, read_geometry
from lgmpc.robot.feet import lever
from lgmpc.robot.native_stderr import native_stderr
from lgmpc.settings import Finite, Settings, Vector3, key
from lgmpc.typing import Array, BoolArray, IntArray

_UP = np.array([0.0, 0.0, 1.0])

_SLICE = 5e-3
"""m above the lowest point of a link's collision geometry, up to which its surface belongs to the sole."""

_LARGER = 1.5
"""Size of a sole, in that of its link's collision geometry, beyond which it cannot belong to the link."""

_SMALLEST = 5e-3
"""m; a narrower sole is a line or a point."""

_MOST_CORNERS = 16


Corners = Annotated[tuple[tuple[Finite, Finite], ...], Field(min_length=3, max_length=_MOST_CORNERS)]
Sole = Annotated[
    Union[Annotated[Literal["auto"], Tag("auto")], Annotated[Corners, Tag("corners")]],  # noqa: UP007
    Discriminator(lambda value: "auto" if isinstance(value, str) else "corners"),
]


class FootSpec(Settings):
    """A foot with a sole."""

    frame: str = Field(min_length=1, description="Frame that it is fixed to.")
    sole: Sole = key(
        "auto",
        "Corners [[x, y], ...] of the sole, m, in its own axes; auto: the largest quadrilateral of its"
        " link's collision geometry at the lowest point in the reference posture.",
    )
    position_m: Vector3 = key((0.0, 0.0, 0.0), "[x, y, z] of the sole's axes in the frame, m; not used by auto.")
    rpy_deg: Vector3 = key(
        (0.0, 0.0, 0.0), "[roll, pitch, yaw] of these axes in the frame, degrees: z points up; not used by auto."
    )


@dataclass(frozen=True, eq=False)
class Foot:
    """A contact patch of a robot.

    Attributes:
        frame: name of the frame that it is fixed to.
        position: (3,) origin of the patch's axes in that frame, m.
        rotation: (3, 3) of the patch's axes to the frame's; z is normal to the patch and points up.
        points: (k, 2) corners in the patch's axes, counterclockwise from above, m; the origin alone of a point foot.
    """

    frame: str
    position: Array
    rotation: Array
    points: Array

    @classmethod
    def point(cls, frame: str) -> "Foot":
        """Return the point foot at a frame's origin."""
        return cls(frame, np.zeros(3), np.eye(3), np.zeros((1, 2)))

    @property
    def is_point(self) -> bool:
        """Whether it has a single point."""
        return len(self.points) == 1

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames of its points."""
        return (self.frame,) if self.is_point else tuple(f"{self.frame}/{k + 1}" for k in range(len(self.points)))

    @property
    def centre(self) -> str:
        """Name of the frame at its centre."""
        return self.frame if self.is_point else f"{self.frame}/centre"

    @property
    def size(self) -> tuple[float, float]:
        """Extents along the axes, m."""
        x, y = np.ptp(self.points, axis=0).tolist()
        return x, y

    def add_to(self, model: pin.Model) -> None:
        """Add the frames of its points and one at its centre, unless it is the frame itself."""
        if self.is_point:
            return
        parent = model.frames[model.getFrameId(self.frame)]
        placement = parent.placement * pin.SE3(self.rotation, self.position)
        names = [*self.frames, self.centre]
        for name, (x, y) in zip(names, [*self.points.tolist(), self.points.mean(axis=0).tolist()], strict=True):
            place = placement * pin.SE3(np.eye(3), np.array([x, y, 0.0]))
            model.addFrame(pin.Frame(name, parent.parentJoint, parent.parentFrame, place, pin.OP_FRAME), False)

    def __str__(self) -> str:
        if self.is_point:
            return self.frame
        corners = ", ".join(f"[{x:.4g}, {y:.4g}]" for x, y in self.points.tolist())
        return f"{self.frame}: {len(self.points)} corners {corners} m at {np.round(self.position, 4).tolist()}"


class FootPoints:
    """Assignment of contact points to feet, and conversions between quantities of both.

    Where all feet are points, a conversion returns its argument, the same memory.

    Args:
        counts: number of points of each foot.
        offsets: (nc, 3) of the points from their foot's centre in the reference posture, axes of the base, m.
        radius: of spheres around the points, with which the feet touch the ground, m.

    Attributes:
        single: whether each foot is one point.
        feet: number of feet, nf.
        of: (nc,) foot of each point.
        starts: (nf,) first point of each foot.
        counts: (nf,) points of each foot.
        offsets: as given.
        radius: as given.
    """

    def __init__(self, counts: tuple[int, ...], offsets: Array, radius: float = 0.0) -> None:
        self.counts = np.array(counts, dtype=np.intp)
        self.feet, self.single = len(counts), max(counts, default=1) == 1
        self.of: IntArray = np.repeat(np.arange(self.feet), self.counts)
        self.starts: IntArray = np.cumsum(self.counts) - self.counts
        self.offsets, self.radius = offsets, radius

    def lever(self, normal: Any = _UP) -> Any:
        """Return the vector from a contact frame's origin to where it touches a surface of this (..., 3) normal, m."""
        return lever(self.radius, normal)

    def spread(self, values: Any) -> Any:
        """Return values of feet (nf, ...) for each of their points (nc, ...)."""
        if self.single:
            return values
        return [values[foot] for foot in self.of.tolist()] if isinstance(values, list) else values[self.of]

    def touching(self, flags: BoolArray) -> BoolArray:
        """Return (nf,) which feet have a point whose flag (nc,) is set."""
        return flags if self.single else np.logical_or.reduceat(flags, self.starts)

    def total(self, values: Array) -> Array:
        """Return (nf, ...) sums over the points of each foot of values (nc, ...), a copy."""
        return np.add.reduceat(values, self.starts, axis=0)

    def mean(self, values: Array) -> Array:
        """Return (nf, ...) means over the points of each foot of values (nc, ...)."""
        if self.single:
            return values
        return np.add.reduceat(values, self.starts, axis=0) / self.counts.reshape(-1, *[1] * (values.ndim - 1))

    @property
    def size(self) -> tuple[float, float]:
        """Length and width of the largest foot along the axes of the base, m."""
        sizes = [np.ptp(part[:, :2], axis=0) for part in np.split(self.offsets, self.starts[1:])]
        length, width = np.max(sizes, axis=0).tolist()
        return length, width

    def yaws(self, points: Array) -> Array:
        """Return (nf,) headings of soles with these (nc, 3) points, relative to those in the reference posture, rad.

        The rotation in the horizontal plane fits the points best; that of a point foot is 0.
        """
        if self.single:
            return np.zeros(self.feet)
        arms, o = points[:, :2] - self.mean(points)[self.of, :2], self.offsets
        along = o[:, 0] * arms[:, 0] + o[:, 1] * arms[:, 1]
        across = o[:, 0] * arms[:, 1] - o[:, 1] * arms[:, 0]
        return np.arctan2(np.add.reduceat(across, self.starts), np.add.reduceat(along, self.starts))

    def arms(self, yaws: Array, normal: Array) -> Array:
        """Return (..., nc, 3) the points from the centres of feet with (..., nf) headings on a surface, world, m.

        Args:
            yaws: headings relative to those in the reference posture, rad.
            normal: (..., nc, 3) unit normals of the surface, along which soles lie, or (3,) one.
        """
        x, y = attitude.turn(yaws[..., self.of], *self.offsets.T[:2])
        nx, ny, nz = np.moveaxis(normal, -1, 0)
        fall = nx * x + ny * y  # turned with the surface about its line of equal height
        return np.stack([x - nx * fall / (1.0 + nz), y - ny * fall / (1.0 + nz), -fall], axis=-1)

    def place(self, centres: Array, yaws: Array, normal: Array) -> Array:
        """Return (..., nc, 3) the points of feet with these (..., nf, 3) centres; see :meth:`arms`."""
        if self.single:
            return centres
        return centres[..., self.of, :] + self.arms(yaws, normal)


def make_feet(
    model: pin.Model, q: Array, specs: tuple[FootSpec, ...], files: ModelSource
) -> tuple[list[Foot], list[str]]:
    """Return the feet with soles, and the problems that prevent their use.

    Args:
        model: the robot's.
        q: (nq,) reference posture.
        specs: of the feet, whose frames exist.
        files: with the collision geometry.
    """
    feet, problems = [], []
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    clouds = _clouds(model, files, {int(model.frames[model.getFrameId(spec.frame)].parentJoint) for spec in specs})
    for i, spec in enumerate(specs):
        frame = model.getFrameId(spec.frame)
        cloud, key = clouds.get(int(model.frames[frame].parentJoint), np.zeros((0, 3))), f"feet.{i}.sole"
        try:
            if spec.sole == "auto":
                feet.append(_found(spec.frame, data.oMf[frame], data.oMi[1], cloud, data, model, key))
            else:
                turn = pin.rpy.rpyToMatrix(*np.radians(spec.rpy_deg))
                foot = Foot(spec.frame, np.array(spec.position_m), turn, _ordered(np.array(spec.sole)))
                _check(foot, cloud, data.oMf[frame], data, model, key)
                feet.append(foot)
        except InputError as error:
            problems.append(f"{error.argument}: {error.got}; expected {error.expected}")
    return feet, problems or _overlaps(feet, model, data)


def _found(frame: str, place: pin.SE3, base: pin.SE3, cloud: Array, data: pin.Data, model: pin.Model, key: str) -> Foot:
    """Return the sole of a link from its collision geometry: z of the world is up, x as the base's."""
    if not len(cloud):
        raise InputError(key, f"no collision geometry on the link of {frame}", "corners [[x, y], ...] and position_m")
    joint = model.frames[model.getFrameId(frame)].parentJoint
    points = cloud @ data.oMi[joint].rotation.T + data.oMi[joint].translation
    lowest = points[:, 2].min()
    heading = np.arctan2(base.rotation[1, 0], base.rotation[0, 0])
    axes = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, heading), np.array([*place.translation[:2], lowest]))
    flat = (points[points[:, 2] < lowest + _SLICE] - axes.translation) @ axes.rotation
    corners = _quadrilateral(flat[:, :2])
    if min(np.ptp(corners, axis=0)) < _SMALLEST:
        size = " x ".join(f"{1e3 * x:.0f}" for x in np.ptp(corners, axis=0))
        raise InputError(key, f"a lowest part of {frame}'s link of {size} mm", "corners [[x, y], ...] and position_m")
    relative = place.inverse() * axes
    # To a tenth of a millimetre, which meshes do not resolve.
    return Foot(frame, np.round(relative.translation, 4) + 0.0, np.array(relative.rotation), corners.round(4) + 0.0)


def _check(foot: Foot, cloud: Array, place: pin.SE3, data: pin.Data, model: pin.Model, key: str) -> None:
    """Raise for a sole that has no area, or cannot be one of its link."""
    x, y = foot.size
    hull = _hull(foot.points)
    if min(x, y) < _SMALLEST or len(hull) < 3:
        raise InputError(key, f"corners within {1e3 * x:.1f} x {1e3 * y:.1f} mm", "three or more that span an area")
    if len(hull) < len(foot.points):
        raise InputError(key, f"{len(foot.points)} corners of which {len(hull)} are on their hull", "a convex sole")
    if len(cloud):
        joint = model.frames[model.getFrameId(foot.frame)].parentJoint
        axes = place * pin.SE3(foot.rotation, foot.position)
        local = (cloud @ data.oMi[joint].rotation.T + data.oMi[joint].translation - axes.translation) @ axes.rotation
        widest = np.ptp(local[:, :2], axis=0)
        if x > _LARGER * widest[0] or y > _LARGER * widest[1]:
            link = f"at most {_LARGER:g} times its link's {widest[0]:.3f} x {widest[1]:.3f} m (corners are in m)"
            raise InputError(key, f"a sole of {x:.3f} x {y:.3f} m", link)


def _overlaps(feet: list[Foot], model: pin.Model, data: pin.Data) -> list[str]:
    """Return a problem for each pair of soles that overlap in the reference posture."""
    shapes = []
    for foot in feet:
        place = data.oMf[model.getFrameId(foot.frame)] * pin.SE3(foot.rotation, foot.position)
        shapes.append((foot.points @ place.rotation[:2, :2].T + place.translation[:2], place.translation[2]))
    return [
        f"feet: the soles of {a.frame} and {b.frame} overlap in the reference posture; expected feet apart"
        for (a, (first, low)), (b, (second, high)) in combinations(zip(feet, shapes, strict=True), 2)
        if abs(low - high) < _SLICE and not _apart(first, second)
    ]


def _apart(first: Array, second: Array) -> bool:
    """Return whether an edge of one of two convex polygons (k, 2) separates them."""
    for one, other in ((first, second), (second, first)):
        edges = np.roll(one, -1, axis=0) - one
        out = np.column_stack([edges[:, 1], -edges[:, 0]])
        if ((other[None] - one[:, None]) * out[:, None]).sum(axis=2).min(axis=1).max() >= 0.0:
            return True
    return False


def _clouds(model: pin.Model, files: ModelSource, joints: set[int]) -> dict[int, Array]:
    """Return points on the surface of the collision geometry of bodies, in the axes of their joints, m."""
    try:
        with native_stderr():
            geometry = read_geometry(model, files)
    except (ValueError, RuntimeError):
        return {}
    found: dict[int, list[Array]] = {}
    for part in geometry.geometryObjects:
        if int(part.parentJoint) in joints:
            points = _surface(part.geometry) @ part.placement.rotation.T + part.placement.translation
            found.setdefault(int(part.parentJoint), []).append(points)
    return {joint: np.vstack(parts) for joint, parts in found.items()}


def _surface(geometry: coal.CollisionGeometry) -> Array:
    """Return points whose convex hull is nearly that of a geometry, in its own axes, m."""
    if isinstance(geometry, coal.Sphere):
        return float(geometry.radius) * np.vstack([np.eye(3), -np.eye(3)])
    if isinstance(geometry, (coal.BVHModelBase, coal.ConvexBase)):
        points = geometry.vertices() if isinstance(geometry, coal.BVHModelBase) else geometry.points()
        return np.array(points, dtype=np.float64).reshape(-1, 3)
    geometry.computeLocalAABB()
    low, high = np.array(geometry.aabb_local.min_), np.array(geometry.aabb_local.max_)
    return np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T


def _ordered(points: Array) -> Array:
    """Return corners counterclockwise about their mean."""
    centred = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))]


def _hull(points: Array) -> Array:
    """Return the corners of the convex hull of (n, 2) points, counterclockwise (Andrew's monotone chain)."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered

    def half(sequence: Array) -> list[Array]:
        chain: list[Array] = []
        for point in sequence:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-1] - chain[-2], point - chain[-2]
                if ax * by - ay * bx > 1e-12:
                    break
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return np.array(half(ordered) + half(ordered[::-1]))


def _quadrilateral(points: Array) -> Array:
    """Return the largest quadrilateral with corners of the convex hull of (n, 2) points, which lies inside of it."""
    hull = _hull(points)
    if len(hull) <= 4:
        return hull
    if len(hull) > 40:  # of a fine mesh every so many, the outermost in each direction
        angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
        hull = hull[np.unique((hull @ np.array([np.cos(angles), np.sin(angles)])).argmax(axis=0))]
    corners = hull[np.array(list(combinations(range(len(hull)), 4)))]
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    areas = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return corners[int(areas.argmax())]
