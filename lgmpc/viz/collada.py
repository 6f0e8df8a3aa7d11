"""COLLADA files with several materials, of which coal reads every part on the vertices of the first one.

coal 3.0 appends the parts of a node without shifting their vertex indices: all but the first have wrong vertices.
Here each part is read from a file of its own.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import coal
import numpy as np

from lgmpc.typing import Array
from lgmpc.viz.mesh import Mesh, shade, triangles_of

__all__ = ["is_misread", "read_parts"]

_SCHEMA = "http://www.collada.org/2005/11/COLLADASchema"
_SPACE = f"{{{_SCHEMA}}}"
_PRIMITIVES = tuple(_SPACE + kind for kind in ("triangles", "polylist", "polygons", "tristrips", "trifans"))


def is_misread(geometry: Any, path: str) -> bool:
    """Return whether a coal mesh was read from a COLLADA file of several parts: its last vertices have no triangle."""
    if not isinstance(geometry, coal.BVHModelBase) or Path(path).suffix.lower() != ".dae":
        return False
    return bool(triangles_of(geometry).max(initial=-1) + 1 < geometry.num_vertices)


def read_parts(path: str, scale: Array) -> list[Mesh]:
    """Return a mesh for each primitive of a COLLADA file, scaled by (3,) factors.

    Raises:
        ValueError: the file is no COLLADA.
        RuntimeError: coal cannot read a part.
    """
    try:
        document = ElementTree.parse(path)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is no COLLADA file: {error}") from error
    meshes = list(document.iter(f"{_SPACE}mesh"))
    parts = [(mesh, part) for mesh in meshes for part in mesh if part.tag in _PRIMITIVES]
    for mesh, part in parts:
        mesh.remove(part)
    ElementTree.register_namespace("", _SCHEMA)  # coal's reader does not support prefixes
    read = []
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder, "part.dae")
        for mesh, part in parts:
            mesh.append(part)
            document.write(alone, encoding="utf-8", xml_declaration=True)
            loaded = coal.MeshLoader().load(str(alone), np.asarray(scale, dtype=np.float64))
            read.append(shade(np.array(loaded.vertices(), dtype=np.float64).reshape(-1, 3), triangles_of(loaded)))
            mesh.remove(part)
    return read
