"""What the two kinds of configs share: a name, a robot, and knowledge of where their values came from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from pydantic import Field, PrivateAttr

from lgmpc.config.schema.robot import RobotSection
from lgmpc.config.source import ConfigSource
from lgmpc.errors import ConfigError
from lgmpc.settings import Settings

__all__ = ["Document"]

D = TypeVar("D", bound="Document")


class Document(Settings):
    """A whole config file."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=80,
        description="Name of the run; part of its folder's name, so letters, digits, '.', '_' and '-' only.",
    )
    robot: RobotSection = Field(description="The robot.")

    _source: ConfigSource = PrivateAttr(default_factory=lambda: ConfigSource("config"))

    @property
    def source(self) -> ConfigSource:
        """Where each key's value came from."""
        return self._source

    def with_source(self: D, source: ConfigSource) -> D:
        """Return a copy that knows where its values came from; equal to this one."""
        copy = self.model_copy()
        copy._source = source
        return copy

    def error(
        self, key: str, got: object, expected: str, choices: Sequence[str] = (), *, word: str | None = None
    ) -> ConfigError:
        """Make the error for a key whose value turned out unusable later, naming the file and line it came from.

        Arguments as in :class:`lgmpc.errors.ConfigError`.
        """
        return ConfigError(self.source.where(key), key, got, expected, choices, word=word)
