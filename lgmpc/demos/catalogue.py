"""Which demonstrations there are; a module is read only when it is asked for."""

from __future__ import annotations

from importlib import import_module

from lgmpc.demos.outcome import Demo
from lgmpc.errors import InputError

__all__ = ["NAMES", "load_demo"]

NAMES: tuple[str, ...] = (
    "dzhanibekov",
    "poinsot",
    "heavy-top",
    "symmetry",
    "integrators",
    "elroy",
    "cat",
    "snake",
    "rov",
    "lee",
    "preintegration",
    "inekf",
    "solo12-momentum",
)
"""In the order in which a newcomer would watch them."""


def load_demo(name: str) -> Demo:
    """Return a demonstration by its name.

    Raises:
        InputError: there is none of this name; the nearest are named.
    """
    if name not in NAMES:
        raise InputError("demo", name, "a demonstration", NAMES)
    demo: Demo = import_module(f"lgmpc.demos.{name.replace('-', '_')}").DEMO
    return demo
