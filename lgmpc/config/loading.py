"""From a YAML file and changes on the command line to a checked config, and back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from lgmpc import __version__
from lgmpc.config.overrides import apply_overrides
from lgmpc.config.problems import as_config_error, show_value
from lgmpc.config.schema import Config
from lgmpc.config.source import COMMAND_LINE, ConfigSource
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import ConfigError

__all__ = ["dump_config", "load_config", "parse_config"]


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """Read, change and check a config file.

    Args:
        path: the YAML file.
        overrides: changes ``key=value``; see :func:`lgmpc.config.overrides.apply_overrides`.

    Raises:
        ConfigError: if the file cannot be read, is not YAML, or has keys or values that cannot be used; a
            :class:`lgmpc.errors.ConfigErrors` with all of them if there are several.
    """
    path = Path(path)
    return parse_config(_read(path), name=str(path), folder=path.parent, overrides=overrides)


def parse_config(
    text: str, *, name: str = "config", folder: Path | None = None, overrides: Sequence[str] = ()
) -> Config:
    """Check a config given as text.

    Args:
        text: the YAML document.
        name: what to call it in messages.
        folder: what its relative paths start from; the working directory unless given. Relative paths in
            ``overrides`` always start from the working directory.
        overrides: changes ``key=value``.

    Raises:
        ConfigError: as :func:`load_config`.
    """
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
    try:
        return Config.model_validate(data).with_source(source)
    except ValidationError as error:
        raise as_config_error(error, Config, data, source) from error


def dump_config(config: Config) -> str:
    """Return the whole config as YAML, defaults included, from which :func:`parse_config` makes an equal one."""
    head = (
        f"# Every value of this run, written by lgmpc {__version__} from {config.source.file}.\n"
        "# `lgmpc run` on this file repeats it.\n"
    )
    return head + write_yaml(config.model_dump(mode="json"))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        siblings = sorted(str(each) for each in path.parent.glob("*.y*ml")) or sorted(
            map(str, Path("configs").glob("*.yaml"))
        )
        raise ConfigError(str(path), "", "no such file", "a YAML file", siblings, word=str(path)) from error
    except IsADirectoryError as error:
        inside = sorted(str(each) for each in path.glob("*.yaml"))
        raise ConfigError(str(path), "", "a folder", "a YAML file", inside) from error
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), "", f"a byte that is not UTF-8 text (at {error.start})", "a YAML file") from error
    except OSError as error:
        raise ConfigError(str(path), "", f"a file that cannot be read ({error.strerror})", "a YAML file") from error


def _make_paths_absolute(data: dict[str, Any], folder: Path, source: ConfigSource) -> None:
    """Let the paths of section ``robot`` start from the folder of the file, or of the shell, that they came from."""

    def absolute(key: str, value: Any) -> Any:
        if not isinstance(value, str) or not value:
            return value
        start = Path() if source.where(key) == COMMAND_LINE else folder
        return str((start / Path(value).expanduser()).resolve())

    robot = data.get("robot")
    if not isinstance(robot, dict):
        return
    for name in ("urdf", "srdf"):
        if name in robot:
            robot[name] = absolute(f"robot.{name}", robot[name])
    folders = robot.get("package_dirs")
    if isinstance(folders, list):
        robot["package_dirs"] = [absolute(f"robot.package_dirs.{i}", each) for i, each in enumerate(folders)]
