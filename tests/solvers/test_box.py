"""The sweep over boxes of controls, against a bounded least-squares problem in the controls alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from lgmpc.actions import Action
from lgmpc.ocp import ShootingFunctions, ShootingProblem
from lgmpc.solvers.box import BoxSweep

NODES, NX, NU = 8, 3, 2


def minimiser(f: ShootingFunctions, regularization: float) -> tuple[np.ndarray, np.ndarray]:
    """Steps of the controls (N, nu), and the model's slopes there, from its condensed form.

    The regularisation adds its half to the squares of all steps of states and controls.
    """
    size = NODES * NU
    moves = [(np.zeros((NX, size)), f.gaps[0])]  # of each state: by the controls, and by the gaps
    for k in range(NODES):
        a, b = f.jacobian[k, :NX].T, f.jacobian[k, NX:].T
        of_controls, of_gaps = a @ moves[k][0], a @ moves[k][1] + f.gaps[k + 1]
        of_controls[:, NU * k : NU * (k + 1)] += b
        moves.append((of_controls, of_gaps))
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    for k, (of_controls, of_gaps) in enumerate(moves):
        own = np.eye(size)[NU * k : NU * (k + 1)]
        step, fixed = np.vstack([of_controls, own]), np.concatenate([of_gaps, np.zeros(len(own))])
        h, g = (f.last_hessian, f.last_gradient) if k == NODES else (f.hessian[k], f.gradient[k])
        h = h + regularization * np.eye(len(h))
        hessian += step.T @ h @ step
        gradient += step.T @ (g + h @ fixed)
    root = np.linalg.cholesky(hessian).T
    bounds = (f.u_lower - f.us).ravel(), (f.u_upper - f.us).ravel()
    free = bounds[0] < bounds[1]
    step = np.where(free, 0.0, bounds[0])
    right = -np.linalg.solve(root.T, gradient) - root @ step
    found = lsq_linear(root[:, free], right, (bounds[0][free], bounds[1][free]), method="bvls", tol=1e-14)
    step[free] = found.x
    return step.reshape(NODES, NU), (gradient + hessian @ step).reshape(NODES, NU)


@pytest.mark.parametrize("kind", ["numpy", "compiled"])
@pytest.mark.parametrize("regularization", [1e-9, 0.5, 5.0, 20.0, 100.0])
@pytest.mark.parametrize("limit", [0.3, 0.4, 1.0])
def test_the_regularised_model_is_minimised_over_the_box(
    linear: Callable[..., Action], regularization: float, limit: float, kind: str
) -> None:
    """Some controls have no freedom at all; these count as held at their upper bound, whatever the slope."""
    rng = np.random.default_rng(6)
    action = linear(np.eye(NX) + 0.2 * rng.standard_normal((NX, NX)), rng.standard_normal((NX, NU)), np.zeros(NX))
    problem = ShootingProblem(action, NODES)
    problem.set("goal", rng.standard_normal((NODES + 1, NX)))
    problem.set("weight", 0.3)
    f = ShootingFunctions(problem)
    f.xs[1:] = rng.standard_normal((NODES, NX))
    f.us[...] = rng.uniform(-limit, limit, (NODES, NU))
    f.u_lower[...], f.u_upper[...] = -limit, limit
    f.u_lower[2:4] = f.u_upper[2:4] = f.us[2:4] + 0.05
    f.expand()
    f.compiled = kind == "compiled"
    sweep = BoxSweep(f)
    assert sweep.compiled is f.compiled
    step, slopes = minimiser(f, regularization)
    fixed = f.u_lower == f.u_upper
    assert (slopes[fixed] > 1e-3).any()  # down, away from the bound that they are held at
    expected = np.where(np.abs(slopes) > 1e-6, -np.sign(slopes), 0.0)
    assert {0, 1} <= set(np.abs(expected[~fixed]))
    for begin in (0, 1, -1):  # from no controls held, from all
        sweep.held[...] = begin
        assert sweep.run(regularization, closed=False)
        np.testing.assert_allclose(sweep.dus, step, atol=1e-9)
        assert (sweep.held[fixed] == 1).all()
        np.testing.assert_array_equal(sweep.held[~fixed], expected[~fixed])


def test_without_compiler_it_is_numpy(linear: Callable[..., Action], monkeypatch: pytest.MonkeyPatch) -> None:
    problem = ShootingProblem(linear(np.eye(NX), np.ones((NX, NU)), np.zeros(NX)), NODES)
    assert BoxSweep(ShootingFunctions(problem)).compiled
    monkeypatch.setenv("LGMPC_JIT", "0")
    assert not BoxSweep(ShootingFunctions(problem)).compiled
