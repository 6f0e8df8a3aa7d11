"""The demonstrations; a module is imported only when it is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from lgmpc.demos.outcome import Demo
from lgmpc.errors import InputError

__all__ = ["NAMES", "SUMMARIES", "load_demo"]

SUMMARIES: Mapping[str, str] = MappingProxyType(
    {
        "dzhanibekov": "A T-handle turns over and back, as elliptic functions predict",
        "poinsot": "A free body's ellipsoid of inertia rolls without slipping",
        "heavy-top": "A top precesses, nods, sleeps and falls as Lagrange predicts",
        "symmetry": "What is symmetric is conserved, and no more: Noether",
        "integrators": "Variational integrators beside RK4: their drift over 1000 s",
        "elroy": "Elroy's beanie: a geometric phase in closed form",
        "cat": "A falling cat turns over at zero angular momentum",
        "snake": "Three links turn in space by wriggling: holonomy and area",
        "rov": "Under water: rising, righting, and Munk's instability",
        "lee": "A quadrotor recovers from almost every attitude",
        "preintegration": "IMU samples as one motion on SE_2(3), with its covariance",
        "inekf": "An invariant filter finds its attitude from 45 degrees off",
        "solo12-momentum": "Solo12 kicks in the air, and its momentum does not change",
    }
)
"""In the order in which a newcomer would watch them; a line each, that fits beside the name."""

NAMES: tuple[str, ...] = tuple(SUMMARIES)


def load_demo(name: str) -> Demo:
    """Return a demonstration by its name.

    Raises:
        InputError: there is none of this name; the nearest are named.
    """
    if name not in SUMMARIES:
        raise InputError("demo", name, "a demonstration", NAMES)
    return Demo(name, SUMMARIES[name], import_module(f"lgmpc.demos.{name.replace('-', '_')}").run)
