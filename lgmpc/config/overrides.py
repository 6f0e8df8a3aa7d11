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
        _write(data, parts, parse_scalar(value_text, key, COMMAND_LINE))
        for stale in [place for place in places if place.startswith(f"{key}.")]:
            del places[stale]
        places[key] = COMMAND_LINE
    return places


def _write(data: dict[str, Any], parts: list[str], value: Any) -> None:
    """Put ``value`` at the end of the path ``parts``, making tables that are not there yet."""
    here: Any = data
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        path = ".".join(parts[: depth + 1])
        if isinstance(here, dict):
            if last:
                here[part] = value
            else:
                if here.get(part) is None:
                    here[part] = {}
                here = here[part]
        elif isinstance(here, list):
            position = int(part) if part.isdecimal() else -1
            if not 0 <= position <= len(here):
                raise ConfigError(
                    COMMAND_LINE,
                    path,
                    f"position {part}",
                    f"a position from 0 to {len(here)} (the list has {len(here)})",
                )
            if position == len(here):
                here.append(None)
            if last:
                here[position] = value
            else:
                if here[position] is None:
                    here[position] = {}
                here = here[position]
        else:
            outer = ".".join(parts[:depth])
            raise ConfigError(
                COMMAND_LINE, path, f"a key below {outer} = {here}", f"no key below it: {outer} is a plain value"
            )
