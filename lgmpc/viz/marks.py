"""Marks of replays: arrows, friction cones, the centre of mass, targets, paths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from lgmpc.typing import Array, BoolArray
from lgmpc.viz.mesh import Mesh, cone, cylinder, disc, lathe, sphere, tube
from lgmpc.viz.scene import Material, Scene

__all__ = ["COLORS", "Arrow", "Scale", "add_ball", "add_cone", "add_path", "add_place", "add_plumb_line"]

# Okabe and Ito's palette, distinguishable by colour-blind readers.
COLORS = {
    "forces": 0x009E73,
    "planned": 0x56B4E9,
    "cones": 0x0072B2,
    "slipping": 0xD55E00,
    "com": 0x0072B2,
    "target": 0xE69F00,
    "horizon": 0xCC79A7,
    "push": 0xD55E00,
    "path": 0xCC79A7,
    "thrusts": 0x009E73,
    "footholds": 0xE69F00,
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
    def of(cls, height: float, weight: float, contacts: int) -> Scale:
        """Return the scale for a robot of ``height`` m with ``weight`` N on ``contacts`` contacts."""
        share = max(weight / max(contacts, 1), 1e-6)
        power = 10.0 ** math.floor(math.log10(share))
        newtons = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / share))) * power
        return cls(float(f"{0.45 * height:.0e}"), newtons)

    @property
    def metres_per_newton(self) -> float:
        """Length of an arrow per newton, m/N."""
        return self.length / self.newtons


def add_cone(
    scene: Scene, path: str, friction: float, scale: Scale, times: Array, point: Array, shown: BoolArray, *, warn: bool
) -> None:
    """Add a friction cone at ``path``, its apex at ``point`` (k, 3) at ``times`` (k,), in the warning colour or not."""
    surface = _cone_surface(friction, 0.55 * scale.length)
    color, opacity = (COLORS["slipping"], 0.5) if warn else (COLORS["cones"], 0.22)
    scene.add_mesh(path, surface, Material(color, opacity, double_sided=True, shininess=0.0))
    scene.animate(path, times, position=point, visible=shown)


@lru_cache(maxsize=8)
def _cone_surface(friction: float, height: float) -> Mesh:
    """Return the mesh of all cones; cached, so that a scene stores it once."""
    return lathe([(0.0, 0.0), (friction * height, height)], segments=48)


def add_ball(
    scene: Scene, path: str, scale: Scale, times: Array, where: Array, shown: BoolArray | None, *, target: bool
) -> None:
    """Add a ball with its shadow on the floor at ``path``: the centre of mass, or its target, larger and paler."""
    size = 0.085 * scale.length
    color = COLORS["target" if target else "com"]
    # The larger, translucent target first: the centre of mass is drawn over it.
    scene.add_mesh(
        f"{path}/ball", sphere(1.45 * size if target else size), Material(color, 0.5 if target else 1.0, True)
    )
    scene.set(f"{path}/ball/<object>", "renderOrder", 10 if target else 11)
    scene.animate(f"{path}/ball", times, position=where, visible=shown)
    scene.add_mesh(f"{path}/floor", disc(0.8 * size, 0.002), Material(color, 0.85, flat=True))
    on_floor = where * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.0 if target else 0.0005]
    grow = np.full((len(where), 3), [1.6, 1.6, 0.8] if target else [1.0, 1.0, 1.0])
    scene.animate(f"{path}/floor", times, position=on_floor, scale=grow, visible=shown)


def add_plumb_line(scene: Scene, path: str, scale: Scale, times: Array, where: Array) -> None:
    """Add a thin line at ``path`` from ``where`` (k, 3) down to the floor."""
    scene.add_mesh(path, cylinder(0.0068 * scale.length, 0.0, 1.0), Material(COLORS["com"], 0.6, flat=True))
    stretch = np.column_stack((np.ones((len(where), 2)), np.maximum(where[:, 2], 1e-3)))
    scene.animate(path, times, position=where * [1.0, 1.0, 0.0], scale=stretch)


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
            scene.add_mesh(f"{path}/{name}/{part}", mesh, Material(color, 0.9, on_top=True))
        scene.place(f"{path}/{name}", (0.0, 0.0, 0.0), turn)


def add_path(scene: Scene, path: str, points: Array, radius: float, color: int) -> None:
    """Add the line through ``points`` (n, 3) at ``path``, if its length is not zero."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    far = np.concatenate(([True], step > 1e-9))
    if np.count_nonzero(far) > 1:
        scene.add_mesh(path, tube(points[far], radius), Material(color, 0.8, on_top=True, shininess=0.0))


@dataclass(frozen=True)
class Arrow:
    """An arrow of a force: a shaft of variable length and a head of fixed size.

    Attributes:
        path: path in the scene.
        color: 0xRRGGBB.
        width: width relative to that of a contact force.
        scale: sizes of the marks.
    """

    path: str
    color: int
    width: float
    scale: Scale

    @property
    def _head(self) -> float:
        return 0.2 * self.scale.length * math.sqrt(self.width)

    def add(self, scene: Scene) -> None:
        """Add the arrow to the scene."""
        radius = 0.028 * self.scale.length * self.width
        material = Material(self.color, shininess=10.0)
        scene.add_mesh(f"{self.path}/shaft", cylinder(radius, 0.0, 1.0), material)
        scene.add_mesh(f"{self.path}/head", cone(2.3 * radius, -self._head, 0.0), material)

    def animate(self, scene: Scene, times: Array, tail: Array, force: Array) -> None:
        """Place it at ``tail`` (k, 3) along ``force`` (k, 3), N, at ``times`` (k,); hidden where the force is zero."""
        shown: BoolArray = self.scale.metres_per_newton * np.linalg.norm(force, axis=1) > 0.02 * self.scale.length
        # Visibility is a step function of time, the rest is interpolated: an arrow must not move until it is hidden.
        last = np.maximum.accumulate(np.where(shown, np.arange(len(times)), 0))
        tail, force = tail[last], force[last]
        size = np.linalg.norm(force, axis=1)
        length = self.scale.metres_per_newton * size
        upright = np.array([0.0, 0.0, 1.0])
        turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
        for k in np.flatnonzero(shown[last]):
            turns[k] = pin.Quaternion.FromTwoVectors(upright, force[k] / size[k]).coeffs()
        scene.animate(self.path, times, position=tail, quaternion=turns, visible=shown)
        head = np.minimum(1.0, length / (1.5 * self._head))
        stretch = np.maximum(length - 0.9 * head * self._head, 1e-4)
        ones = np.ones(len(times))
        scene.animate(f"{self.path}/shaft", times, scale=np.column_stack((ones, ones, stretch)))
        tip = np.column_stack((0.0 * ones, 0.0 * ones, length))
        scene.animate(
            f"{self.path}/head", times, position=tip, scale=np.repeat(np.maximum(head, 1e-3)[:, None], 3, axis=1)
        )
