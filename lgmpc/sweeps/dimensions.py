"""A tuned key, with the range or the choices that are tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import parse_scalar
from lgmpc.errors import InputError
from lgmpc.sweeps.bisection import scaled, value_at

__all__ = ["Dimension", "parse_dimension", "parse_dimensions"]

_SPREAD = 3.0
"""Factor of the default range of a key, from a third of the present value to three times it."""


@dataclass(frozen=True)
class Dimension:
    """A tuned key. If it is a vector, numbers multiply that vector.

    Attributes:
        key: dotted key.
        present: the present value.
        low: lower end of the range; unused with choices.
        high: upper end of the range.
        logarithmic: whether the range is sampled logarithmically.
        choices: values instead of a range; empty for a range.
    """

    key: str
    present: Any
    low: float = math.nan
    high: float = math.nan
    logarithmic: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def initial(self) -> Any:
        """The number or choice that leaves the key as it is: the present value, or 1 if a vector is scaled."""
        return 1.0 if isinstance(self.present, (list, tuple)) else self.present

    @property
    def whole(self) -> bool:
        """Whether only whole numbers are tried."""
        return isinstance(self.initial, int)

    def value(self, number: Any) -> Any:
        """Return the value that the key gets from a number of the range, or from a choice."""
        return [number * each for each in self.present] if isinstance(self.present, (list, tuple)) else number

    def apply(self, config: Config, value: Any) -> Config:
        """Return a config with a number of the range, or a choice, at the key.

        Raises:
            InputError: the config refuses it.
        """
        return config.replace({self.key: value}) if self.choices else scaled(config, self.key, value)


def parse_dimensions(configs: Sequence[Config], texts: Sequence[str]) -> tuple[Dimension, ...]:
    """Parse keys to tune, each with one present value in all configs.

    Args:
        configs: the configs to tune.
        texts: see :func:`parse_dimension`.

    Raises:
        InputError: as :func:`parse_dimension`; a key is named twice, or its values differ between the configs.
    """
    found: dict[str, Dimension] = {}
    for text in texts:
        dimension = parse_dimension(configs[0], text)
        key = dimension.key
        if key in found:
            raise InputError(key, "the key twice", "each key to tune once")
        there = {repr(value): value for value in (value_at(each, key) for each in configs)}
        if len(there) > 1:
            values = ", ".join(map(str, list(there.values())[:3]))
            raise InputError(key, f"{values} at different points", "a key with one present value at all points")
        found[key] = dimension
    return tuple(found.values())


def parse_dimension(config: Config, text: str) -> Dimension:
    """Parse a key to tune, with its range or choices.

    Args:
        config: config with the present values.
        text: ``KEY``, ``KEY=LOW:HIGH``, ``KEY=LOW:HIGH:log`` or ``KEY=[A, B, C]``.

    Raises:
        InputError: no such key, it is neither a number nor a vector, or the range is invalid.
    """
    key, given, value = (part.strip() for part in text.partition("="))
    present = value_at(config, key)
    if isinstance(present, Mapping):
        raise InputError(key, "a table", "one value of it", [f"{key}.{each}" for each in present])
    if value.startswith("["):
        choices = parse_scalar(value, key, "--keys")
        if not all(isinstance(each, (str, int, float)) for each in [*choices, present]):
            raise InputError(key, value, "choices that are words, numbers or truth values: KEY=[A, B]")
        choices = tuple(dict.fromkeys([present, *choices]))
        if len(choices) < 2:
            raise InputError(key, value, "a choice besides the present value")
        return Dimension(key, present, choices=choices)
    vector = isinstance(present, (list, tuple)) and all(isinstance(each, (int, float)) for each in present)
    if not vector and (isinstance(present, bool) or not isinstance(present, (int, float))):
        raise InputError(key, present, "a number or a vector, or choices: KEY=[A, B]")
    dimension = Dimension(key, present)
    initial, whole = dimension.initial, dimension.whole
    if not given:
        if initial <= 0:
            raise InputError(key, f"no range, and the present value is {initial:g}", "a range: KEY=LOW:HIGH")
        low, high = initial / _SPREAD, initial * _SPREAD
        if whole:
            low, high = max(1, round(low)), round(high)
        return Dimension(key, present, low, high, logarithmic=True)
    ends, logarithmic = value.removesuffix(":log").split(":"), value.endswith(":log")
    try:
        low, high = map(int if whole else float, ends)
    except ValueError:
        kind = "whole numbers" if whole else "numbers"
        raise InputError(key, value, f"a range of {kind}: LOW:HIGH or LOW:HIGH:log") from None
    if not low < high or (logarithmic and low <= 0):
        raise InputError(key, value, f"LOW below HIGH{', above zero' if logarithmic else ''}")
    if not low <= initial <= high:
        present_is = "1: the vector is multiplied by it" if vector else f"the present value, {initial:g}"
        raise InputError(key, value, f"a range that contains {present_is}")
    return Dimension(key, present, low, high, logarithmic)
