"""Figures of merit: declarations with descriptions; words, units and bounds by name."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, field, fields
from inspect import cleandoc
from typing import Any, TypeVar

T = TypeVar("T")


def metric(description: str, default: Any = MISSING) -> Any:
    """Declare a metric as a field of a dataclass.

    Args:
        description: noun phrase and unit; after a semicolon the details. The limits of the gate have it too.
        default: for runs that did not measure it.
    """
    return field(metadata={"description": description}, default=default)


def described(kind: type[T]) -> type[T]:
    """Add the descriptions of a dataclass' metrics to its docstring, and return it."""
    lines = (f"    {each.name}: {each.metadata['description']}" for each in fields(kind))  # type: ignore[arg-type]
    text = "\n".join([f"{cleandoc(kind.__doc__ or '')}\n\nAttributes:", *lines])
    kind.__doc__ = re.sub(r"\|[^|]+\|", r"``\g<0>``", text)  # bars are markup in reStructuredText
    return kind


_UNITS = {
    "_rad_s": ("rad/s", 1.0),
    "_rad": ("rad", 1.0),
    "_deg": ("deg", 1.0),
    "_nm": ("N.m", 1.0),
    "_nms": ("N.m.s", 1.0),
    "_m_s": ("m/s", 1.0),
    "_ms": ("ms", 1.0),
    "_m": ("mm", 1e3),
    "_ns": ("N.s", 1.0),
    "_n": ("N", 1.0),
    "_s": ("s", 1.0),
    "_percent": ("%", 1.0),
}
"""Unit at the end of a figure's name, unit of display, and factor from the first to the second."""

_ABBREVIATIONS = {each.lower(): each for each in ("CoM", "CoP", "MPC", "RMS", "RMSE", "RPY", "WBC", "ZMP")}

_CLEAR = ("walking", "modes")
"""Groups of metrics whose names are clear without that of the group."""

_SIGNED = ("clearance", "cost", "distance", "force", "height", "lost", "margin", "rise")
"""Last words, before the unit, of figures that can be negative."""

_SMALL = 1e-3
"""Smaller values, in their units, are shown as less than this."""


def figure_of(bound: str) -> str:
    """Return the figure of a bound: that of ``max_com_error_m`` is ``com_error_m``."""
    return bound[len("max_") :]


def is_signed(figure: str) -> bool:
    """Return whether a figure can be negative: margins, distances ahead, heights; not errors, ratios, speeds."""
    return _stem(figure).rpartition("_")[2] in _SIGNED or figure.startswith("least_")


def figure_words(figure: str, *values: float | None) -> tuple[str, str, float]:
    """Return a figure's words, unit of display and factor to it: of ``com_error_m`` ("CoM error", "mm", 1000).

    Args:
        figure: its name; of a metric in a group also ``mpc_ms.p50`` ("MPC p50", "ms", 1) or ``walking.steps``.
        values: shown together; lengths of a metre or more are in m.
    """
    group, _, figure = figure.rpartition(".")
    if group and group not in _CLEAR:
        figure = f"{group[:-3]}_{figure}_ms" if group.endswith("_ms") else f"{group}_{figure}"
    stem = _stem(figure)
    unit, scale = _UNITS.get(figure.removeprefix(stem), ("", 1.0))
    return _words(stem), *(length_unit(*values) if unit == "mm" else (unit, scale))


def length_unit(*values: float | None) -> tuple[str, float]:
    """Return the unit in which lengths are shown, and the factor to it: mm, or m if one is a metre or longer."""
    return ("m", 1.0) if max((abs(each) for each in values if each is not None), default=0.0) >= 1.0 else ("mm", 1e3)


def figure_number(value: float, unit: str = "", limit: float | None = None) -> str:
    """Return a figure as text: three digits; with an exponent only if it has no unit, or if its limit is small too.

    Args:
        value: in the unit; NaN becomes "-".
        unit: empty if it has none.
        limit: shown with it, if any.
    """
    if math.isnan(value):
        return "-"
    if 0.0 < abs(value) < _SMALL:
        if unit and (limit is None or abs(limit) >= 10.0 * _SMALL):
            return f"< {_SMALL:g}" if value > 0.0 else f"> -{_SMALL:g}"
        return f"{value:.1e}"
    return _short(value)


def short_number(value: float, limit: float) -> tuple[str, str]:
    """Return a value and the limit that it violates as texts, with enough digits to distinguish them."""
    shown, allowed = _short(value), _short(limit)
    return (shown, allowed) if shown != allowed else (f"{value:.7g}", f"{limit:.7g}")


def unknown_bounds(bounds: Iterable[str], figures: Iterable[str]) -> list[str]:
    """Return the bounds on unknown figures."""
    known = set(figures)
    return [bound for bound in bounds if figure_of(bound) not in known]


def judge_figures(
    figures: Mapping[str, float | None], bounds: Mapping[str, float], phrases: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Return a sentence for each violated bound (``max_<figure>`` or ``min_<figure>``); None and NaN violate all.

    Args:
        figures: by name.
        bounds: by name.
        phrases: descriptions of the figures by bound; the words of their names unless given.
    """
    reasons = []
    for bound, limit in bounds.items():
        value, highest = figures[figure_of(bound)], bound.startswith("max_")
        if value is None or math.isnan(value):
            reasons.append(f"{bound} was not measured, but the gate limits it to {limit:g}")
        elif not (value <= limit if highest else value >= limit):
            words, unit, scale = figure_words(figure_of(bound), value, limit)
            shown, allowed = short_number(scale * value, scale * limit)
            ending, side = f" {unit}" if unit else "", "most" if highest else "least"
            words = f"{phrases[bound]}:" if phrases else words
            reasons.append(f"{words} {shown}{ending}, allowed at {side} {allowed}{ending} ({bound})")
    return tuple(reasons)


def _stem(figure: str) -> str:
    """Return the name without its unit."""
    return next((figure.removesuffix(ending) for ending in _UNITS if figure.endswith(ending)), figure)


def _words(name: str) -> str:
    return " ".join(_ABBREVIATIONS.get(word, word) for word in name.split("_"))


def _short(value: float) -> str:
    """Return three digits, without an exponent for large values."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
