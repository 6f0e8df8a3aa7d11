"""Where the values of a config came from, so that every message can say it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["COMMAND_LINE", "ConfigSource"]

COMMAND_LINE = "--set"
"""Place of a value given on the command line."""


@dataclass(frozen=True)
class ConfigSource:
    """Places of a config's values. Two sources always compare equal, so that configs compare by their values.

    Attributes:
        file: name of the config file.
        places: dotted key to "file:line" or "--set".
    """

    file: str = field(compare=False)
    places: Mapping[str, str] = field(default_factory=dict, compare=False)

    def where(self, key: str) -> str:
        """Return the place of ``key``, or of the nearest part around it that is written somewhere."""
        while key:
            if key in self.places:
                return self.places[key]
            key = key.rpartition(".")[0]
        return self.file
