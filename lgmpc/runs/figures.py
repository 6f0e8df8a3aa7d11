"""Bounds on named figures, such as those of a solved problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lgmpc.runs.verdict import short_number

__all__ = ["figure_of", "figure_words", "judge_figures", "unknown_bounds"]

_UNITS = {
    "_rad_s": ("rad/s", 1.0),
    "_rad": ("rad", 1.0),
    "_deg": ("deg", 1.0),
    "_nm": ("N.m", 1.0),
    "_m_s": ("m/s", 1.0),
    "_ms": ("ms", 1.0),
    "_m": ("mm", 1e3),
    "_ns": ("N.s", 1.0),
    "_n": ("N", 1.0),
    "_s": ("s", 1.0),
}
"""Ending of a figure's name, the unit that its values read best in, and how many of these one of the name's is."""


def figure_of(bound: str) -> str:
    """Return the figure that a bound is about: ``max_com_error_m`` is about ``com_error_m``."""
    return bound[len("max_") :]


def figure_words(figure: str) -> tuple[str, str, float]:
    """Return ``com_error_m`` as ("com error", "mm", 1000): words, unit to show it in, scale to that unit."""
    for ending, (unit, scale) in _UNITS.items():
        if figure.endswith(ending):
            return figure.removesuffix(ending).replace("_", " "), unit, scale
    return figure.replace("_", " "), "", 1.0


def unknown_bounds(bounds: Iterable[str], figures: Iterable[str]) -> list[str]:
    """Return the bounds that are about none of the figures."""
    known = set(figures)
    return [bound for bound in bounds if figure_of(bound) not in known]


def judge_figures(figures: Mapping[str, float], bounds: Mapping[str, float]) -> tuple[str, ...]:
    """Return a sentence for each bound (``max_<figure>`` or ``min_<figure>``) that is broken; NaN breaks all."""
    reasons = []
    for bound, limit in bounds.items():
        value, highest = figures[figure_of(bound)], bound.startswith("max_")
        if not (value <= limit if highest else value >= limit):
            words, unit, scale = figure_words(figure_of(bound))
            shown, allowed = short_number(scale * value, scale * limit)
            ending, side = f" {unit}" if unit else "", "most" if highest else "least"
            reasons.append(f"{words} {shown}{ending}, allowed at {side} {allowed}{ending} ({bound})")
    return tuple(reasons)
