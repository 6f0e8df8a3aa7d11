from __future__ import annotations

import shutil
from dataclasses import dataclass

import numpy as np
import pytest

from lgmpc.ocp import ShootingFunctions, ShootingProblem
from lgmpc.solvers.sweep import BackwardSweep

needs_compiler = pytest.mark.skipif(
    all(shutil.which(name) is None for name in ("cc", "gcc", "clang")), reason="no C compiler is installed"
)


def expanded(problem: ShootingProblem) -> ShootingFunctions:
    rng = np.random.default_rng(0)
    functions = ShootingFunctions(problem)
    functions.xs[1:] = [
        problem.state.integrate(x, 0.3 * rng.standard_normal(problem.state.ndx)) for x in functions.xs[1:]
    ]
    functions.us[...] = rng.standard_normal(functions.us.shape)
    functions.expand()
    return functions


@pytest.mark.parametrize("closed", [True, False])
def test_machine_code_and_numpy_agree(unicycle: ShootingProblem, closed: bool) -> None:
    functions = expanded(unicycle)
    if closed:
        functions.gaps[...] = 0.0
    plain, compiled = in_numpy(functions), BackwardSweep(functions)
    assert compiled.compiled and not plain.compiled
    assert plain.run(1e-3, closed=closed)
    gains = functions.feedback.copy(), functions.feedforward.copy()
    functions.feedback[...] = functions.feedforward[...] = np.nan
    assert compiled.run(1e-3, closed=closed)
    np.testing.assert_allclose(functions.feedback, gains[0], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(functions.feedforward, gains[1], rtol=1e-9, atol=1e-11)
    for name in ("value_hessian", "value_gradient", "control_gradient"):
        scale = np.abs(getattr(plain, name)).max()
        np.testing.assert_allclose(
            getattr(compiled, name), getattr(plain, name), rtol=1e-9, atol=1e-12 * scale, err_msg=name
        )
    np.testing.assert_array_equal(compiled.value_hessian, compiled.value_hessian.transpose(0, 2, 1))


def in_numpy(functions: ShootingFunctions | Numbers) -> BackwardSweep:
    """The sweep on the same arrays without machine code."""
    given, functions.compiled = functions.compiled, False
    try:
        return BackwardSweep(functions)
    finally:
        functions.compiled = given


@dataclass
class Numbers:
    """An expansion of random numbers, whose Hessians are positive definite."""

    nodes: int
    ndx: int
    nu: int
    compiled: bool = True

    def __post_init__(self) -> None:
        rng, n, width = np.random.default_rng(0), self.nodes, self.ndx + self.nu
        roots = rng.standard_normal((n + 1, width, width))
        self.hessian = roots[:-1] @ roots[:-1].transpose(0, 2, 1) / width + np.eye(width)
        self.last_hessian = roots[-1, : self.ndx] @ roots[-1, : self.ndx].T
        self.jacobian = rng.standard_normal((n, width, self.ndx)) / np.sqrt(self.ndx)
        self.gradient, self.last_gradient = rng.standard_normal((n, width)), rng.standard_normal(self.ndx)
        self.gaps = rng.standard_normal((n + 1, self.ndx))
        self.feedback, self.feedforward = np.zeros((n, self.nu, self.ndx)), np.zeros((n, self.nu))


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize(("ndx", "nu"), [(1, 1), (3, 0), (2, 5), (8, 4), (13, 7), (36, 12), (29, 30)])
def test_machine_code_and_numpy_agree_at_any_size(ndx: int, nu: int, closed: bool) -> None:
    f = Numbers(6, ndx, nu)
    plain, compiled = in_numpy(f), BackwardSweep(f)
    results = []
    for sweep in (plain, compiled):
        assert sweep.run(1e-6, closed=closed)
        parts = (f.feedback, f.feedforward, sweep.value_hessian, sweep.value_gradient, sweep.control_gradient)
        results.append([part.copy() for part in parts])
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-11, atol=1e-11 * np.abs(one).max(initial=1.0))
    np.testing.assert_array_equal(compiled.value_hessian, compiled.value_hessian.transpose(0, 2, 1))


@needs_compiler
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("first", [0, 3, 5])
def test_a_sweep_continues_bit_for_bit(first: int, closed: bool) -> None:
    """From an interval behind which nothing has changed."""
    f = Numbers(6, 13, 7)
    sweep = BackwardSweep(f)
    assert sweep.compiled and sweep.run(1e-6, closed=closed)
    f.jacobian[: first + 1] *= 1.1
    f.hessian[: first + 1] *= 1.2
    f.gradient[: first + 1] += 0.3
    f.gaps[: first + 1] -= 0.4
    sweep.plan[2] = first
    assert sweep.run(1e-6, closed=closed)
    continued = [part.copy() for part in (f.feedback, f.feedforward, sweep.value_hessian, sweep.value_gradient)]
    sweep.plan[2] = 5
    f.feedback[...] = f.feedforward[...] = np.nan
    assert sweep.run(1e-6, closed=closed)
    whole = f.feedback, f.feedforward, sweep.value_hessian, sweep.value_gradient
    for one, other in zip(continued, whole, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_compiler
@pytest.mark.parametrize("flags", ["-DLANES=1", pytest.param("-DLANES=2", marks=pytest.mark.slow), "-DLANES=8"])
def test_any_number_of_lanes_gives_the_same_sweep(flags: str, monkeypatch: pytest.MonkeyPatch) -> None:
    f = Numbers(4, 13, 5)
    assert BackwardSweep(f).run(1e-6, closed=False)
    expected = f.feedback.copy()
    monkeypatch.setenv("LGMPC_CFLAGS", flags)
    assert BackwardSweep(f).run(1e-6, closed=False)
    np.testing.assert_allclose(f.feedback, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("kind", ["numpy", "compiled"])
def test_indefinite_and_non_finite_data_are_reported(unicycle: ShootingProblem, kind: str) -> None:
    functions = expanded(unicycle)
    sweep = in_numpy(functions) if kind == "numpy" else BackwardSweep(functions)
    functions.hessian[4, 3, 3] = -1e6
    assert not sweep.run(1e-9, closed=False)
    assert sweep.run(1e7, closed=False)  # regularisation is the remedy
    functions.hessian[4, 3, 3] = 1.0
    assert sweep.run(1e-9, closed=False)
    for array in (functions.jacobian, functions.gradient, functions.hessian):
        kept, array[7, 0] = array[7, 0].copy(), np.nan
        assert not sweep.run(1e-9, closed=False)
        array[7, 0] = kept
    assert sweep.run(1e-9, closed=False)


def test_without_compiler_it_is_numpy(unicycle: ShootingProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    assert not BackwardSweep(ShootingFunctions(unicycle)).compiled
