"""ProxQP in its baseline build, whose results are reproducible bit by bit.

proxsuite selects its AVX-512 or AVX2 build if the processor supports it. The results of those builds vary in their last
digits with the alignment of their memory, so that runs would not be repeatable. Only one build can be loaded in a
process: a program that imports proxsuite itself should do so after lgmpc, otherwise its runs are not repeatable.
"""

import importlib
import sys
import types
from typing import Any


def _load() -> Any:
    """Import proxsuite with the detection of vector instructions disabled."""
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
