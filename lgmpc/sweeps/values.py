"""Values of a config by their dotted keys."""

from __future__ import annotations

from typing import Any

from lgmpc.config.schema import Config

__all__ = ["value_at"]


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
