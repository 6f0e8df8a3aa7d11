"""Reading of configs from YAML files with changes ``a.b.c=value`` of the command line, and writing them."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict, TypeVar

from pydantic import ValidationError

from lgmpc import __version__
from lgmpc.config.schema import COMMAND_LINE, Config, ConfigSource, Document, SolveConfig
from lgmpc.config.yaml_text import parse_scalar, parse_yaml, read_text, write_yaml
from lgmpc.errors import ConfigError, InputError, as_one_error
from lgmpc.settings import Settings
from lgmpc.settings.dotted import write_at
from lgmpc.settings.messages import find_problems, show_value
from lgmpc.shipped import config_file, shipped_configs
from lgmpc.typing import instance

_ASSIGNMENTS = "a list of changes key=value, such as ['mpc.enabled=false']"


def apply_overrides(data: dict[str, Any], overrides: Sequence[str]) -> dict[str, str]:
    """Write ``overrides`` into ``data``.

    Args:
        data: the parsed config; changed in place.
        overrides: strings ``key=value``, such as ``mpc.enabled=false`` or ``pushes.0.impulse_ns=[0, 3, 0]``. Keys are
            dotted; in lists they are positions from 0, and the position after the last one appends. Values are YAML.

    Returns:
        The source of every changed key, for messages.

    Raises:
        InputError: if they are no list of texts.
        ConfigError: if one is not ``key=value``, its value is not YAML, or its key passes through a plain value or a
            position that does not exist.
    """
    instance("overrides", overrides, (list, tuple), _ASSIGNMENTS)
    places: dict[str, str] = {}
    for text in overrides:
        instance("overrides", text, str, _ASSIGNMENTS)
        key, value = parse_assignment(text)
        try:
            made = write_at(data, key, value)
        except InputError as error:
            raise ConfigError(COMMAND_LINE, error.argument, error.got, error.expected) from error
        for stale in [place for place in places if place.startswith(f"{key}.")]:
            del places[stale]
        places.update(dict.fromkeys([*made, key], COMMAND_LINE))
    return places


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return dotted key and value of an assignment ``key=value``, whose value is YAML.

    Raises:
        ConfigError: if the text is not an assignment, or its value is not YAML.
    """
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        raise ConfigError(COMMAND_LINE, "", text or "nothing", "key=value, such as mpc.enabled=false")
    return key, parse_scalar(value, key, COMMAND_LINE)


D = TypeVar("D", bound=Document)
S = TypeVar("S", bound=Settings)

_MARK = "problem"
"""The key that distinguishes the config of a problem to solve from that of a closed loop."""


class _Text(TypedDict):
    text: str
    name: str
    folder: Path


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """Read, change and check the config file of a closed loop.

    Args:
        path: the YAML file, or the name of a shipped config such as ``solo12_balance``.
        overrides: changes ``key=value``; see :func:`apply_overrides`.

    Raises:
        ConfigError: if the file cannot be read, is not YAML, describes a problem to solve, or has keys or values that
            cannot be used; a :class:`lgmpc.errors.ConfigErrors` with all of them if there are several.
    """
    return parse_config(**_file(path), overrides=overrides)


def load_solve_config(path: str | Path, overrides: Sequence[str] = ()) -> SolveConfig:
    """Read, change and check the config file of a problem to solve; arguments and errors as :func:`load_config`."""
    return parse_solve_config(**_file(path), overrides=overrides)


def load_any_config(path: str | Path, overrides: Sequence[str] = ()) -> Config | SolveConfig:
    """Read, change and check a config file of either kind; arguments and errors as :func:`load_config`."""
    return parse_any_config(**_file(path), overrides=overrides)


def parse_config(
    text: str, *, name: str = "config", folder: Path | None = None, overrides: Sequence[str] = ()
) -> Config:
    """Check the config of a closed loop, given as text.

    Args:
        text: the YAML document.
        name: the document's name in messages.
        folder: base of its relative paths; the working directory unless given. Relative paths in ``overrides`` always
            start from the working directory.
        overrides: changes ``key=value``.

    Raises:
        ConfigError: as :func:`load_config`.
    """
    data, source = _parse(text, name, folder, overrides)
    if _MARK in data:
        expected = f"a closed loop to simulate, which has no such key. To solve this: lgmpc solve {name}"
        raise ConfigError(source.where(_MARK), _MARK, "a problem to solve", expected)
    return _check(Config, data, source)


def parse_solve_config(
    text: str, *, name: str = "config", folder: Path | None = None, overrides: Sequence[str] = ()
) -> SolveConfig:
    """Check the config of a problem to solve, given as text; arguments and errors as :func:`parse_config`."""
    data, source = _parse(text, name, folder, overrides)
    if _MARK not in data:
        expected = f"a problem to solve, which has the key {_MARK}. To simulate this: lgmpc run {name}"
        raise ConfigError(name, "", "the config of a closed loop", expected)
    return _check(SolveConfig, data, source)


def parse_any_config(
    text: str, *, name: str = "config", folder: Path | None = None, overrides: Sequence[str] = ()
) -> Config | SolveConfig:
    """Check a config of either kind, given as text; arguments and errors as :func:`parse_config`."""
    data, source = _parse(text, name, folder, overrides)
    return _check(SolveConfig, data, source) if _MARK in data else _check(Config, data, source)


def dump_config(config: Config | SolveConfig) -> str:
    """Return the whole config, defaults included, as YAML from which an equal config is read."""
    command = "solve" if isinstance(config, SolveConfig) else "run"
    file = os.fsencode(config.source.file).decode("utf-8", "replace")  # a path may contain bytes that are not text
    head = f"# Every value of this run, written by lgmpc {__version__} from {file}.\n"
    return f"{head}# `lgmpc {command}` on this file repeats it.\n{write_yaml(config.model_dump(mode='json'))}"


def _file(path: str | Path) -> _Text:
    path = config_file(path)
    expected = "a YAML file, or the name of a shipped config (`lgmpc configs` lists them)"
    return {"text": read_text(path, expected, [*shipped_configs()]), "name": str(path), "folder": path.parent}


def _parse(text: str, name: str, folder: Path | None, overrides: Sequence[str]) -> tuple[dict[str, Any], ConfigSource]:
    """Return the changed content, with absolute paths, and the sources of its values."""
    data, places = parse_yaml(text, name)
    if data is None:
        raise ConfigError(name, "", "an empty file", "a config with at least the keys name and robot")
    if not isinstance(data, dict):
        raise ConfigError(name, "", show_value(data), "a table of keys (name: ..., robot: ...)")
    changed = apply_overrides(data, overrides)
    for key in changed:
        for stale in [place for place in places if place.startswith(f"{key}.")]:
            del places[stale]
    source = ConfigSource(name, places | changed)
    _make_paths_absolute(data, folder or Path(), source)
    return data, source


def _check(root: type[D], data: dict[str, Any], source: ConfigSource) -> D:
    return validated(root, data, source).with_source(source)


def validated(root: type[S], data: dict[str, Any], source: ConfigSource) -> S:
    """Return the settings of a parsed document.

    Args:
        root: class of the settings.
        data: the parsed document.
        source: sources of its values.

    Raises:
        ConfigError: keys or values that cannot be used; a :class:`lgmpc.errors.ConfigErrors` of several.
    """
    try:
        return root.model_validate(data)
    except ValidationError as error:
        found = [
            ConfigError(source.where(each.key), each.key, each.got, each.expected, each.choices, word=each.word)
            for each in find_problems(error, root, data)
        ]
        raise as_one_error(found) from error


def _make_paths_absolute(data: dict[str, Any], folder: Path, source: ConfigSource) -> None:
    """Resolve the paths of robot and world from the folder of the config file or, for ``--set``, the shell's."""

    def absolute(key: str, value: Any) -> Any:
        if not isinstance(value, str) or not value:
            return value
        start = Path() if source.where(key) == COMMAND_LINE else folder
        try:
            return str((start / Path(value).expanduser()).resolve())
        except (RuntimeError, ValueError) as error:  # the home folder of an unknown user, a null character
            raise ConfigError(source.where(key), key, show_value(value), f"a path ({error})") from error

    world = data.get("world")
    parts = world.get("parts", ()) if isinstance(world, dict) else world
    for key, part in (("world", world), *((f"world.parts.{i}", each) for i, each in enumerate(_listed(parts)))):
        if isinstance(part, dict) and "file" in part:
            part["file"] = absolute(f"{key}.file", part["file"])
    robot = data.get("robot")
    if not isinstance(robot, dict):
        return
    for name in ("urdf", "srdf"):
        if name in robot:
            robot[name] = absolute(f"robot.{name}", robot[name])
    folders = robot.get("package_dirs")
    if isinstance(folders, list):
        robot["package_dirs"] = [absolute(f"robot.package_dirs.{i}", each) for i, each in enumerate(folders)]


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
