"""Compiled functions: the same numbers as interpreted ones, and a cache without races, which checks what it loads."""

from __future__ import annotations

import logging
import os
import shutil
import stat
import subprocess
import sys
import threading
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi
import numpy as np
import pytest
from own_memory import OnOwnMemory

from lgmpc.compile import (
    BatchKernel,
    StageKernel,
    aligned_zeros,
    cache_folder,
    densify_function,
    find_compiler,
    inspect_cache,
    reporting,
)
from lgmpc.errors import CompileError, InputError

needs_compiler = pytest.mark.skipif(
    all(shutil.which(name) is None for name in ("cc", "gcc", "clang")), reason="no C compiler is installed"
)


@pytest.fixture(autouse=True)
def cache(empty_cache: Path) -> Path:
    return empty_cache


@pytest.fixture(params=["compiled", "interpreted"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Both ways to evaluate a function."""
    if request.param == "interpreted":
        monkeypatch.setenv("LGMPC_JIT", "0")
    elif all(shutil.which(name) is None for name in ("cc", "gcc", "clang")):
        pytest.skip("no C compiler is installed")
    return str(request.param)


def scalar_function() -> casadi.Function:
    """Every kind of scalar operation, a sparse input and a sparse output."""
    x, a = casadi.SX.sym("x", 3), casadi.SX.sym("a", casadi.Sparsity.lower(3))
    y = casadi.vertcat(
        casadi.sin(x[0]) * casadi.cos(x[1]) + casadi.sqrt(x[2] ** 2 + 1),
        casadi.if_else(x[0] > x[1], casadi.exp(x[1]), casadi.atan2(x[0], x[2])),
        casadi.fmin(x[0], x[1]) + casadi.sign(x[2]) * casadi.tanh(x[0] / 3) - casadi.log(casadi.fabs(x[1]) + 2),
    )
    return casadi.Function("scalars", [x, a], [a @ y, casadi.diag(y), casadi.dot(x, y)], ["x", "a"], ["p", "d", "s"])


def shift_function(constant: float = 1.0, name: str = "shift") -> casadi.Function:
    x = casadi.SX.sym("x", 2)
    return casadi.Function(name, [x], [x + constant], ["x"], ["y"])


def libraries(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


# Values


@needs_compiler
def test_machine_code_agrees_with_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    function = scalar_function()
    fast = OnOwnMemory(function)
    monkeypatch.setenv("LGMPC_JIT", "0")
    slow = OnOwnMemory(function)
    assert fast.compiled and not slow.compiled
    rng = np.random.default_rng(0)
    for _ in range(50):
        arguments = [rng.normal(size=array.shape) * 3 for array in fast.given.values()]
        for a, b in zip(fast(*arguments), slow(*arguments), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-14)


def test_values_are_those_of_the_casadi_function(way: str) -> None:
    function = scalar_function()
    compiled = OnOwnMemory(function)
    assert compiled.compiled == (way == "compiled")
    x, a = np.array([0.3, -0.7, 1.1]), np.arange(9.0).reshape(3, 3)
    expected = function(x, np.tril(a))
    for got, value in zip(compiled(x, a.ravel(order="F")), expected, strict=True):
        np.testing.assert_allclose(got[0], value.full().ravel(order="F"), rtol=1e-14, atol=1e-15)


def test_nan_passes_through(way: str) -> None:
    (y,) = OnOwnMemory(shift_function())(np.array([np.nan, 1.0]))
    assert np.isnan(y[0, 0]) and y[0, 1] == 2.0


# Buffers


def test_run_allocates_nothing(way: str) -> None:
    x = casadi.SX.sym("x", 500)
    compiled = OnOwnMemory(casadi.Function("wide", [x], [x + 1.0, casadi.sin(x)]))
    compiled.run()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(100):
            compiled.run()
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 512 and peak - before < 2048, "one result array would be 4 kB"


@pytest.mark.parametrize("bad", [None, "text", np.nan, np.zeros(3), [], {}], ids=lambda bad: type(bad).__name__)
def test_arguments_of_other_types_are_named(bad: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    function, x, y = shift_function(), np.zeros((2, 2)), np.zeros((2, 2))
    kernel = StageKernel(function)
    for call, name in (
        (lambda: StageKernel(bad), "function"),
        (lambda: BatchKernel(bad), "function"),
        (lambda: densify_function(bad), "function"),
        (lambda: kernel.bind(bad, x=x, y=y), "stages"),
        (lambda: kernel.bind(2, x=bad, y=y), "x"),
        (lambda: aligned_zeros(bad), "size"),
    ):
        with pytest.raises(InputError, match=f"^{name}: got "):
            call()


@needs_compiler
def test_functions_run_in_parallel_threads() -> None:
    def work(seed: int) -> bool:
        mine = OnOwnMemory(scalar_function(), 200)
        x = np.random.default_rng(seed).normal(size=(200, 3))
        first, *_ = mine(x, np.eye(3).ravel())
        for _ in range(50):
            mine.run()
            if not np.array_equal(first, mine.found["p"]):
                return False
        return bool(np.allclose(first[:, 0], np.sin(x[:, 0]) * np.cos(x[:, 1]) + np.sqrt(x[:, 2] ** 2 + 1)))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(8)))


def test_densify_returns_dense_functions_unchanged() -> None:
    dense, sparse = shift_function(), scalar_function()
    assert densify_function(dense) is dense
    filled = densify_function(sparse)
    assert filled.name() == "scalars" and filled.is_a("SXFunction")
    assert filled.sparsity_in(1).is_dense() and filled.sparsity_out(1).is_dense()


# Horizons


@pytest.mark.parametrize("stages", [1, 7])
def test_horizon_equals_its_stages(stages: int, way: str) -> None:
    one, whole = OnOwnMemory(scalar_function()), OnOwnMemory(scalar_function(), stages)
    rng = np.random.default_rng(1)
    arguments = [rng.normal(size=array.shape) for array in whole.given.values()]
    results = whole(*arguments)
    for k in range(stages):
        for got, expected in zip(results, one(*(argument[k] for argument in arguments)), strict=True):
            np.testing.assert_allclose(got[k], expected[0], rtol=1e-14, atol=1e-14)


@needs_compiler
def test_another_horizon_compiles_nothing(cache: Path) -> None:
    OnOwnMemory(shift_function())
    messages: list[str] = []
    with reporting(messages.append):
        whole = OnOwnMemory(shift_function(), 300)
    assert messages == [] and len(libraries(cache)) == 1
    np.testing.assert_array_equal(whole(np.arange(600.0).reshape(300, 2))[0].ravel(), np.arange(600.0) + 1.0)


# The cache


@needs_compiler
def test_second_time_comes_from_the_cache(cache: Path) -> None:
    messages: list[str] = []
    with reporting(messages.append):
        OnOwnMemory(shift_function())
    assert len(messages) == 2 and "compiling 'shift'" in messages[0] and "compiled 'shift' in" in messages[1]
    with reporting(messages.append):
        OnOwnMemory(shift_function())
    assert len(messages) == 2
    assert [p.name.split("-")[0] for p in cache.iterdir()] == ["shift"], "nothing but the library stays behind"
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@needs_compiler
def test_the_progress_of_a_long_compilation_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lgmpc.compile.simd.STATEMENTS", 4)
    monkeypatch.setattr("lgmpc.compile.simd._PARTS", 1)
    x = casadi.SX.sym("x", 6)
    messages: list[str] = []
    with reporting(messages.append):
        kernel = BatchKernel(casadi.Function("growing", [x], [casadi.sin(x) + x], ["x"], ["y"]))
    messages = [message for message in messages if "'growing'" in message]  # there is the driver's, too
    assert "once, later runs load it" in messages[0]
    assert messages[1:-1] == [f"compiling 'growing': {k} of 4 files" for k in (1, 2, 3, 4)]
    given, result = np.arange(30.0).reshape(5, 6), np.zeros((5, 6))
    kernel.bind(5, x=given, y=result)()
    np.testing.assert_allclose(result, np.sin(given) + given, rtol=1e-15)


@needs_compiler
def test_one_file_that_fails_fails_the_compilation(tmp_path: Path) -> None:
    files = [tmp_path / "good.c", tmp_path / "bad.c", tmp_path / "other.c"]
    for path, text in zip(files, ("int one;", "no C at all", "int two;"), strict=True):
        path.write_text(text)
    compiler = find_compiler()
    assert compiler is not None
    with pytest.raises(CompileError, match="compiling 'several' failed") as failure:
        compiler.build(files, tmp_path / "several.so", "several")
    assert "bad.c" in failure.value.command and not (tmp_path / "several.so").exists()


@needs_compiler
@pytest.mark.parametrize("name", ["clock", "index", "div", "remove", "select"])
def test_names_of_the_c_library_are_names_like_any_other(name: str, cache: Path) -> None:
    x = casadi.SX.sym("x", 2)
    function = casadi.Function(name, [x], [3 * x + 1], ["x"], ["y"])
    np.testing.assert_array_equal(OnOwnMemory(function, 3)([1.0, 2.0])[0], [[4.0, 7.0]] * 3)


@needs_compiler
def test_expressions_and_flags_are_in_the_key(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    OnOwnMemory(shift_function(1.0))
    OnOwnMemory(shift_function(2.0))
    assert len(libraries(cache)) == 2
    monkeypatch.setenv("LGMPC_CFLAGS", "-O0")
    assert OnOwnMemory(shift_function(2.0))(0.0)[0][0, 0] == 2.0
    assert len(libraries(cache)) == 3
    monkeypatch.setenv("CC", "gcc -DANOTHER")
    OnOwnMemory(shift_function(2.0))
    assert len(libraries(cache)) == 4


@needs_compiler
@pytest.mark.parametrize("damage", ["truncated", "empty", "altered"])
def test_damaged_entries_are_built_again(damage: str, cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    OnOwnMemory(shift_function())
    (entry,) = libraries(cache)
    whole = entry.read_bytes()
    middle = len(whole) // 2
    altered = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    # A new file, not the same one in place: the old bytes are mapped into this process.
    entry.unlink()
    entry.write_bytes({"truncated": whole[:middle], "empty": b"", "altered": altered}[damage])
    assert inspect_cache(cache).damaged == (entry.name,)
    with caplog.at_level(logging.WARNING, "lgmpc.compile"):
        assert OnOwnMemory(shift_function())(1.0)[0][0, 0] == 2.0
    assert "damaged" in caplog.text
    report = inspect_cache(cache)
    assert (report.entries, report.damaged) == (1, ()) and report.size_bytes > 1000


@needs_compiler
def test_whole_entry_that_does_not_load_is_built_again(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    from lgmpc.compile.cache import _digest

    OnOwnMemory(shift_function())
    (entry,) = libraries(cache)
    entry.unlink()
    foreign = cache / "foreign"
    foreign.write_bytes(b"made for another machine")
    foreign.rename(cache / f"{entry.stem.rpartition('-')[0]}-{_digest(foreign.read_bytes())}.so")
    with caplog.at_level(logging.WARNING, "lgmpc.compile"):
        assert OnOwnMemory(shift_function())(1.0)[0][0, 0] == 2.0
    assert "does not load" in caplog.text


def test_a_cache_is_inspected_while_others_change_it(tmp_path: Path) -> None:
    done = threading.Event()

    def compile_and_clean() -> None:
        while not done.is_set():
            scratch = tmp_path / ".build-1"
            scratch.mkdir()
            for k in range(20):
                (scratch / f"{k}.c").write_text("x")
            shutil.rmtree(scratch)

    other = threading.Thread(target=compile_and_clean)
    other.start()
    try:
        for _ in range(3000):
            assert inspect_cache(tmp_path).size_bytes <= 20
    finally:
        done.set()
        other.join()


@needs_compiler
def test_files_of_a_killed_compilation_are_removed_after_a_day(cache: Path) -> None:
    cache.mkdir(mode=0o700)
    old, young = cache / ".build-old", cache / ".build-young"
    for folder in (old, young):
        folder.mkdir()
        (folder / "f.c").write_text("")
    day_and_more = time.time() - 25 * 3600
    os.utime(old, (day_and_more, day_and_more))
    OnOwnMemory(shift_function())
    assert young.exists() and not old.exists()


WORKER = """
import sys, time
from pathlib import Path
import casadi
import numpy as np
from lgmpc.compile import StageKernel, reporting
x = casadi.SX.sym("x", 2)
function = casadi.Function("shift", [x], [x + 1], ["x"], ["y"])
Path(sys.argv[1]).touch()
while not Path(sys.argv[2]).exists():
    time.sleep(0.005)
with reporting(print):
    kernel, result = StageKernel(function), np.zeros(2)
kernel.bind(1, x=np.ones(2), y=result)()
assert kernel.compiled and result[0] == 2.0
"""


@needs_compiler
def test_processes_at_once_build_once_and_all_succeed(cache: Path, tmp_path: Path) -> None:
    calls = tmp_path / "calls"
    slow = tmp_path / "slow-cc"
    slow.write_text(f'#!/bin/sh\n[ "$1" = --version ] || {{ echo built >> {calls}; sleep 0.5; }}\nexec cc "$@"\n')
    slow.chmod(0o755)
    start = tmp_path / "start"
    ready = [tmp_path / f"ready{k}" for k in range(3)]
    environment = os.environ | {"CC": str(slow), "LGMPC_CACHE_DIR": str(cache)}
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER, str(flag), str(start)],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for flag in ready
    ]
    deadline = time.monotonic() + 60.0
    while not all(flag.exists() for flag in ready) and time.monotonic() < deadline:
        time.sleep(0.01)
    start.touch()
    outputs = [worker.communicate(timeout=60)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0, 0], outputs
    assert calls.read_text().split() == ["built"]
    assert "waiting for another process" in "".join(outputs)
    assert [p.suffix for p in cache.iterdir()] == [".so"]


@needs_compiler
def test_a_cache_that_is_removed_while_it_is_built_in_is_built_in_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Removed before the first call of the compiler, and after the second; what is loaded works without it."""
    count, compiler = tmp_path / "count", tmp_path / "removing-cc"
    compiler.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && exec cc "$@"\n'
        f"echo >> {count}; k=$(wc -l < {count}); [ $k = 1 ] && rm -rf {cache}\n"
        f'cc "$@"; code=$?; [ $k = 2 ] && rm -rf {cache}; exit $code\n'
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    compiled = OnOwnMemory(shift_function())
    assert compiled.compiled and compiled(1.0)[0][0, 0] == 2.0
    assert count.read_text() == "\n" * 3
    (entry,) = libraries(cache)
    shutil.rmtree(cache)
    assert compiled(2.0)[0][0, 0] == 3.0


@needs_compiler
def test_a_cache_that_cannot_be_kept_is_one_error(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "removing-cc"
    compiler.write_text(f'#!/bin/sh\n[ "$1" = --version ] || rm -rf {cache}\nexec cc "$@"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(InputError, match="another process removes it repeatedly"):
        OnOwnMemory(shift_function())


# Cache folders that are refused


def assert_refused(words: str) -> None:
    with pytest.raises(InputError, match=words) as refusal:
        OnOwnMemory(shift_function())
    assert "LGMPC_CACHE_DIR" in str(refusal.value), "the message holds the remedy"


@needs_compiler
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
@pytest.mark.parametrize("linked", [False, True])
def test_folder_that_others_may_write_to_is_refused(mode: int, linked: bool, cache: Path, tmp_path: Path) -> None:
    real = tmp_path / "real" if linked else cache
    real.mkdir()
    real.chmod(mode)
    if linked:
        cache.symlink_to(real)
    assert_refused(f"others may write to.*{mode:04o}.*chmod 700")
    assert list(real.iterdir()) == []
    real.chmod(0o755)
    assert cache_folder() == real.resolve()


@needs_compiler
def test_folder_that_others_may_replace_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(shared / "mine"))
    assert_refused("others may replace")
    shared.chmod(0o1777)  # sticky, as /tmp: only the owner of an entry may rename it
    assert cache_folder() == shared / "mine"


@needs_compiler
def test_folder_of_another_user_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if os.geteuid() == 0:
        cache.mkdir(mode=0o700)
        os.chown(cache, 12345, -1)
    else:
        monkeypatch.setenv("LGMPC_CACHE_DIR", "/usr")
    assert_refused("belongs to another user")


@needs_compiler
def test_folder_that_cannot_be_made_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache.write_text("a file")
    assert_refused("cannot be created")
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(cache / "below"))
    assert_refused("cannot be created")


# Compilers


def test_without_compiler_functions_are_interpreted_with_one_warning(cache: Path, tmp_path: Path) -> None:
    script = """
import sys, warnings
sys.modules["ziglang"] = None
import casadi
from lgmpc.compile import StageKernel, reporting
x = casadi.SX.sym("x")
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for k in range(3):
        assert not StageKernel(casadi.Function("f", [x], [x + k])).compiled
print(len(caught), caught[0].category.__name__, caught[0].filename, caught[0].message)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | {"PATH": str(tmp_path)}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1 RuntimeWarning <string> no C compiler found"), done.stdout
    assert not cache.exists()


def test_jit_can_be_switched_off_without_a_warning(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    assert not OnOwnMemory(shift_function()).compiled
    assert not cache.exists()
    monkeypatch.setenv("LGMPC_JIT", "maybe")
    with pytest.raises(InputError, match="LGMPC_JIT: got 'maybe'"):
        OnOwnMemory(shift_function())


@pytest.mark.parametrize("program", ["no-such-compiler-here", "false"])
def test_compiler_that_does_not_run_is_bad_input(program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", program)
    with pytest.raises(InputError, match=f"CC: got '{program}'"):
        OnOwnMemory(shift_function())


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast"])
def test_flags_that_break_arithmetic_are_refused(flag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_CFLAGS", f"-g {flag}")
    with pytest.raises(InputError, match=f"LGMPC_CFLAGS: got {flag}"):
        find_compiler()
    monkeypatch.delenv("LGMPC_CFLAGS")
    monkeypatch.setenv("CC", f"cc {flag}")
    with pytest.raises(InputError, match=f"CC: got {flag}"):
        find_compiler()


@pytest.mark.parametrize("variable", ["CC", "LGMPC_CFLAGS"])
def test_a_quotation_that_does_not_end_is_bad_input(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, 'cc "-g')
    with pytest.raises(InputError, match=f"{variable}: got 'cc \"-g'; .*No closing quotation"):
        find_compiler()


@needs_compiler
def test_failed_compilation_shows_the_log_and_leaves_nothing(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_CFLAGS", "-fno-such-flag")
    with pytest.raises(CompileError, match="compiling 'shift' failed") as failure:
        OnOwnMemory(shift_function())
    assert "-fno-such-flag" in failure.value.log and "shift.c" in failure.value.command
    assert list(cache.iterdir()) == []


def test_a_function_that_calls_python_is_interpreted() -> None:
    class Python(casadi.Callback):
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("python", {})

        def eval(self, arg):
            return [2 * arg[0]]

    python, x = Python(), casadi.MX.sym("x")
    wrapper = casadi.Function("wrapper", [x], [python(x)])
    interpreted = OnOwnMemory(wrapper)
    assert not interpreted.compiled and interpreted(3.0)[0][0, 0] == 6.0
