from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lgmpc.ocp import ShootingFunctions, ShootingProblem
from lgmpc.solvers.compiled_sweep import CompiledSweep, make_sweep
from lgmpc.solvers.sweep import BackwardSweep

Make = Callable[..., ShootingProblem]


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
@pytest.mark.parametrize("which", ["satellite", "unicycle"])
def test_machine_code_and_numpy_agree(satellite: Make, unicycle: ShootingProblem, which: str, closed: bool) -> None:
    functions = expanded(satellite(bounded=False) if which == "satellite" else unicycle)
    if closed:
        functions.gaps[...] = 0.0
    plain, compiled = BackwardSweep(functions), make_sweep(functions)
    assert isinstance(compiled, CompiledSweep)
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


@pytest.mark.parametrize("kind", [BackwardSweep, make_sweep])
def test_what_cannot_be_swept_is_reported(unicycle: ShootingProblem, kind: Callable[..., BackwardSweep]) -> None:
    functions = expanded(unicycle)
    sweep = kind(functions)
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
    assert type(make_sweep(ShootingFunctions(unicycle))) is BackwardSweep
