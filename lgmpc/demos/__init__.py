"""The demonstrations; a module is imported only when it is loaded."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from lgmpc.demos.outcome import Demo
from lgmpc.errors import InputError

SUMMARIES: Mapping[str, str] = MappingProxyType(
    {
        "dzhanibekov": "A T-handle flips periodically: Dzhanibekov's effect",
        "poinsot": "A free body's ellipsoid of inertia rolls without slipping",
        "heavy-top": "Lagrange's top: precession, nutation, sleeping and falling",
        "symmetry": "Noether's theorem: as many momenta as symmetries",
        "integrators": "Variational integrators and RK4: drift over 1000 s",
        "cat": "A falling cat turns over at zero angular momentum",
        "snake": "Three links rotate by changes of shape: holonomy and area",
        "rov": "Underwater vehicles: rising, righting, Munk's instability",
        "lee": "A quadrotor recovers from almost every attitude",
        "inekf": "Invariant and quaternion filter from 45 degrees of error",
        "solo12-momentum": "Solo12 moves its legs in free fall: momentum balance",
    }
)
"""The demonstrations with a summary of one line each, in the order of the list."""

NAMES: tuple[str, ...] = tuple(SUMMARIES)


def load_demo(name: str) -> Demo:
    """Return the demonstration called ``name``.

    Raises:
        InputError: there is none of this name; the nearest are named.
    """
    if not isinstance(name, str) or name not in SUMMARIES:
        raise InputError("demo", name, "a demonstration", NAMES)
    return Demo(name, SUMMARIES[name], import_module(f"lgmpc.demos.{name.replace('-', '_')}").run)
