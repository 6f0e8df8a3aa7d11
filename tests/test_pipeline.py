"""Functions in sequence, in lanes, and interpreted."""

from __future__ import annotations

import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from lgmpc.compile import BatchKernel, Pipeline, PipelineStep, reporting
from lgmpc.compile.simd import generate_simd
from lgmpc.errors import CompileError

needs_compiler = pytest.mark.skipif(
    all(shutil.which(name) is None for name in ("cc", "gcc", "clang")), reason="no C compiler is installed"
)


def solve_and_shift(shift: float = 1.0) -> Pipeline:
    """``x = A^-1 B`` for a lower triangular A (3, 3), column after column of B (3, 4), then ``A x + shift``."""
    a, column, whole = ca.SX.sym("a", 3, 3), ca.SX.sym("column", 3), ca.SX.sym("x", 3, 4)
    x0 = column[0] / a[0, 0]
    x1 = (column[1] - a[1, 0] * x0) / a[1, 1]
    x2 = (column[2] - a[2, 0] * x0 - a[2, 1] * x1) / a[2, 2]
    solve = ca.Function("lower", [a, column], [ca.vertcat(x0, x1, x2)])
    back = ca.Function("back", [a, whole], [ca.densify(ca.tril(a) @ whole + shift), ca.sum1(whole)])
    unused = ca.Function("unused", [a], [ca.sin(a)])
    steps = (
        PipelineStep(solve, ("a", "b"), ("x",), 4),
        PipelineStep(unused, ("a",), ("sines",)),
        PipelineStep(back, ("a", "x"), ("shifted", "sums")),
    )
    return Pipeline("solve_and_shift", {"a": 9, "b": 12}, steps, {"x": "x", "y": "shifted"})


@pytest.mark.parametrize("jit", ["0", "1"])
@pytest.mark.parametrize("stages", [1, 5, 8, 19])
def test_steps_read_what_others_wrote_column_after_column(
    jit: str, stages: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LGMPC_JIT", jit)
    rng = np.random.default_rng(stages)
    a = np.tril(rng.normal(size=(stages, 3, 3))) + 3 * np.eye(3)
    b = rng.normal(size=(stages, 3, 4))
    x, y = np.full((stages + 1, 12), 7.0), np.full((stages, 20), 7.0)
    kernel = BatchKernel(solve_and_shift())
    call = kernel.bind(
        stages, a=a.transpose(0, 2, 1).reshape(stages, 9), b=b.transpose(0, 2, 1).reshape(stages, 12), x=x, y=y
    )
    for _ in range(2):
        assert call() == 0
        for k in range(stages):
            np.testing.assert_allclose(x[k].reshape(4, 3).T, np.linalg.solve(a[k], b[k]), rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(y[:, :12].reshape(stages, 4, 3).transpose(0, 2, 1), b + 1.0, rtol=1e-13, atol=1e-13)
    assert (x[-1] == 7.0).all() and (y[:, 12:] == 7.0).all()


@needs_compiler
def test_any_number_of_lanes_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(11, 9)), rng.normal(size=(11, 12))
    found = []
    for flags in ("-DLANES=1", "-DLANES=2", "-DLANES=4", "-DLANES=8"):
        monkeypatch.setenv("LGMPC_CFLAGS", flags)
        x, y = np.zeros((11, 12)), np.zeros((11, 12))
        BatchKernel(solve_and_shift()).bind(11, a=a, b=b, x=x, y=y)()
        found.append((x, y))
    for x, y in found[1:]:
        np.testing.assert_array_equal(x, found[0][0])
        np.testing.assert_array_equal(y, found[0][1])


def test_steps_that_nothing_depends_on_are_left_out() -> None:
    assert [step.function.name() for step in solve_and_shift().steps] == ["lower", "back"]


@needs_compiler
def test_a_change_of_one_function_compiles_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "cache"))
    messages: list[str] = []
    BatchKernel(solve_and_shift(1.0))
    with reporting(messages.append):
        BatchKernel(solve_and_shift(2.0))
    assert any("'back'" in message for message in messages) and not any("'lower'" in message for message in messages)


def test_what_is_no_list_of_scalar_operations_has_no_lanes() -> None:
    m = ca.MX.sym("m", 3, 3)
    with pytest.raises(CompileError, match="not a list of scalar operations"):
        generate_simd(ca.Function("inverse", [m], [ca.inv(m)]))
