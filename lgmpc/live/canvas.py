"""The replay's scene on a viser server: what the marks of :mod:`lgmpc.viz` add and animate is drawn at once."""

from typing import Any

import numpy as np
import viser
from numpy.typing import ArrayLike

from lgmpc.typing import Array, BoolArray
from lgmpc.viz.mesh import Mesh
from lgmpc.viz.scene import Material, Scene

ROOT = "/world"
"""Path of all that is drawn. It is moved against the robot's way, so that the camera follows and can be turned."""


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

    def add_mesh(self, path: str, mesh: Mesh, material: Material) -> None:
        """Add a geometry at ``path``, unless there is one."""
        if path in self._nodes or material.shadow_only:
            return
        self._nodes[path] = self._api.add_mesh_simple(
            ROOT + path, mesh.positions, mesh.faces, color=rgb(material.color), opacity=material.opacity,
            side="double" if material.double_sided else "front", cast_shadow=material.opacity == 1.0,
        )  # fmt: skip

    def add_segments(self, path: str, points: Array, color: int, opacity: float = 1.0) -> None:
        """Add line segments at ``path`` that join the (2 n, 3) ``points`` in pairs."""
        pairs = points.reshape(-1, 2, 3).astype(np.float32)
        self._nodes[path] = self._api.add_line_segments(ROOT + path, pairs, colors=rgb(color), line_width=1.0)

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


def wxyz(quaternion: Array) -> Array:
    """Return a quaternion x y z w in viser's order."""
    x, y, z, w = quaternion
    return np.array([w, x, y, z])


def rgb(color: int) -> tuple[int, int, int]:
    """Return red, green and blue of a colour 0xRRGGBB."""
    return color >> 16 & 255, color >> 8 & 255, color & 255
