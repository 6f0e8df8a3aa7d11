"""Two runs side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass

from lgmpc.runs.metrics import Metrics

__all__ = ["Change", "compare"]


@dataclass(frozen=True)
class Change:
    """One metric of two runs.

    Attributes:
        metric: its name; percentiles as in ``mpc_ms.p50``.
        first: value in the first run, ``None`` if it was not measured.
        second: value in the second run.
    """

    metric: str
    first: float | None
    second: float | None

    @property
    def difference(self) -> float | None:
        """Second minus first; ``None`` if either was not measured."""
        return None if self.first is None or self.second is None else self.second - self.first


def compare(first: Metrics, second: Metrics) -> tuple[Change, ...]:
    """Return every metric of two runs, in the order of :class:`~lgmpc.runs.metrics.Metrics`."""
    a, b = dict(_flat(first)), dict(_flat(second))
    # A computation that ran in one run only has percentiles there and a plain None in the other.
    names = [name for name in dict.fromkeys([*a, *b]) if not any(other.startswith(f"{name}.") for other in (a | b))]
    return tuple(Change(name, a.get(name), b.get(name)) for name in names)


def _flat(metrics: Metrics) -> Iterator[tuple[str, float | None]]:
    for field in fields(metrics):
        value = getattr(metrics, field.name)
        if is_dataclass(value):
            yield from ((f"{field.name}.{part.name}", getattr(value, part.name)) for part in fields(value))
        else:
            yield field.name, None if value is None else float(value)
