"""CasADi functions as machine code: generated C, built once, cached on disk, called without copies.

    f = casadi.Function("f", [x, u], [xdot], ["x", "u"], ["xdot"])
    fast = compile_function(f)
    fast.input("x")[:] = ...         # write into the preallocated buffers
    fast.run()                       # about 0.2 us on top of the machine code, no allocation
    fast.output("xdot")              # valid until the next run

    whole = compile_map(f, 20)       # all stages of a horizon in one call: whole.input("x") is (20, nx)

Environment:

* ``LGMPC_JIT=0`` interprets every function on CasADi's virtual machine (about 20 times slower).
* ``LGMPC_CACHE_DIR`` moves the cache of libraries (default: the user's cache folder, ``~/.cache/lgmpc`` on Linux).
* ``CC`` chooses the C compiler, ``LGMPC_CFLAGS`` adds flags to lgmpc's own.
"""

from lgmpc.compile.build import compile_function, compile_functions, compile_map, densify_function, map_function
from lgmpc.compile.cache import CacheReport, cache_folder, inspect_cache
from lgmpc.compile.compiler import Compiler, find_compiler, jit_enabled
from lgmpc.compile.function import CompiledFunction
from lgmpc.compile.kernel import StageKernel
from lgmpc.compile.programme import compile_programme, compile_source

__all__ = [
    "CacheReport",
    "CompiledFunction",
    "Compiler",
    "StageKernel",
    "cache_folder",
    "compile_function",
    "compile_functions",
    "compile_map",
    "compile_programme",
    "compile_source",
    "densify_function",
    "find_compiler",
    "inspect_cache",
    "jit_enabled",
    "map_function",
]
