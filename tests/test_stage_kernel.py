from __future__ import annotations

import gc
import weakref

import casadi as ca
import numpy as np
import pytest

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError


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
    ],
)
def test_memory_that_does_not_fit_is_refused(kernel: StageKernel, name: str, array: object, message: str) -> None:
    memory = {"x": np.zeros((5, 2)), "x_next": np.zeros((5, 2)), "a": np.zeros(1), "m": np.zeros((5, 4))}
    memory[name] = array
    with pytest.raises(InputError, match=message):
        kernel.bind(5, **{key: value for key, value in memory.items() if value is not None})
