"""Changes to a config from the command line: ``a.b.c=value``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from lgmpc.config.source import COMMAND_LINE
from lgmpc.config.yaml_text import parse_scalar
from lgmpc.errors import ConfigError, InputError
from lgmpc.settings.dotted import write_at

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
        if not equals or not all(key.split(".")):
            raise ConfigError(COMMAND_LINE, "", text or "nothing", "key=value, such as mpc.enabled=false")
        value = parse_scalar(value_text, key, COMMAND_LINE)
        try:
            made = write_at(data, key, value)
        except InputError as error:
            raise ConfigError(COMMAND_LINE, error.argument, error.got, error.expected) from error
        for stale in [place for place in places if place.startswith(f"{key}.")]:
            del places[stale]
        places.update(dict.fromkeys([*made, key], COMMAND_LINE))
    return places
