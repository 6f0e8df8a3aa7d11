"""Properties of a URDF's XML that Pinocchio's parser does not report: mimic tags, mesh paths, entities."""

import posixpath
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from lgmpc.robot.names import some

_SCHEME = "package://"


@dataclass(frozen=True)
class UrdfText:
    """A URDF as XML.

    Attributes:
        problems: text whose interpretation depends on the parser: not well-formed, or with entities.
        mimics: joints with a ``<mimic>``.
        meshes: file names of its meshes, each once.
    """

    problems: tuple[str, ...] = ()
    mimics: tuple[str, ...] = ()
    meshes: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Unusual properties that do not prevent its use."""
        outside = [mesh for mesh in self.meshes if _leaves_package(mesh)]
        return (f"meshes outside the package that their path names: {some(outside)}",) if outside else ()

    @property
    def packages(self) -> tuple[str, ...]:
        """Names of the packages in ``package://`` paths of its meshes, each once."""
        paths = [mesh.removeprefix(_SCHEME) for mesh in self.meshes if mesh.startswith(_SCHEME)]
        return tuple(dict.fromkeys(path.split("/")[0] for path in paths))


def read_urdf_text(urdf: Path) -> UrdfText:
    """Return the contents of a URDF's XML.

    Pinocchio's parser expands no entity, assumes UTF-8 and ignores what follows the robot: a file that depends on any
    of these describes another robot to other parsers, which is a problem.
    """
    parser = expat.ParserCreate()  # without namespaces: undeclared prefixes are common in URDFs
    path: list[str] = []
    joint = ""
    mimics: list[str] = []
    meshes: dict[str, None] = {}

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal joint
        path.append(name)
        if path == ["robot", "joint"]:
            joint = attributes.get("name", "")
        elif path == ["robot", "joint", "mimic"]:
            mimics.append(joint)
        elif name == "mesh" and "filename" in attributes:
            meshes[attributes["filename"]] = None

    def end(name: str) -> None:
        path.pop()

    def refuse_entity(name: str, *rest: object) -> None:
        raise _EntityDeclared(name)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(urdf.read_bytes(), True)
    except _EntityDeclared as entity:
        return UrdfText(
            (f"{urdf}: its DTD declares the entity '{entity}', which no parser of URDFs expands: write its value",)
        )
    except (expat.ExpatError, LookupError, ValueError) as error:
        return UrdfText((f"{urdf}: not well-formed XML ({error})",))
    return UrdfText(mimics=tuple(mimics), meshes=tuple(meshes))


class _EntityDeclared(Exception):
    """The declaration of an entity; its argument is the name."""


def _leaves_package(mesh: str) -> bool:
    """Return whether a ``package://`` path leaves the package that it begins with."""
    if not mesh.startswith(_SCHEME):
        return False
    path = mesh.removeprefix(_SCHEME)
    return posixpath.normpath(path).split("/")[0] != path.split("/")[0]
