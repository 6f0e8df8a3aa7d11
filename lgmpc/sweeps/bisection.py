"""Search of the largest value of one key at which a verdict holds; values of a config by their dotted keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lgmpc.config.schema import Config
from lgmpc.sweeps.settings import BisectionSettings

__all__ = ["Boundary", "bisect", "scaled", "value_at"]


@dataclass(frozen=True)
class Boundary:
    """The result of a bisection.

    Attributes:
        value: the largest value that passed; ``None`` if both ends of the range have the same verdict.
        trials: each value that was tried, in order, and whether it passed.
        violations: values below ``value`` that failed: there the verdict is not monotonic.
        reason: why there is no value; empty if there is one.
    """

    value: float | None
    trials: tuple[tuple[float, bool], ...]
    violations: tuple[float, ...] = ()
    reason: str = ""


def bisect(passes: Callable[[float], bool], settings: BisectionSettings) -> Boundary:
    """Find the value at which ``passes`` changes from true to false, to within ``settings.tolerance``.

    The verdict is assumed monotonic; otherwise the value found is one of several changes, which ``settings.probes``
    runs below it can detect.

    Args:
        passes: the verdict at a value.
        settings: range, tolerance, probes.
    """
    trials: list[tuple[float, bool]] = []

    def holds(value: float) -> bool:
        verdict = passes(value)
        trials.append((value, verdict))
        return verdict

    low, high = settings.range
    if not holds(low):
        reason = f"bisect.range: got {low:g}, where the run fails already; expected a value where it passes: lower it"
        return Boundary(None, tuple(trials), reason=reason)
    if holds(high):
        reason = f"bisect.range: got {high:g}, where the run still passes; expected one where it fails: raise it"
        return Boundary(None, tuple(trials), reason=reason)
    first = low
    while high - low > settings.tolerance:
        middle = 0.5 * (low + high)
        if middle in (low, high):  # adjacent floating-point numbers, further apart than the tolerance
            break
        low, high = (middle, high) if holds(middle) else (low, middle)
    probes = (first + (low - first) * (i + 1) / (settings.probes + 1) for i in range(settings.probes))
    violations = tuple(value for value in probes if value not in dict(trials) and not holds(value))
    return Boundary(low, tuple(trials), violations)


def scaled(config: Config, key: str, value: float) -> Config:
    """Return the config with ``value`` at ``key``; if the key is a vector, with the vector times ``value``.

    Raises:
        InputError: no such key, it is neither a number nor a vector, or the value is invalid.
    """
    present = value_at(config, key)
    if isinstance(present, (list, tuple)) and present and all(isinstance(each, (int, float)) for each in present):
        return config.replace({key: tuple(value * each for each in present)})
    return config.replace({key: value})


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
