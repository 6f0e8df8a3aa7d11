"""A robot's files, and its ``pin.Model`` without meshes."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pinocchio as pin

from lgmpc.errors import InputError, ModelError
from lgmpc.robot.collision import ModelSource
from lgmpc.robot.names import some
from lgmpc.robot.native_stderr import native_stderr
from lgmpc.robot.spec import RobotSpec


@dataclass(frozen=True)
class ResolvedSource:
    """A robot's files, and their entries in example-robot-data.

    Attributes:
        name: name in example-robot-data, or the URDF file's stem until the model is read.
        files: the files.
        floating_base: whether the base moves freely.
        posture: name of the usual reference configuration, if there is one.
        loader: loader class of a model that differs from that of the URDF; None if the URDF is all.
    """

    name: str
    files: ModelSource
    floating_base: bool
    posture: str | None
    loader: Callable[[], Any] | None = None


def available_models() -> tuple[str, ...]:
    """Return the names that ``RobotSpec.model`` may have: those of ``example_robot_data.load``."""
    import example_robot_data as erd

    return tuple(sorted(erd.ROBOTS))


def resolve(spec: RobotSpec) -> ResolvedSource:
    """Return the files of ``spec``.

    Raises:
        InputError: unknown robot name (the nearest are named), or a file that does not exist.
    """
    if spec.urdf is not None:
        for argument, path in (("urdf", spec.urdf), ("srdf", spec.srdf)):
            if path is not None and not path.is_file():
                raise InputError(argument, path, "a file that exists", _siblings(path), word=path.name)
        files = ModelSource(spec.urdf.absolute(), spec.srdf and spec.srdf.absolute(), spec.package_dirs)
        return ResolvedSource(spec.urdf.stem, files, spec.floating_base is not False, None)
    import example_robot_data as erd

    loader = erd.ROBOTS.get(spec.model)
    if loader is None:
        raise InputError("model", spec.model, "a robot of example-robot-data", available_models())
    if loader.urdf_filename:
        urdf = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    else:
        urdf = Path(loader.path, loader.sdf_subpath, loader.sdf_filename)
    root = Path(os.path.normpath(erd.getModelPath(str(urdf))))
    srdf = root / loader.path / loader.srdf_subpath / loader.srdf_filename if loader.srdf_filename else None
    if spec.srdf is not None:
        srdf = spec.srdf.absolute()
    if srdf is not None and not srdf.is_file():
        raise InputError("srdf", srdf, "a file that exists", _siblings(srdf), word=srdf.name)
    files = ModelSource(root / urdf, srdf, (*spec.package_dirs, root.parent.parent))
    floating = bool(loader.free_flyer if spec.floating_base is None else spec.floating_base)
    own = loader if "__init__" in vars(loader) or not loader.urdf_filename else None
    if own is not None and floating != loader.free_flyer:
        raise InputError("floating_base", floating, f"{loader.free_flyer}, as example-robot-data builds {spec.model}")
    return ResolvedSource(str(spec.model), files, floating, loader.ref_posture if srdf else None, own)


def find_packages(files: ModelSource, packages: Sequence[str]) -> tuple[ModelSource, tuple[str, ...]]:
    """Return the files with the folders that contain packages of ROS, and a note on packages that are not found.

    Searched are, besides the given folders, those around the URDF and those in ``ROS_PACKAGE_PATH``.
    """
    listed = [Path(each) for each in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if each]
    around = [*files.urdf.parents, *listed, *(each.parent for each in listed)]
    folders, missing = list(files.package_dirs), []
    for name in packages:
        if not any((folder / name).is_dir() for folder in folders):
            found = next((folder for folder in around if (folder / name).is_dir()), None)
            if found is None:
                missing.append(name)
            else:
                folders.append(found)
    words = f"no meshes, a stick figure: package {some(missing)} was not found: give the folder that contains it as"
    notes = (f"{words} robot.package_dirs",) if missing else ()
    return ModelSource(files.urdf, files.srdf, tuple(folders)), notes


def _siblings(path: Path) -> tuple[str, ...]:
    folder = path.parent
    return tuple(sorted(p.name for p in folder.glob(f"*{path.suffix}"))) if folder.is_dir() else ()


def build_model(source: ResolvedSource) -> tuple[pin.Model, tuple[str, ...]]:
    """Build the model from its URDF, and return it with the parser's warnings.

    Raises:
        ModelError: the file is no UTF-8 text, or its parser rejects it; the problems are its messages.
    """
    if source.loader is not None:
        try:
            return source.loader().robot.model, ()
        except (ImportError, OSError, ValueError, RuntimeError) as error:
            raise ModelError(source.name, [f"example-robot-data cannot load it: {error}"]) from error
    path = str(source.files.urdf)
    try:
        source.files.urdf.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise ModelError(
            source.name, [f"{path}: byte {error.object[error.start]:#x} at {error.start} is no UTF-8"]
        ) from error
    with native_stderr() as printed:
        try:
            root = (pin.JointModelFreeFlyer(),) if source.floating_base else ()
            model = pin.buildModelFromUrdf(path, *root)
        except (ValueError, RuntimeError) as error:
            failure: Exception | None = error
        else:
            failure = None
    words = _parser_words(printed[0])
    if failure is not None:
        raise ModelError(source.name, [f"{path}: {word}" for word in words] or [str(failure)]) from failure
    return model, words


def _parser_words(text: str) -> tuple[str, ...]:
    """Return the parser's messages without the lines that name its own source files."""
    lines = (line.strip() for line in text.splitlines())
    return tuple(
        line.removeprefix("Error:").removeprefix("Warning:").strip()
        for line in lines
        if line and not line.startswith("at line ")
    )
