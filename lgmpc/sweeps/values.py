"""Values of a config by their dotted keys."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lgmpc.config.schema import COMMAND_LINE, Config
from lgmpc.config.yaml_text import parse_scalar
from lgmpc.errors import ConfigError

__all__ = ["parse_assignments", "value_at"]


def value_at(config: Config, key: str) -> Any:
    """Return the value at a dotted key, as plain tables, lists and values.

    Raises:
        InputError: no such key; names the nearest.
    """
    present: Any = config.model_dump()
    for part in key.split("."):
        if isinstance(present, dict) and part in present:
            present = present[part]
        elif isinstance(present, (list, tuple)) and part.isdecimal() and int(part) < len(present):
            present = present[int(part)]
        else:
            config.replace({key: None})  # raises, and names the nearest key
            return None  # a table of any keys, which lacks this one
    return present


def parse_assignments(texts: Sequence[str]) -> dict[str, Any]:
    """Return keys and values of assignments ``key=value``, whose values are YAML.

    Raises:
        ConfigError: if a text is not an assignment.
    """
    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not all(key.strip().split(".")):
            raise ConfigError(COMMAND_LINE, "", text or "nothing", "key=value, such as mpc.enabled=false")
        found[key.strip()] = parse_scalar(value, key.strip(), COMMAND_LINE)
    return found
