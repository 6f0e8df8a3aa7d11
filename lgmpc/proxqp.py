"""ProxQP in the build that gives the same bits for the same problem.

proxsuite picks its AVX-512 or AVX2 build where the processor has it. Those builds answer one and the same dense problem
with one of two results, about 1e-10 apart, depending on where its memory happens to lie, so a run could not be repeated
bitwise. The baseline build does not, and costs about a microsecond more on the whole-body QP. Only one build may be
loaded in a process: a program that imports proxsuite itself should do so after lgmpc, or do without repeatability.
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import Any

__all__ = ["proxqp"]


def _load() -> Any:
    """Import proxsuite with its question for vector instructions answered by no."""
    name = "proxsuite.instructionset"
    if "proxsuite" in sys.modules:
        return importlib.import_module("proxsuite").proxqp
    plain = types.ModuleType(name)
    plain.__dict__.update(has_AVX512F=lambda: False, has_AVX2=lambda: False)
    sys.modules[name] = plain
    try:
        return importlib.import_module("proxsuite").proxqp
    finally:
        del sys.modules[name]


proxqp: Any = _load()
