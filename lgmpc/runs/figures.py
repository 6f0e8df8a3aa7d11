"""Bounds on named figures, such as those of a solved problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lgmpc.runs.verdict import short_number

__all__ = ["figure_of", "judge_figures", "unknown_bounds"]


def figure_of(bound: str) -> str:
    """Return the figure that a bound is about: ``max_com_error_m`` is about ``com_error_m``."""
    return bound[len("max_") :]


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
            shown, allowed = short_number(value, limit)
            words = figure_of(bound).replace("_", " ")
            reasons.append(f"{words}: {shown}, allowed at {'most' if highest else 'least'} {allowed} ({bound})")
    return tuple(reasons)
