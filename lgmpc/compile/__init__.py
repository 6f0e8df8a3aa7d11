"""CasADi functions as machine code: generated C, compiled once, cached on disk, called without copies.

    f = casadi.Function("f", [x, u], [xdot], ["x", "u"], ["xdot"])
    call = StageKernel(f).bind(20, x=xs, u=us, xdot=out)   # all stages of a horizon, on one's own arrays (20, n)
    call()                                                 # reads and writes them; no allocation
    call = BatchKernel(f).bind(20, x=xs, u=us, xdot=out)   # the same, several stages at a time

Environment:

* ``LGMPC_JIT=0`` interprets every function on CasADi's virtual machine (about 20 times slower).
* ``LGMPC_CACHE_DIR`` moves the cache of libraries (default: the user's cache folder, ``~/.cache/lgmpc`` on Linux).
* ``CC`` chooses the C compiler, ``LGMPC_CFLAGS`` adds flags to lgmpc's own.
* ``LGMPC_CFLAGS=-DLANES=1`` (2, 4, 8) chooses how many stages a ``BatchKernel`` evaluates at a time (default: as many
  doubles as the processor's vectors hold).
"""

from lgmpc.compile.cache import cache_folder as cache_folder, inspect_cache as inspect_cache
from lgmpc.compile.compiler import find_compiler as find_compiler, jit_enabled as jit_enabled
from lgmpc.compile.index import cached as cached, made_anew as made_anew
from lgmpc.compile.kernel import (
    BatchKernel as BatchKernel,
    StageKernel as StageKernel,
    densify_function as densify_function,
)
from lgmpc.compile.native import (
    aligned_zeros as aligned_zeros,
    compile_source as compile_source,
    frame_of as frame_of,
    reporting as reporting,
    sequence_of as sequence_of,
)
from lgmpc.compile.pipeline import Pipeline as Pipeline, PipelineStep as PipelineStep
from lgmpc.compile.simd import EXACT as EXACT, SQUARES as SQUARES
