"""The origin of a run that continues another one: the entry ``from`` of its ``run.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Origin"]


@dataclass(frozen=True)
class Origin:
    """The run that another one repeats up to some time and continues from there.

    Attributes:
        run: folder of the repeated run.
        time_s: time from which changed settings act, s.
        verified_ticks: ticks of its log that were repeated bit for bit.
        changes: values before and after by key; empty where the whole run was repeated.
        begun_anew: objects that were reset instead of taking over their state, because the changes gave them another
            structure.
    """

    run: str
    time_s: float
    verified_ticks: int
    changes: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    begun_anew: tuple[str, ...] = ()

    @property
    def differences(self) -> str:
        """The changes in words: ``key before -> after``."""
        return ", ".join(f"{key} {before} -> {after}" for key, (before, after) in self.changes.items())

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {
            "run": self.run,
            "time_s": self.time_s,
            "verified_ticks": self.verified_ticks,
            "changes": {key: list(values) for key, values in self.changes.items()},
            "begun_anew": list(self.begun_anew),
        }

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Origin:
        """Return the origin from plain values, as returned by :meth:`content`.

        Raises:
            KeyError, TypeError, ValueError: an entry is missing or has another type.
        """
        changes = {str(key): (before, after) for key, (before, after) in content["changes"].items()}
        anew = tuple(map(str, content["begun_anew"]))
        return cls(str(content["run"]), float(content["time_s"]), int(content["verified_ticks"]), changes, anew)

    def __str__(self) -> str:
        text = f"{self.run}: {self.verified_ticks} logged ticks repeated bit for bit"
        if self.changes:
            text += f"; changed at {self.time_s:.3f} s: {self.differences}"
        if self.begun_anew:
            text += f"; reset: {', '.join(self.begun_anew)}"
        return text
