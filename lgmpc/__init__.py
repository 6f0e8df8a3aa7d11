"""lgmpc: Lie-group trajectory optimisation and model-predictive control for floating-base robots.

The names that most programs need are here, each imported from its package on first use, so that ``import lgmpc`` is
fast; ``__init__.pyi`` lists them, for type checkers, editors and this module. All other names are imported from their
packages (``lgmpc.costs.library``).

Conventions of the whole package:

* Configuration ``q = [base position (world), quaternion x y z w, joints]``; velocity
  ``v = [base linear, base angular (both in the body frame), joint rates]``: Pinocchio's.
* State ``x = (q, v)``: ``nx = nq + nv``, ``ndx = 2 nv``. ``diff(x0, x1) = x1 (-) x0``, ``integrate(x, dx) = x (+) dx``.
* SE(3) twists and wrenches are linear first. Extended poses SE_k(3) have tangent (rotation, then a 3-vector a column).
* ``coadjoint(xi) = ad(xi)^T``; ``force_cross(xi) = -ad(xi)^T``.
* Contact forces are in world axes and act on the robot. Centroidal momentum is ``[linear; angular]`` about the centre
  of mass in world axes.
* SI units. Random numbers come only from a ``numpy.random.Generator`` that is passed in.
"""

import ast
from importlib import import_module
from time import time_ns

__version__ = "0.2.0"

__imported_ns__ = time_ns()
"""When the package was imported, ns since 1970: source files that are younger may not be what was imported."""


def _read_names() -> dict[str, str]:
    """Return the module of each public name."""
    with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as file:
        imports = [node for node in ast.parse(file.read()).body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


_MODULE_OF = _read_names()

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> object:
    """Import a public name from its module when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'lgmpc' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the public names, whether they have been used or not."""
    return __all__
