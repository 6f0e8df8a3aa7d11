from __future__ import annotations

import ctypes
import gc
import shutil
import weakref
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from lgmpc.compile import BatchKernel, StageKernel, find_compiler
from lgmpc.compile.simd import generate_simd, is_scalar_code
from lgmpc.errors import InputError

needs_compiler = pytest.mark.skipif(
    all(shutil.which(name) is None for name in ("cc", "gcc", "clang")), reason="no C compiler is installed"
)


@pytest.fixture
def kernel() -> StageKernel:
    x, a = ca.SX.sym("x", 2), ca.SX.sym("a")
    m = ca.vertcat(ca.horzcat(x[0], 2 * x[1]), ca.horzcat(3 * a, x[0] * a))
    return StageKernel(ca.Function("kernel", [x, a], [ca.vertcat(x[1], x[0] + a), m], ["x", "a"], ["x_next", "m"]))


def test_stages_read_what_the_stage_before_wrote(kernel: StageKernel) -> None:
    xs, a, wide = np.zeros((6, 2)), np.array([0.5]), np.full((5, 7), 9.0)
    xs[0] = [1.0, 2.0]
    call = kernel.bind(5, x=xs[:-1], x_next=xs[1:], a=a, m=wide)
    assert call() == 0
    expected = [1.0, 2.0]
    for k in range(5):
        expected.append(expected[k] + 0.5)
        np.testing.assert_array_equal(xs[k], expected[k : k + 2])
        x0, x1 = xs[k]
        np.testing.assert_array_equal(wide[k, :4], [x0, 1.5, 2 * x1, 0.5 * x0])  # column after column
    assert (wide[:, 4:] == 9.0).all()
    a[0] = -1.0  # memory is read at every call
    call()
    assert xs[2, 1] == xs[1, 0] - 1.0


@pytest.mark.parametrize("jit", ["0", "1"])
def test_the_call_keeps_its_memory_alive(jit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", jit)
    x = ca.SX.sym("x")
    kernel = StageKernel(ca.Function("keeps", [x], [2 * x], ["x"], ["y"]))
    given, result = np.array([3.0]), np.zeros((4, 1))
    there = weakref.ref(given)
    call = kernel.bind(4, x=given, y=result)
    del given
    gc.collect()
    assert there() is not None
    call()
    assert (result == 6.0).all()


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("x", np.zeros((4, 2)), r"x: got float64 of shape \(4, 2\); expected float64 of shape \(5, 2\)"),
        ("x", np.zeros((5, 4))[:, ::2], "contiguous rows"),
        ("x", np.zeros((5, 2), dtype=np.float32), "x: got float32"),
        ("a", np.zeros(2), "a: got"),
        ("b", np.zeros(2), "Did you mean|one of its names"),
        ("m", None, "an array for 'm'"),
        ("m", np.broadcast_to(np.zeros(4), (5, 4)), "m: got a read-only array"),
    ],
)
def test_memory_that_does_not_fit_is_refused(kernel: StageKernel, name: str, array: object, message: str) -> None:
    memory = {"x": np.zeros((5, 2)), "x_next": np.zeros((5, 2)), "a": np.zeros(1), "m": np.zeros((5, 4))}
    memory[name] = array
    with pytest.raises(InputError, match=message):
        kernel.bind(5, **{key: value for key, value in memory.items() if value is not None})


# Lanes


def operations() -> ca.Function:
    """Every scalar operation that CasADi writes in C; results that are an input, a constant, a value read again."""
    x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p")
    one = (
        ca.exp, ca.log, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.sinh, ca.cosh, ca.tanh, ca.asinh,
        ca.acosh, ca.atanh, ca.expm1, ca.log1p, ca.erf, ca.floor, ca.ceil, ca.fabs, ca.sign, ca.logic_not,
    )  # fmt: skip
    two = (ca.fmod, ca.remainder, ca.copysign, ca.atan2, ca.hypot, ca.logic_and, ca.logic_or)
    unary = ca.vertcat(*(f(x) for f in one), -x, 1 / x, x * x, 2 * x, x**3.5, 0.1 * x, x + np.inf)
    binary = ca.vertcat(*(f(x, y) for f in two), x**y, x + y, x - y, x * y, x / y, x < y, x <= y, x == y, x != y)
    # No standard fixes the sign of the smaller of 0 and -0.
    limited = ca.vertcat(ca.fmin(x, y * y + 1), ca.fmax(x, -y * y - 1))
    mixed = ca.vertcat(limited, ca.if_else(x < y, p, y), x, 3.0, 0.0, unary[3] * binary[-8] + p)
    return ca.Function("operations", [x, y, p], [unary, binary, mixed], ["x", "y", "p"], ["unary", "binary", "mixed"])


def long_function() -> ca.Function:
    """More statements than one C function or one file gets, whose values are read far from where they are made."""
    x = ca.SX.sym("x", 6)
    first, values = ca.vertsplit(ca.sin(x)), ca.vertsplit(x)
    for k in range(2500):
        i, j = k % 6, (5 * k + 2) % 6
        values[i] = 0.7 * values[j] - values[i] * first[k % 5] + 0.1 * (x[k % 3] if k % 7 else values[(k + 3) % 6])
    m = ca.vertcat(*values) @ ca.vertcat(*first).T
    return ca.Function("long_function", [x], [m, ca.vertcat(*values), m @ x], ["x"], ["m", "values", "product"])


def everything(kernel: StageKernel, function: ca.Function, stages: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Results of all stages, in memory with one row more, for numbers that cover what floating point has."""
    given = [rng.normal(size=(stages, function.numel_in(i))) * 2 for i in range(function.n_in())]
    special = np.array([0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e-310, 2.5])
    for array in given:
        chosen = rng.random(array.shape) < 0.4
        array[chosen] = rng.choice(special, size=int(chosen.sum()))
    results = [np.full((stages + 1, function.numel_out(i)), 7.0) for i in range(function.n_out())]
    memory = dict(zip((*function.name_in(), *function.name_out()), (*given, *results), strict=True))
    assert kernel.bind(stages, **memory)() == 0
    return results


@pytest.mark.parametrize(
    ("make", "flags"),
    [(long_function, ""), *((operations, flags) for flags in ("", *(f"-DLANES={n}" for n in (1, 2, 8))))],
)
def test_lanes_give_the_same_bits_as_one_stage_after_the_other(make, flags: str, monkeypatch) -> None:
    monkeypatch.setenv("LGMPC_CFLAGS", flags)
    function = make()
    single, batch = StageKernel(function), BatchKernel(function)
    for stages in (1, 3, 8, 13):
        expected, got = (everything(k, function, stages, np.random.default_rng(stages)) for k in (single, batch))
        for name, one, other in zip(function.name_out(), expected, got, strict=True):
            # Bits, but of NaN, whose sign no standard fixes.
            same = (one.view(np.int64) == other.view(np.int64)) | (np.isnan(one) & np.isnan(other))
            assert same.all(), f"{name}: {np.argwhere(~same)[:5]}"
            assert (other[-1] == 7.0).all(), "the row behind the last stage"


@needs_compiler
def test_sines_and_angles_are_those_of_the_c_library_to_the_last_places() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    results = [ca.sin(x), ca.cos(x), ca.tan(x), ca.atan2(y, x)]
    kernel = BatchKernel(ca.Function("turned", [x, y], results, ["x", "y"], ["sin", "cos", "tan", "atan2"]))
    rng, n = np.random.default_rng(4), 4000
    multiples = 0.5 * np.pi * rng.integers(-300_000, 300_000, n)
    special = [0.0, -0.0, np.inf, -np.inf, np.nan, 1e-310, 1e300, -1e300, 524288.0, 1e9, -7e7, 0.25 * np.pi]
    ones, others = (a.ravel() for a in np.meshgrid(special, special))
    everywhere = rng.uniform(-5e5, 5e5, n)
    first = np.hstack([rng.normal(size=n), everywhere, multiples, 10.0 ** rng.uniform(-12, 0, n), ones])
    second = np.hstack([rng.normal(size=3 * n) * 10.0 ** rng.uniform(-9, 9, 3 * n), rng.normal(size=n), others])
    got = {name: np.zeros((first.size, 1)) for name in ("sin", "cos", "tan", "atan2")}
    kernel.bind(first.size, x=first[:, None], y=second[:, None], **got)()
    with np.errstate(invalid="ignore"):
        expected = {
            "sin": np.sin(first),
            "cos": np.cos(first),
            "tan": np.tan(first),
            "atan2": np.arctan2(second, first),
        }
    for name, reference in expected.items():
        mine, finite = got[name][:, 0], np.isfinite(reference)
        np.testing.assert_array_equal(np.isnan(mine), np.isnan(reference))
        assert (np.abs(mine - reference)[finite] <= 4.0 * np.spacing(np.abs(reference[finite]))).all(), name
    still = got["atan2"][:, 0][4 * n :]
    assert (np.signbit(still) == np.signbit(expected["atan2"][4 * n :]))[~np.isnan(still)].all()


def test_long_functions_are_cut_into_files() -> None:
    files = generate_simd(long_function())
    assert len(files) >= 2
    assert max(file.count("\n") for file in files) < 14_000


@needs_compiler
def test_the_processors_lanes_are_used(tmp_path: Path) -> None:
    compiler = find_compiler()
    files = generate_simd(operations())
    assert compiler is not None
    source = tmp_path / "lanes.c"
    source.write_text(files[0] + "\nEXPORT int lanes(void) { return LANES; }\n")
    compiler.build([source, *_written(tmp_path, files[1:])], tmp_path / "lanes.so", "lanes")
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    expected = 8 if "avx512f" in flags else 4 if " avx " in flags else 2
    assert ctypes.CDLL(str(tmp_path / "lanes.so")).lanes() == expected


def _written(folder: Path, files: tuple[str, ...]) -> list[Path]:
    paths = [folder / f"part{i}.c" for i in range(len(files))]
    for path, text in zip(paths, files, strict=True):
        path.write_text(text)
    return paths


def test_functions_that_are_no_list_of_scalar_operations_run_stage_by_stage() -> None:
    m, b = ca.MX.sym("m", 3, 3), ca.MX.sym("b", 3)
    function = ca.Function("solves", [m, b], [ca.solve(m + 9 * ca.MX.eye(3), b, "qr")], ["m", "b"], ["z"])
    assert not is_scalar_code(function)
    rng = np.random.default_rng(0)
    ms, bs, zs = rng.normal(size=(5, 9)), rng.normal(size=(5, 3)), np.zeros((5, 3))
    assert BatchKernel(function).bind(5, m=ms, b=bs, z=zs)() == 0
    for matrix, right, z in zip(ms, bs, zs, strict=True):
        np.testing.assert_allclose((matrix.reshape(3, 3).T + 9 * np.eye(3)) @ z, right, rtol=1e-12)


def test_a_batch_needs_results_of_its_own(kernel: StageKernel) -> None:
    batch, xs = BatchKernel(long_function()), np.zeros((6, 6))
    with pytest.raises(InputError, match="values: got memory of 'x'; expected memory of its own"):
        batch.bind(5, x=xs[:-1], m=np.zeros((5, 36)), values=xs[1:], product=np.zeros((5, 6)))


def test_lanes_are_interpreted_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = BatchKernel(long_function())
    monkeypatch.setenv("LGMPC_JIT", "0")
    interpreted = BatchKernel(long_function())
    assert compiled.compiled != interpreted.compiled or find_compiler() is None
    results = [everything(k, long_function(), 5, np.random.default_rng(1)) for k in (compiled, interpreted)]
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)  # the sines differ in the last place
