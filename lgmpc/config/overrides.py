"""Changes to a config from the command line: ``a.b.c=value``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from lgmpc.config.source import COMMAND_LINE
from lgmpc.config.yaml_text import parse_scalar
from lgmpc.errors import ConfigError

__all__ = ["apply_overrides"]


def apply_overrides(data: dict[str, Any], overrides: Iterable[str]) -> dict[str, str]:
    """Write ``overrides`` into ``data``.

    Args:
        data: the parsed config; changed in place.
        overrides: texts ``key=value``, such as ``mpc.enabled=false`` or ``pushes.0.impulse_ns=[0, 3, 0]``. Keys are
            dotted; in lists they are positions from 0, and the position after the last one appends. Values are YAML.

    Returns:
        The place of every changed key, for messages.

    Raises:
        ConfigError: if one is not ``key=value``, its value is not YAML, or its key passes through a plain value or a
            position that does not exist.
    """
    places: dict[str, str] = {}
    for text in overrides:
        key, equals, value_text = text.partition("=")
        key = key.strip()
        parts = key.split(".")
        if not equals or not all(parts):
            raise ConfigError(COMMAND_LINE, "", text or "nothing", "key=value, such as mpc.enabled=false")
        made = _write(data, parts, parse_scalar(value_text, key, COMMAND_LINE))
        for stale in [place for place in places if place.startswith(f"{key}.")]:
            del places[stale]
        places.update(dict.fromkeys([*made, key], COMMAND_LINE))
    return places


def _write(data: dict[str, Any], parts: list[str], value: Any) -> list[str]:
    """Put ``value`` at the end of the path ``parts``; return the dotted keys of the tables made on the way."""
    made = []
    here: Any = data
    for depth, part in enumerate(parts):
        path = ".".join(parts[: depth + 1])
        key: Any = part
        if isinstance(here, list):
            key = int(part) if part.isdecimal() else -1
            if not 0 <= key <= len(here):
                raise ConfigError(
                    COMMAND_LINE,
                    path,
                    f"position {part}",
                    f"a position from 0 to {len(here)} (the list has {len(here)})",
                )
            if key == len(here):
                here.append(None)
        elif not isinstance(here, dict):
            outer = ".".join(parts[:depth])
            raise ConfigError(COMMAND_LINE, path, f"a key below {outer} = {here}", f"none: {outer} is a plain value")
        if depth == len(parts) - 1:
            here[key] = value
        else:
            if (here.get(key) if isinstance(here, dict) else here[key]) is None:
                here[key] = {}
                made.append(path)
            here = here[key]
    return made
