"""A robot's files, and its ``pin.Model`` without meshes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pinocchio as pin

from lgmpc.errors import InputError, ModelError
from lgmpc.robot.model import ModelSource
from lgmpc.robot.native_stderr import native_stderr
from lgmpc.robot.spec import RobotSpec

__all__ = ["ResolvedSource", "available_models", "build_model", "resolve"]


@dataclass(frozen=True)
class ResolvedSource:
    """A robot's files, and their entries in example-robot-data.

    Attributes:
        name: name in example-robot-data, or the URDF file's stem until the model is read.
        files: the files.
        floating_base: whether the base moves freely.
        posture: name of the usual reference configuration, if there is one.
    """

    name: str
    files: ModelSource
    floating_base: bool
    posture: str | None


def _loaders() -> dict[str, Any]:
    """Return the loader classes whose model is that of their URDF (others read an SDF, or change it in Python)."""
    import example_robot_data as erd

    return {
        name: loader for name, loader in erd.ROBOTS.items() if loader.urdf_filename and "__init__" not in vars(loader)
    }


def available_models() -> tuple[str, ...]:
    """Return the names that ``RobotSpec.model`` may have."""
    return tuple(sorted(_loaders()))


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
    loaders = _loaders()
    if spec.model not in loaders:
        raise InputError("model", spec.model, "a robot of example-robot-data", tuple(sorted(loaders)))
    loader = loaders[spec.model]
    import example_robot_data as erd

    urdf = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    root = Path(os.path.normpath(erd.getModelPath(str(urdf))))
    srdf = root / loader.path / loader.srdf_subpath / loader.srdf_filename if loader.srdf_filename else None
    if spec.srdf is not None:
        srdf = spec.srdf.absolute()
    if srdf is not None and not srdf.is_file():
        raise InputError("srdf", srdf, "a file that exists", _siblings(srdf), word=srdf.name)
    files = ModelSource(root / urdf, srdf, (*spec.package_dirs, root.parent.parent))
    floating = loader.free_flyer if spec.floating_base is None else spec.floating_base
    return ResolvedSource(spec.model, files, bool(floating), loader.ref_posture if srdf else None)


def _siblings(path: Path) -> tuple[str, ...]:
    folder = path.parent
    return tuple(sorted(p.name for p in folder.glob(f"*{path.suffix}"))) if folder.is_dir() else ()


def build_model(source: ResolvedSource) -> tuple[pin.Model, tuple[str, ...]]:
    """Build the model from its URDF, and return it with the parser's warnings.

    Raises:
        ModelError: the parser rejects the file; the problems are its messages.
    """
    path = str(source.files.urdf)
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
