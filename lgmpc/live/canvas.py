"""The replay's scene on a viser server: what the marks of :mod:`lgmpc.viz` add and animate is drawn at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import ArrayLike

from lgmpc.typing import Array, BoolArray
from lgmpc.viz.mesh import Mesh, Solid, shade
from lgmpc.viz.scene import Material, Scene

__all__ = ["ROOT", "LiveScene", "wxyz"]

ROOT = "/world"
"""Path of all that is drawn. It is moved against the robot's way, so that the camera follows and can be turned."""

_AROUND = 24
_BOX = np.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6),
                 (0, 6, 2), (1, 3, 7), (1, 7, 5)])  # fmt: skip


class LiveScene(Scene):
    """A :class:`~lgmpc.viz.scene.Scene` whose animations have one picture, the present one.

    Objects stay when they are added again, and vanish from the pictures in which they are not animated.

    Args:
        server: the viser server.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        super().__init__()
        self._api = server.scene
        self._nodes: dict[str, Any] = {}
        self._values: dict[tuple[str, str], Array] = {}
        self._animated: set[str] = set()
        self._drawn: set[str] = set()
        self.hidden: set[str] = set()

    def add_mesh(self, path: str, mesh: Mesh | Solid, material: Material) -> None:
        """Add a geometry at ``path``, unless there is one."""
        if path in self._nodes or material.shadow_only:
            return
        triangles = mesh if isinstance(mesh, Mesh) else tessellated(mesh)
        self._nodes[path] = self._api.add_mesh_simple(
            ROOT + path, triangles.positions, triangles.faces, color=_rgb(material.color), opacity=material.opacity,
            side="double" if material.double_sided else "front", cast_shadow=material.opacity == 1.0,
        )  # fmt: skip

    def add_segments(self, path: str, points: Array, color: int, opacity: float = 1.0) -> None:
        """Add line segments at ``path`` that join the (2 n, 3) ``points`` in pairs."""
        pairs = points.reshape(-1, 2, 3).astype(np.float32)
        self._nodes[path] = self._api.add_line_segments(ROOT + path, pairs, colors=_rgb(color), line_width=1.0)

    def set(self, path: str, name: str, value: Any) -> None:
        """Do nothing: what viser cannot do is left out, such as an order of drawing."""

    def place(self, path: str, position: ArrayLike, quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Set the placement of ``path`` in its parent."""
        node = self._node(path)
        node.position, node.wxyz = np.asarray(position, dtype=np.float64), wxyz(np.asarray(quaternion))

    def animate(
        self,
        path: str,
        times: Array,
        *,
        position: Array | None = None,
        quaternion: Array | None = None,
        scale: Array | None = None,
        visible: BoolArray | None = None,
    ) -> None:
        """Show the object at ``path`` as in the last picture."""
        node = self._node(path)
        self._animated.add(path)
        self._drawn.add(path)
        if visible is not None and not visible[-1]:
            self._animated.discard(path)
            return
        for name, values in (("position", position), ("wxyz", quaternion), ("scale", scale)):
            if values is None or np.array_equal(self._values.get((path, name), ()), values[-1]):
                continue
            value = self._values[path, name] = values[-1].copy()
            setattr(node, name, wxyz(value) if name == "wxyz" else tuple(value.tolist()))

    def finish(self) -> None:
        """Hide what was animated in an earlier picture but not in this one, and what the user does not want to see."""
        for path in self._drawn:
            shown = path in self._animated and path.split("/")[2] not in self.hidden
            if self._nodes[path].visible is not shown:
                self._nodes[path].visible = shown
        self._animated.clear()

    def remove(self, path: str) -> None:
        """Remove all objects below a path."""
        removed = {each for each in self._nodes if each.startswith(f"{path}/")}
        for each in removed:
            del self._nodes[each]
        self._api.remove_by_name(ROOT + path)
        self._drawn -= removed
        self._values = {key: value for key, value in self._values.items() if key[0] not in removed}

    def node(self, path: str) -> Any:
        """Return viser's handle of an object."""
        return self._nodes[path]

    def _node(self, path: str) -> Any:
        found = self._nodes.get(path)
        if found is None:
            found = self._api.get_handle_by_name(ROOT + path) or self._api.add_frame(ROOT + path, show_axes=False)
            self._nodes[path] = found
        return found


def tessellated(solid: Solid) -> Mesh:
    """Return triangles of a solid of the replay: of a box, or of one that is made by turning a profile."""
    sizes, matrix = solid.sizes, solid.matrix
    kind = sizes["type"]
    if kind == "BoxGeometry":
        half = 0.5 * np.array([sizes["width"], sizes["height"], sizes["depth"]])
        vertices = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]) * half
        faces = _BOX
    else:
        vertices, faces = _turned(_profile(kind, sizes))
        if kind == "CircleGeometry":  # in its own x-y plane
            vertices = vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]
    mesh = shade(vertices @ matrix[:3, :3].T + matrix[:3, 3], faces)
    return mesh


def _profile(kind: str, sizes: Mapping[str, Any]) -> Array:
    """Return (n, 2) radii and heights from the bottom to the top of a solid of revolution about y."""
    if kind == "CylinderGeometry":
        half, bottom, top = 0.5 * sizes["height"], sizes["radiusBottom"], sizes["radiusTop"]
        ends = [(bottom, -half), (top, half)]
        return np.array(ends if sizes.get("openEnded") else [(0.0, -half), *ends, (0.0, half)])
    if kind == "SphereGeometry":
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13)
        return float(sizes["radius"]) * np.column_stack([np.cos(angles), np.sin(angles)])
    if kind == "CircleGeometry":
        return np.array([(sizes["radius"], 0.0), (0.0, 0.0)])
    if kind == "LatheGeometry":
        return np.array([(point["x"], point["y"]) for point in sizes["points"]])
    raise ValueError(f"no triangles of a {kind}")


def _turned(profile: Array) -> tuple[Array, Any]:
    """Return vertices and triangles of a profile (n, 2) turned about y."""
    angles = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    radii, heights = profile.T
    x, z = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))
    vertices = np.stack([x, np.broadcast_to(heights[:, None], x.shape), z], axis=-1).reshape(-1, 3)
    ring, at = np.meshgrid(np.arange(len(profile) - 1), np.arange(_AROUND), indexing="ij")
    a, b = (ring * _AROUND + at).ravel(), (ring * _AROUND + (at + 1) % _AROUND).ravel()
    faces = np.concatenate([np.column_stack([a, a + _AROUND, b]), np.column_stack([b, a + _AROUND, b + _AROUND])])
    return vertices, faces


def wxyz(quaternion: Array) -> Array:
    """Return a quaternion x y z w in viser's order."""
    x, y, z, w = quaternion
    return np.array([w, x, y, z])


def _rgb(color: int) -> tuple[int, int, int]:
    return color >> 16 & 255, color >> 8 & 255, color & 255
