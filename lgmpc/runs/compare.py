"""Comparison of two runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import get_args, get_type_hints

from lgmpc.runs.metrics import Metrics

__all__ = ["Change", "compare", "flat_metrics", "metric_names"]


@dataclass(frozen=True)
class Change:
    """One metric of two runs.

    Attributes:
        metric: name; percentiles as in ``mpc_ms.p50``.
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
    a, b = flat_metrics(first), flat_metrics(second)
    return tuple(Change(name, a.get(name), b.get(name)) for name in metric_names() if name in a or name in b)


def metric_names() -> tuple[str, ...]:
    """Return the names of all metrics of a run, in order; those of groups as in ``mpc_ms.p50``."""
    names: list[str] = []
    for name, hint in get_type_hints(Metrics).items():
        group = next((each for each in (hint, *get_args(hint)) if is_dataclass(each)), None)
        names += [name] if group is None else [f"{name}.{part.name}" for part in fields(group)]
    return tuple(names)


def flat_metrics(metrics: Metrics) -> dict[str, float | None]:
    """Return the metrics of a run by their names; groups that were not measured, such as ``walking``, are left out."""
    return dict(_flat(metrics))


def _flat(metrics: Metrics) -> Iterator[tuple[str, float | None]]:
    for field in fields(metrics):
        value = getattr(metrics, field.name)
        if is_dataclass(value):
            yield from ((f"{field.name}.{part.name}", _number(getattr(value, part.name))) for part in fields(value))
        elif field.name in metric_names():
            yield field.name, _number(value)


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)
