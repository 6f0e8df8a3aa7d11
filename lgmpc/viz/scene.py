"""Scenes of the meshcat viewer: its commands as JSON, with all arrays in one block of bytes.

The viewer accepts objects as three.js JSON, by path, and animations as key-frame tracks. Arrays are written in the JSON
as ``{"$array": [type, offset, count]}``; the page substitutes typed arrays on the block of bytes. A replay has a tenth
of the size of one with numbers as text, and geometry that several links share is stored once.
"""

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lgmpc.typing import Array, BoolArray
from lgmpc.viz.mesh import Mesh

_POSITION_STEP = 2e-5
"""Resolution of animated positions and scales, m: far below a pixel. Keys equal to it are omitted."""

_ROTATION_STEP = 2e-5
"""Resolution of animated quaternions."""


@dataclass(frozen=True)
class Material:
    """Appearance of a surface.

    Attributes:
        color: 0xRRGGBB.
        opacity: 1 = solid.
        on_top: drawn over all other objects, so that the robot does not hide it.
        double_sided: visible from inside too.
        shininess: sharpness of the highlight; 0 = matt.
        flat: not shaded by lights.
        shadow_only: only shadows on it are visible, in its colour and opacity.
    """

    color: int
    opacity: float = 1.0
    on_top: bool = False
    double_sided: bool = False
    shininess: float = 25.0
    flat: bool = False
    shadow_only: bool = False

    @property
    def _kind(self) -> str:
        return "ShadowMaterial" if self.shadow_only else "MeshBasicMaterial" if self.flat else "MeshPhongMaterial"

    def to_json(self, uuid: str) -> dict[str, Any]:
        """Return its three.js JSON."""
        content: dict[str, Any] = {
            "uuid": uuid,
            "type": self._kind,
            "color": self.color,
            "opacity": self.opacity,
            # Transparent objects are drawn last: those drawn on top must be among them.
            "transparent": self.opacity < 1.0 or self.on_top,
            "depthTest": not self.on_top,
            "depthWrite": self.opacity == 1.0 and not self.on_top,
            "side": 2 if self.double_sided else 0,
        }
        if self._kind == "MeshPhongMaterial":
            content |= {"shininess": self.shininess, "specular": 0x3A3A3A if self.shininess else 0}
        return content


class Scene:
    """Objects, properties and one animation, in the order in which the viewer receives them."""

    def __init__(self) -> None:
        self._commands: list[dict[str, Any]] = []
        self._clips: list[dict[str, Any]] = []
        self._bytes = bytearray()
        self._geometries: dict[int, tuple[Mesh, dict[str, Any]]] = {}
        self._count, self.duration = 0, 0.0

    def add_mesh(self, path: str, mesh: Mesh, material: Material) -> None:
        """Add a geometry at ``path``; one that is used several times is stored once."""
        known = self._geometries.get(id(mesh))
        if known is None:
            normals = np.round(mesh.normals * 32767.0).astype(np.int16)
            index = mesh.faces.astype(np.uint16) if len(mesh.positions) < 65536 else mesh.faces
            known = (
                mesh,
                {
                    "attributes": {
                        "position": self._attribute(mesh.positions.astype(np.float32)),
                        "normal": self._attribute(normals) | {"normalized": True},
                    },
                    "index": self._attribute(index.reshape(-1, 1)),
                },
            )
            self._geometries[id(mesh)] = known
        self._add(path, "Mesh", known[1], material.to_json(self._uuid()))

    def add_segments(self, path: str, points: Array, color: int, opacity: float = 1.0) -> None:
        """Add line segments at ``path`` that join the (2 n, 3) ``points`` in pairs."""
        material = {
            "uuid": self._uuid(),
            "type": "LineBasicMaterial",
            "color": color,
            "opacity": opacity,
            "transparent": opacity < 1.0,
        }
        data = {"attributes": {"position": self._attribute(points.astype(np.float32))}}
        self._add(path, "LineSegments", data, material)

    def has(self, folder: str) -> bool:
        """Return whether there is an object whose path begins so."""
        return any(each["type"] == "set_object" and each["path"].startswith(folder) for each in self._commands)

    def set(self, path: str, name: str, value: object) -> None:
        """Set a property (visible, position, scale, ...) of the object at ``path``."""
        self._commands.append({"type": "set_property", "path": path, "property": name, "value": value})

    def place(self, path: str, position: ArrayLike, quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Set the placement of ``path`` in its parent: position (3,), m, quaternion x y z w."""
        self.set(path, "position", np.asarray(position, dtype=np.float64).tolist())
        self.set(path, "quaternion", np.asarray(quaternion, dtype=np.float64).tolist())

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
        """Animate the object at ``path``.

        Args:
            path: the object.
            times: (n,) s from 0, increasing.
            position: (n, 3) m.
            quaternion: (n, 4) x y z w, of either sign.
            scale: (n, 3).
            visible: (n,) shown from each time to the next.
        """
        tracks = []
        quaternion = None if quaternion is None else _continuous(quaternion)
        for name, kind, values, step in (
            ("position", "vector", position, _POSITION_STEP),
            ("quaternion", "quaternion", quaternion, _ROTATION_STEP),
            ("scale", "vector", scale, _POSITION_STEP),
        ):
            if values is None:
                continue
            rounded = np.round(values / step)
            self.set(path, name, (rounded[0] * step).tolist())
            keys = _changing(rounded)
            if len(keys):
                track = {"times": self._array(times[keys].astype(np.float32))}
                track |= {"values": self._array((rounded[keys] * step).astype(np.float32))}
                tracks.append({"name": f".{name}", "type": kind} | track)
        if visible is not None:
            self.set(path, "visible", bool(visible[0]))
            starts = np.concatenate(([0], np.flatnonzero(np.diff(visible)) + 1))
            if len(starts) > 1:
                track = {"times": times[starts].tolist(), "values": visible[starts].tolist()}
                tracks.append({"name": ".visible", "type": "bool"} | track)
        if tracks:
            self.duration = max(self.duration, float(times[-1]))
            self._clips.append({"path": path, "clip": {"fps": 1, "name": "replay", "tracks": tracks}})

    def pack(self, extra: Mapping[str, object]) -> bytes:
        """Return the scene and ``extra`` (JSON) for the page: gzip of [length, JSON, padding, arrays]."""
        animations = [{"path": c["path"], "clip": c["clip"] | {"duration": self.duration}} for c in self._clips]
        content = {"commands": self._commands, "animations": animations, "duration": self.duration} | dict(extra)
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 8)
        return gzip.compress(len(text).to_bytes(8, "little") + text + bytes(self._bytes), compresslevel=9, mtime=0)

    def _add(self, path: str, kind: str, data: Mapping[str, Any], material: Mapping[str, Any]) -> None:
        geometry = self._uuid()
        content = {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": geometry, "type": "BufferGeometry", "data": data}],
            "materials": [material],
            "object": {"uuid": self._uuid(), "type": kind, "geometry": geometry, "material": material["uuid"]},
        }
        self._commands.append({"type": "set_object", "path": path, "object": content})

    def _attribute(self, array: NDArray[Any]) -> dict[str, Any]:
        return {"itemSize": array.shape[1], "type": _TYPES[array.dtype.name], "array": self._array(array)}

    def _array(self, array: NDArray[Any]) -> dict[str, Sequence[object]]:
        self._bytes += b"\0" * (-len(self._bytes) % 8)
        offset = len(self._bytes)
        self._bytes += array.astype(array.dtype.newbyteorder("<")).tobytes()
        return {"$array": [_TYPES[array.dtype.name], offset, array.size]}

    def _uuid(self) -> str:
        self._count += 1
        return f"lgmpc-{self._count}"


_TYPES = {"float32": "Float32Array", "int16": "Int16Array", "uint16": "Uint16Array", "uint32": "Uint32Array"}


def _continuous(q: Array) -> Array:
    """Return the quaternions (n, 4) with signs without jumps.

    q and -q are the same rotation, but the interpolation between them is not constant.
    """
    flips = np.cumsum(np.sum(q[1:] * q[:-1], axis=1) < 0.0)
    return np.concatenate((q[:1], np.where(flips % 2, -1.0, 1.0)[:, None] * q[1:]))


def _changing(rows: Array) -> NDArray[np.intp]:
    """Return the rows that interpolate the others exactly: all but the inner ones of constant intervals."""
    if len(rows) < 2:
        return np.array([], dtype=np.intp)
    moved = np.any(rows[1:] != rows[:-1], axis=1)
    if not moved.any():
        return np.array([], dtype=np.intp)
    needed = np.concatenate(([True], moved)) | np.concatenate((moved, [True]))
    return np.flatnonzero(needed)
