"""Where a run came from that continues another one: its entry ``from`` in ``run.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Origin"]


@dataclass(frozen=True)
class Origin:
    """The run that another one repeats up to some time, and continues from there.

    Attributes:
        run: its folder.
        time_s: the time from which on changed settings act, s.
        verified_ticks: ticks of its log that were repeated bit for bit.
        changes: by key, value before and after; empty where the whole run was repeated.
        begun_anew: what did not take over its state, because the changes gave it another structure.
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
        """Return the origin of plain values.

        Raises:
            KeyError, TypeError, ValueError: they are none.
        """
        changes = {str(key): (before, after) for key, (before, after) in content["changes"].items()}
        anew = tuple(map(str, content["begun_anew"]))
        return cls(str(content["run"]), float(content["time_s"]), int(content["verified_ticks"]), changes, anew)

    def __str__(self) -> str:
        text = f"{self.run}: {self.verified_ticks} logged ticks repeated bit for bit"
        if self.changes:
            text += f"; from {self.time_s:.3f} s on changed: {self.differences}"
        if self.begun_anew:
            text += f"; begun anew: {', '.join(self.begun_anew)}"
        return text
