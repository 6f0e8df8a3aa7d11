"""Marks of replays: arrows, friction cones, the centre of mass, targets, paths."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.typing import Array, BoolArray
from lgmpc.viz.mesh import cone, cylinder, disc, funnel, sphere, tube
from lgmpc.viz.scene import Material, Scene
from lgmpc.world import Terrain

# Okabe and Ito's palette, distinguishable by colour-blind readers.
COLORS = {
    "forces": 0x009E73,
    "planned": 0x56B4E9,
    "cones": 0x0072B2,
    "slipping": 0xD55E00,
    "com": 0x0072B2,
    "target": 0xE69F00,
    "places": 0xE69F00,
    "horizon": 0xCC79A7,
    "push": 0xD55E00,
    "path": 0xCC79A7,
    "thrusts": 0x009E73,
    "footholds": 0xE69F00,
    "belief": 0xCC79A7,
    "swings": 0x56B4E9,
    "command": 0x1D2733,
}


@dataclass(frozen=True)
class Scale:
    """Sizes of the marks, proportional to the robot's.

    Attributes:
        length: a round number of about half the robot's height, m; unit of the marks' sizes.
        newtons: force drawn as ``length``: 1, 2 or 5 times a power of ten, about one foot's share of the weight.
    """

    length: float
    newtons: float

    @classmethod
    def of(cls, height: float, weight: float, feet: int) -> "Scale":
        """Return the scale for a robot of ``height`` m with ``weight`` N on ``feet`` feet of any number of points."""
        share = max(weight / max(feet, 1), 1e-6)
        power = 10.0 ** math.floor(math.log10(share))
        newtons = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / share))) * power
        return cls(float(f"{0.45 * height:.0e}"), newtons)

    @property
    def metres_per_newton(self) -> float:
        """Length of an arrow per newton, m/N."""
        return self.length / self.newtons


@dataclass(frozen=True)
class ContactMarks:
    """Contacts of a robot at the times of k pictures.

    Attributes:
        names: (nc,) frames.
        times: (k,) times of the pictures, s.
        points: (k, nc, 3) contact points, m.
        normals: (k, nc, 3) unit normals of the ground there.
        forces: (k, nc, 3) on the robot, N.
        friction: (k, nc) coefficients; not finite where there are no friction cones.
        touching: (k, nc) flags of closed contacts.
        slipping: (k, nc) flags of forces near or outside the surface of their cone.
    """

    names: Sequence[str]
    times: Array
    points: Array
    normals: Array
    forces: Array
    friction: Array
    touching: BoolArray
    slipping: BoolArray

    def add_to(self, scene: Scene, scale: Scale) -> None:
        """Add forces below ``/overlay/forces`` and friction cones below ``/overlay/cones``."""
        for k, name in enumerate(self.names):
            add_arrow(
                scene, f"/overlay/forces/{name}", "forces", 1.0, scale, self.times, self.points[:, k], self.forces[:, k]
            )
            for folder, shown in (("cones", ~self.slipping[:, k]), ("slipping", self.slipping[:, k])):
                self._add_cones(scene, scale, k, f"/overlay/cones/{folder}/{name}", folder, shown & self.touching[:, k])

    def _add_cones(self, scene: Scene, scale: Scale, k: int, path: str, color: str, shown: BoolArray) -> None:
        material = Material(COLORS[color], 0.5 if color == "slipping" else 0.22, double_sided=True, shininess=0.0)
        frictions = np.unique(self.friction[np.isfinite(self.friction)]).tolist()
        height = 0.55 * scale.length
        for friction in frictions:
            each = path + (f"/{friction:g}" if len(frictions) > 1 else "")
            scene.add_mesh(each, funnel(friction * height, height), material)
            turns, flags = turns_to(self.normals[:, k]), shown & (self.friction[:, k] == friction)
            scene.animate(each, self.times, position=self.points[:, k], quaternion=turns, visible=flags)


def turns_to(directions: Array) -> Array:
    """Return (k, 4) the smallest rotations, x y z w, from the z axis to unit vectors (k, 3)."""
    x, y, z = directions.T
    turns = np.column_stack((-y, x, 0.0 * z, 1.0 + z))
    turns[z < -1.0 + 1e-9] = [1.0, 0.0, 0.0, 0.0]
    return turns / np.linalg.norm(turns, axis=1)[:, None]


def add_ball(
    scene: Scene,
    path: str,
    scale: Scale,
    ground: Terrain,
    times: Array,
    where: Array,
    shown: BoolArray | None,
    *,
    target: bool,
) -> None:
    """Add a ball with its vertical projection on the ground: the centre of mass, or its target, larger and paler."""
    size = 0.085 * scale.length
    color = COLORS["target" if target else "com"]
    # The larger, translucent target first: the centre of mass is drawn over it.
    scene.add_mesh(
        f"{path}/ball", sphere(1.45 * size if target else size), Material(color, 0.5 if target else 1.0, True)
    )
    scene.set(f"{path}/ball/<object>", "renderOrder", 10 if target else 11)
    scene.animate(f"{path}/ball", times, position=where, visible=shown)
    scene.add_mesh(f"{path}/floor", disc(0.8 * size), Material(color, 0.85, flat=True))
    normals = ground.normal(where[:, :2])
    spot = np.column_stack((where[:, :2], ground.height(where[:, :2]))) + (0.0016 if target else 0.0025) * normals
    grow = np.full((len(where), 3), 1.6 if target else 1.0)
    scene.animate(f"{path}/floor", times, position=spot, quaternion=turns_to(normals), scale=grow, visible=shown)


def add_plumb_line(scene: Scene, path: str, scale: Scale, ground: Terrain, times: Array, where: Array) -> None:
    """Add a thin line at ``path`` from ``where`` (k, 3) down to the ground."""
    scene.add_mesh(path, cylinder(0.0068 * scale.length, 0.0, 1.0), Material(COLORS["com"], 0.6, flat=True))
    height = ground.height(where[:, :2])
    stretch = np.column_stack((np.ones((len(where), 2)), np.maximum(where[:, 2] - height, 1e-3)))
    scene.animate(path, times, position=np.column_stack((where[:, :2], height)), scale=stretch)


def add_place(scene: Scene, path: str, size: float, position: Array, rotation: Array | None) -> None:
    """Add a target at ``path``: a translucent ball, and the axes of a frame (x red, y green, z blue) if given."""
    scene.add_mesh(f"{path}/ball", sphere(0.14 * size), Material(COLORS["target"], 0.55, on_top=True))
    scene.place(path, position, (0.0, 0.0, 0.0, 1.0) if rotation is None else pin.Quaternion(rotation).coeffs())
    if rotation is None:
        return
    shaft, head = cylinder(0.028 * size, 0.0, 0.8 * size), cone(0.07 * size, 0.8 * size, size)
    half = math.sqrt(0.5)
    for name, color, turn in (
        ("x", 0xC8362B, (0.0, half, 0.0, half)),
        ("y", 0x2E8B46, (-half, 0.0, 0.0, half)),
        ("z", 0x2F6DB5, (0.0, 0.0, 0.0, 1.0)),
    ):
        for part, mesh in (("shaft", shaft), ("head", head)):
            scene.add_mesh(f"{path}/{name}/{part}", mesh, Material(color, 0.9, on_top=True, flat=True))
        scene.place(f"{path}/{name}", (0.0, 0.0, 0.0), turn)


def add_path(scene: Scene, path: str, points: Array, radius: float, color: int) -> None:
    """Add the line through ``points`` (n, 3) at ``path``, if its length is not zero."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    far = np.concatenate(([True], step > 1e-9))
    if np.count_nonzero(far) > 1:
        scene.add_mesh(path, tube(points[far], radius), Material(color, 0.8, on_top=True, shininess=0.0))


def add_arrow(
    scene: Scene, path: str, kind: str, width: float, scale: Scale, times: Array, tail: Array, force: Array
) -> None:
    """Add an arrow at ``path``: a shaft of variable length and a head of fixed size; hidden where the force is zero.

    Args:
        scene: the scene.
        path: the arrow's path.
        kind: key of its colour in :data:`COLORS`.
        width: width relative to that of a contact force.
        scale: sizes of the marks.
        times: (k,) times of the pictures, s.
        tail: (k, 3) where it begins, m.
        force: (k, 3) force, N, or another vector in the unit of the scale.
    """
    radius, tip_length = 0.028 * scale.length * width, 0.2 * scale.length * math.sqrt(width)
    material = Material(COLORS[kind], shininess=10.0)
    scene.add_mesh(f"{path}/shaft", cylinder(radius, 0.0, 1.0), material)
    scene.add_mesh(f"{path}/head", cone(2.3 * radius, -tip_length, 0.0), material)
    shown: BoolArray = scale.metres_per_newton * np.linalg.norm(force, axis=1) > 0.02 * scale.length
    # Visibility is a step function of time, the rest is interpolated: an arrow must not move until it is hidden.
    last = np.maximum.accumulate(np.where(shown, np.arange(len(times)), 0))
    tail, force = tail[last], force[last]
    size = np.linalg.norm(force, axis=1)
    length = scale.metres_per_newton * size
    direction = np.where(shown[last, None], force / np.maximum(size, 1e-300)[:, None], [0.0, 0.0, 1.0])
    scene.animate(path, times, position=tail, quaternion=turns_to(direction), visible=shown)
    head = np.minimum(1.0, length / (1.5 * tip_length))
    ones = np.ones((len(times), 2))
    stretch = np.column_stack((ones, np.maximum(length - 0.9 * head * tip_length, 1e-4)))
    scene.animate(f"{path}/shaft", times, scale=stretch)
    tip, shape = np.column_stack((0.0 * ones, length)), np.repeat(np.maximum(head, 1e-3)[:, None], 3, axis=1)
    scene.animate(f"{path}/head", times, position=tip, scale=shape)
