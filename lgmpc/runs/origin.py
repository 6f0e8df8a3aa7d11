"""Settings that changed during a run, and the run that another one repeats: entries ``changes`` and ``from``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Origin", "SettingsChange"]

Values = Mapping[str, tuple[Any, Any]]
"""Values before and after by dotted key."""


@dataclass(frozen=True)
class SettingsChange:
    """A change of settings during a run.

    Attributes:
        time_s: time from which they act, s.
        values: values before and after by key.
    """

    time_s: float
    values: Values

    @property
    def differences(self) -> str:
        """The changes in words: ``key before -> after``."""
        return _words(self.values)

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {"time_s": self.time_s, "values": _lists(self.values)}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> SettingsChange:
        """Return the change from plain values; errors as of :meth:`Origin.of`."""
        return cls(float(content["time_s"]), _pairs(content["values"]))


@dataclass(frozen=True)
class Origin:
    """The run that another one repeats up to some time and continues from there.

    Attributes:
        run: folder of the repeated run.
        time_s: time from which changed settings act, s.
        verified_ticks: ticks of its log that were repeated bit for bit.
        changes: values before and after by key; empty where the whole run was repeated.
    """

    run: str
    time_s: float
    verified_ticks: int
    changes: Values = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        ticks = {"verified_ticks": self.verified_ticks}
        return {"run": self.run, "time_s": self.time_s, **ticks, "changes": _lists(self.changes)}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Origin:
        """Return the origin from plain values, as returned by :meth:`content`.

        Raises:
            KeyError, TypeError, ValueError: an entry is missing or has another type.
        """
        ticks, changes = int(content["verified_ticks"]), _pairs(content["changes"])
        return cls(str(content["run"]), float(content["time_s"]), ticks, changes)

    def __str__(self) -> str:
        text = f"{self.run}: {self.verified_ticks} logged ticks repeated bit for bit"
        return f"{text}; changed at {self.time_s:.3f} s: {_words(self.changes)}" if self.changes else text


def _words(values: Values) -> str:
    return ", ".join(f"{key} {before} -> {after}" for key, (before, after) in values.items())


def _lists(values: Values) -> dict[str, list[Any]]:
    return {key: list(pair) for key, pair in values.items()}


def _pairs(values: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    return {str(key): (before, after) for key, (before, after) in values.items()}
