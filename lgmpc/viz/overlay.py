"""What a replay shows beside the robot: forces, friction cones, centre of mass and target, prediction, pushes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.runs import RunLog
from lgmpc.typing import Array, BoolArray, IntArray
from lgmpc.viz.mesh import cone, cylinder, disc, lathe, sphere
from lgmpc.viz.scene import Material, Scene

__all__ = ["COLORS", "Frames", "Scale", "add_overlay"]

# Okabe and Ito's palette: told apart by colour-blind eyes too.
COLORS = {
    "forces": 0x009E73,
    "planned": 0x56B4E9,
    "cones": 0x0072B2,
    "slipping": 0xD55E00,
    "com": 0x0072B2,
    "target": 0xE69F00,
    "horizon": 0xCC79A7,
    "push": 0xD55E00,
}

_NEAR_SLIP = 0.1
"""A cone is drawn in the warning colour when less than this fraction of ``mu f_n`` is left."""


@dataclass(frozen=True)
class Frames:
    """The pictures of a replay: which ticks of the log they show.

    Attributes:
        times: (k,) s from the replay's start.
        ticks: (k,) index into the log.
    """

    times: Array
    ticks: IntArray

    @classmethod
    def of(cls, log: RunLog, rate_hz: float = 50.0, limit: int = 3000) -> Frames:
        """Choose pictures at ``rate_hz``, at most ``limit``, up to the first state that is not finite."""
        finite = np.isfinite(log.q).all(axis=1)
        end = log.ticks if finite.all() else int(np.argmin(finite))
        elapsed = log.time[:end] - log.time[0]
        count = min(int(elapsed[-1] * rate_hz) + 1, limit)
        if count < 2:
            return cls(np.zeros(1), np.zeros(1, dtype=np.int64))
        wanted = np.linspace(0.0, elapsed[-1], count)
        ticks = np.unique(np.clip(np.searchsorted(elapsed, wanted), 0, end - 1)).astype(np.int64)
        return cls(elapsed[ticks], ticks)

    def mean(self, values: Array) -> Array:
        """Return the mean of a channel from each picture to the next: what flickers between them is not lost."""
        return np.add.reduceat(values[: self.ticks[-1] + 1], self.ticks, axis=0) / np.diff(
            self.ticks, append=self.ticks[-1] + 1
        ).reshape(-1, *[1] * (values.ndim - 1))


@dataclass(frozen=True)
class Scale:
    """Sizes of the drawn things, from the robot's own.

    Attributes:
        length: a round length of about half the robot's height, m; things are proportioned by it.
        newtons: force drawn as ``length``: 1, 2 or 5 times a power of ten, about one foot's share of the weight.
    """

    length: float
    newtons: float

    @classmethod
    def of(cls, height: float, weight: float, contacts: int) -> Scale:
        """Choose sizes for a robot ``height`` m tall that rests ``weight`` N on ``contacts`` contacts."""
        share = max(weight / max(contacts, 1), 1e-6)
        power = 10.0 ** math.floor(math.log10(share))
        newtons = min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / share))) * power
        return cls(float(f"{0.45 * height:.0e}"), newtons)

    @property
    def metres_per_newton(self) -> float:
        """Length of an arrow for each newton."""
        return self.length / self.newtons


def add_overlay(scene: Scene, log: RunLog, frames: Frames, scale: Scale, trunk_half_sides: Array) -> None:
    """Add everything below ``/overlay``, one folder for each thing that the page can show or hide."""
    _add_contacts(scene, log, frames, scale)
    _add_com(scene, log, frames, scale)
    if len(log.mpc_time):
        _add_horizon(scene, log, frames, scale)
    _add_push(scene, log, frames, scale, trunk_half_sides)


def _add_contacts(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    height = 0.55 * scale.length
    surface = lathe([(0.0, 0.0), (log.friction * height, height)], segments=48)
    ok = Material(COLORS["cones"], 0.22, double_sided=True, shininess=0.0)
    warning = Material(COLORS["slipping"], 0.5, double_sided=True, shininess=0.0)
    measured, planned = frames.mean(log.contact_forces), frames.mean(log.contact_forces_desired)
    margin = log.friction * log.contact_forces[..., 2] - np.linalg.norm(log.contact_forces[..., :2], axis=2)
    near = margin < _NEAR_SLIP * log.friction * log.contact_forces[..., 2]
    closed = log.contact_forces[..., 2] > 0.02 * scale.newtons
    slipping = frames.mean((near & closed).astype(np.float64)) > 0.0
    touching = frames.mean(closed.astype(np.float64)) > 0.0
    for k, name in enumerate(log.contact_frames.tolist()):
        point = log.contact_points[frames.ticks, k]
        for folder, material, shown in (
            ("cones", ok, touching[:, k] & ~slipping[:, k]),
            ("slipping", warning, touching[:, k] & slipping[:, k]),
        ):
            path = f"/overlay/cones/{folder}/{name}"
            scene.add_mesh(path, surface, material)
            scene.animate(path, frames.times, position=point, visible=shown)
        for folder, force, width in (("forces", measured[:, k], 1.0), ("planned", planned[:, k], 0.7)):
            arrow = _Arrow(f"/overlay/{folder}/{name}", COLORS[folder], width, scale)
            arrow.add(scene)
            arrow.animate(scene, frames.times, point, force)


def _add_com(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    size = 0.085 * scale.length
    com, target = log.com[frames.ticks], log.com_reference[frames.ticks]
    known: BoolArray = np.asarray(np.isfinite(target).all(axis=1))
    target = np.where(known[:, None], target, com)
    shadow = disc(0.8 * size, 0.002)
    for name, color, path, ball, where, shown in (
        ("com", COLORS["com"], "/overlay/com/com", Material(COLORS["com"], on_top=True), com, None),
        ("target", COLORS["target"], "/overlay/com/target", Material(COLORS["target"], 0.5, True), target, known),
    ):
        radius = size if name == "com" else 1.45 * size
        # The larger, translucent target first: the centre of mass lies over it.
        scene.add_mesh(f"{path}/ball", sphere(radius), ball)
        scene.set(f"{path}/ball/<object>", "renderOrder", 11 if name == "com" else 10)
        scene.animate(f"{path}/ball", frames.times, position=where, visible=shown)
        scene.add_mesh(f"{path}/floor", shadow, Material(color, 0.85, flat=True))
        on_floor = where * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.0005 if name == "com" else 0.0]
        grow = np.full((len(where), 3), [1.0, 1.0, 1.0] if name == "com" else [1.6, 1.6, 0.8])
        scene.animate(f"{path}/floor", frames.times, position=on_floor, scale=grow, visible=shown)
    scene.add_mesh("/overlay/com/plumb", cylinder(0.08 * size, 0.0, 1.0), Material(COLORS["com"], 0.6, flat=True))
    stretch = np.column_stack((np.ones((len(com), 2)), np.maximum(com[:, 2], 1e-3)))
    scene.animate("/overlay/com/plumb", frames.times, position=com * [1.0, 1.0, 0.0], scale=stretch)


def _add_horizon(scene: Scene, log: RunLog, frames: Frames, scale: Scale) -> None:
    """Beads along the prediction that was valid at each picture, tapering towards its end."""
    update = np.searchsorted(log.mpc_time, log.time[frames.ticks], side="right") - 1
    finite: BoolArray = np.asarray(np.isfinite(log.mpc_horizon_com).all(axis=(1, 2)))
    age = log.time[frames.ticks] - log.mpc_time[np.maximum(update, 0)]
    known: BoolArray = (update >= 0) & finite[np.maximum(update, 0)] & (age < 1.5 * log.mpc_period_s)
    beads = np.where(known[:, None, None], log.mpc_horizon_com[np.maximum(update, 0)], 0.0)
    nodes = beads.shape[1]
    material = Material(COLORS["horizon"], on_top=True)
    for node in range(nodes):
        path = f"/overlay/horizon/{node:02d}"
        scene.add_mesh(path, sphere(scale.length * (0.04 - 0.022 * node / max(nodes - 1, 1))), material)
        scene.set(f"{path}/<object>", "renderOrder", 12)
        scene.animate(path, frames.times, position=beads[:, node], visible=known)


def _add_push(scene: Scene, log: RunLog, frames: Frames, scale: Scale, trunk_half_sides: Array) -> None:
    """An arrow that ends where the push's line of action leaves the trunk."""
    force, point = log.push[frames.ticks, :3], log.push_point[frames.ticks]
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    direction = force / np.where(size, size, 1.0)[:, None]
    if log.floating_base and trunk_half_sides.any():
        clearance = np.empty(len(force))
        for k, (along, pose) in enumerate(zip(direction, log.q[frames.ticks, :7], strict=True)):
            in_body = np.abs(pin.XYZQUATToSE3(pose).rotation.T @ along)
            clearance[k] = np.min(trunk_half_sides / np.maximum(in_body, 1e-9)) if size[k] else 0.0
        point = point - (clearance + 0.03 * scale.length)[:, None] * direction
    arrow = _Arrow("/overlay/push/force", COLORS["push"], 2.0, scale)
    arrow.add(scene)
    arrow.animate(scene, frames.times, point - scale.metres_per_newton * force, force)


@dataclass(frozen=True)
class _Arrow:
    """A shaft that stretches and a head that does not."""

    path: str
    color: int
    width: float
    scale: Scale

    @property
    def _head(self) -> float:
        return 0.2 * self.scale.length * math.sqrt(self.width)

    def add(self, scene: Scene) -> None:
        radius = 0.028 * self.scale.length * self.width
        material = Material(self.color, shininess=10.0)
        scene.add_mesh(f"{self.path}/shaft", cylinder(radius, 0.0, 1.0), material)
        scene.add_mesh(f"{self.path}/head", cone(2.3 * radius, -self._head, 0.0), material)

    def animate(self, scene: Scene, times: Array, tail: Array, force: Array) -> None:
        shown: BoolArray = self.scale.metres_per_newton * np.linalg.norm(force, axis=1) > 0.02 * self.scale.length
        # Visibility changes at a picture, the rest glides from one to the next: what vanishes must not move meanwhile.
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
