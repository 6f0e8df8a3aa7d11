"""The C compiler: its search, its flags, and the identity of its code."""

import functools
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from lgmpc.errors import CompileError, InputError

# Measured with gcc 12 on the Jacobians of Solo12's inverse dynamics (26,000 scalar statements): -O1 3.4 s and 4.4 us a
# call, -O2 8 s and 3.9 us, -O3 no better. -march=native (from _describe) saves 16 % of a call: AVX needs fewer moves.
# No contraction into fused multiply-adds: machine code then equals the interpreter bit for bit, at the same speed.
# No math errno: sqrt is one instruction. Hidden symbols: CasADi's small helpers can be inlined.
# Never -ffast-math: it breaks NaN, signed zeros and guarded divisions.
FLAGS: tuple[str, ...] = (
    "-O1",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-DGCC_HASCLASSVISIBILITY",  # exports CasADi's entry points nevertheless
)
# Calls within the library to a function that is named like one of the C library (clock, ...) stay in the library.
_ELF_FLAGS = ("-Wl,-Bsymbolic",)
# Disables GCC's graph-colouring register allocator, quadratic in straight-line code: 2.2 s and 4.1 us instead.
_GCC_FLAGS = ("--param=ira-max-conflict-table-size=0",)

_UNSAFE_FLAGS = ("-ffast-math", "-Ofast", "-funsafe-math-optimizations", "-ffinite-math-only")
_CANDIDATES = ("cc", "gcc", "clang")
_warned = False
_warning = threading.Lock()
_processors = threading.BoundedSemaphore(os.cpu_count() or 1)  # of compilers that run at once in this process


@dataclass(frozen=True)
class Compiler:
    """A C compiler that reported its version.

    Attributes:
        command: the program and its own arguments.
        version: the output of ``--version``.
        flags: its options, the user's ``LGMPC_CFLAGS`` last.
        cpu: identity of the processor that the code is compiled for.
    """

    command: tuple[str, ...]
    version: str
    flags: tuple[str, ...]
    cpu: str

    @property
    def name(self) -> str:
        """First line of the version, for messages."""
        return self.version.splitlines()[0]

    @property
    def identity(self) -> str:
        """Command, version, flags and processor: they determine the machine code of a given source."""
        return "\n".join((*self.command, self.version, *self.flags, self.cpu))

    def build(
        self,
        sources: Sequence[Path],
        library: Path,
        function: str,
        report: Callable[[str], None] = lambda message: None,
    ) -> None:
        """Compile C files into one shared library, as many at a time as there are processors.

        Args:
            sources: the C files, all in the library's folder.
            library: the file to write.
            function: name of the function, for messages.
            report: called with the progress after each of several files.

        Raises:
            CompileError: the compiler failed; the error contains its output.
        """
        if len(sources) == 1:
            self._call([sources[0].name], library, function, "-lm")
            return
        objects = [source.with_suffix(".o") for source in sources]
        pool = ThreadPoolExecutor(os.cpu_count() or 1)
        try:
            calls = [
                pool.submit(self._call, ["-c", source.name], target, function)
                for source, target in zip(sources, objects, strict=True)
            ]
            for done, call in enumerate(as_completed(calls), 1):
                call.result()
                report(f"compiling '{function}': {done} of {len(calls)} files")
        finally:
            pool.shutdown(cancel_futures=True)
        self._call([path.name for path in objects], library, function, "-lm")

    def _call(self, arguments: list[str], target: Path, function: str, *libraries: str) -> None:
        command = [*self.command, *self.flags, *arguments, "-o", target.name, *libraries]
        try:
            with _processors:
                done = subprocess.run(command, cwd=target.parent, capture_output=True, text=True, errors="replace")
        except OSError as error:
            raise CompileError(function, shlex.join(command), str(error)) from error
        if done.returncode != 0 or not target.exists():
            log = (done.stdout + done.stderr).strip() or f"no output, exit code {done.returncode}"
            raise CompileError(function, shlex.join(command), log)


def jit_enabled() -> bool:
    """Return whether functions may be compiled: ``LGMPC_JIT`` is not 0 (or false, no, off).

    Raises:
        InputError: ``LGMPC_JIT`` has another value.
    """
    value = os.environ.get("LGMPC_JIT", "").strip().lower()
    if value in ("", "1", "true", "yes", "on"):
        return True
    if value in ("0", "false", "no", "off"):
        return False
    raise InputError("LGMPC_JIT", repr(value), "0 (interpret) or 1 (compile)")


def compiler_for_functions() -> Compiler | None:
    """Return the compiler; None, with one warning a process, if there is none, and None with ``LGMPC_JIT=0``.

    Raises:
        InputError: as :func:`jit_enabled` and :func:`find_compiler`.
    """
    if not jit_enabled():
        return None
    compiler = find_compiler()
    if compiler is None:
        _warn_once()
    return compiler


def _warn_once() -> None:
    global _warned
    with _warning:
        first, _warned = not _warned, True
    if first:
        warnings.warn(
            "no C compiler found: functions are interpreted, about 20 times slower. Install gcc (apt install gcc), or "
            "without root ziglang (pip install ziglang), or name a compiler in CC; LGMPC_JIT=0 interprets without this "
            "warning",
            RuntimeWarning,
            stacklevel=4,
        )


def find_compiler() -> Compiler | None:
    """Return the compiler that ``CC`` names, else the first of cc, gcc, clang and the pip package ziglang, or None.

    Raises:
        InputError: ``CC`` names a program that cannot be run, or ``CC`` or ``LGMPC_CFLAGS`` contains a flag that breaks
            arithmetic, or a quotation that does not end.
    """
    extra, command = _words_of("LGMPC_CFLAGS"), _words_of("CC")
    if command:
        version = _version(command)
        if version is None:
            got = repr(shlex.join(command))
            raise InputError("CC", got, "a C compiler that runs; or unset CC, and lgmpc searches for one")
        return _describe(command, version, extra)
    for name in _CANDIDATES:
        version = _version((name,))
        if version is not None:
            return _describe((name,), version, extra)
    if importlib.util.find_spec("ziglang") is not None:
        command = (sys.executable, "-m", "ziglang", "cc")
        version = _version(command)
        if version is not None:
            return _describe(command, version, extra)
    return None


def _words_of(variable: str) -> tuple[str, ...]:
    """Return the words of an environment variable, checked for flags that break arithmetic."""
    text = os.environ.get(variable, "")
    try:
        words = tuple(shlex.split(text))
    except ValueError as error:
        raise InputError(variable, repr(text), f"words as in a shell ({error})") from error
    for flag in words:
        if flag in _UNSAFE_FLAGS:
            raise InputError(variable, flag, "flags that keep IEEE arithmetic (NaN and guarded divisions rely on it)")
    return words


def _describe(command: tuple[str, ...], version: str, extra: tuple[str, ...]) -> Compiler:
    flags = FLAGS
    if sys.platform == "linux":
        flags += _ELF_FLAGS
    if "Free Software Foundation" in version:
        flags += _GCC_FLAGS
    if "ziglang" in command:
        flags += ("-fno-sanitize=undefined",)  # zig instruments C code unless this flag forbids it
    native = platform.machine().lower() in ("x86_64", "amd64")
    if native:
        flags += ("-march=native",)
    return Compiler(command, version, flags + extra, _cpu() if native else platform.machine())


@functools.lru_cache(maxsize=32)
def _ask_version(command: tuple[str, ...], program: str) -> str | None:
    try:
        done = subprocess.run([*command, "--version"], capture_output=True, text=True, errors="replace", timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None


def _version(command: tuple[str, ...]) -> str | None:
    # PATH may change during a process, so the program is looked up every time and only its version is cached.
    program = shutil.which(command[0]) if command else None
    return None if program is None else _ask_version(command, program)


@functools.lru_cache(maxsize=1)
def _cpu() -> str:
    """Return the processor's identity: machines that share a home folder must not share machine code."""
    identifying = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags")
    lines: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() in identifying:
                lines.setdefault(key.strip(), value.strip())
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(f"{key}={value}" for key, value in sorted(lines.items()))
