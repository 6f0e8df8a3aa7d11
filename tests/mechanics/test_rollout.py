from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError
from lgmpc.mechanics import torque_free_body
from lgmpc.mechanics.rollout import rollout, runge_kutta4


def gatherer() -> StageKernel:
    """x gathers p times the time at the beginning of each step."""
    time, step, x, p = (ca.SX.sym(name) for name in ("time", "step", "x", "p"))
    names = ["time", "step", "x", "p"]
    return StageKernel(ca.Function("gatherer", [time, step, x, p], [x + p * time], names, ["x_next"]))


@pytest.mark.parametrize(("steps", "every"), [(1, 1), (10, 5), (9000, 1500), (10000, 10000)])
def test_every_step_is_made_once_at_its_own_time(steps: int, every: int) -> None:
    times, rows = rollout(gatherer(), np.array([5.0]), 0.25, steps, every, np.array([2.0]))
    counts = every * np.arange(steps // every + 1)
    np.testing.assert_array_equal(times, 0.25 * counts)
    np.testing.assert_allclose(rows[:, 0], 5.0 + 2.0 * 0.25 * counts * (counts - 1) / 2, rtol=1e-12)


def test_interpreted_and_compiled_motions_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    inertia, spin = np.diag([1.0, 2.0, 2.5]), [0.3, -1.0, 0.5]
    compiled = torque_free_body(inertia).simulate(np.eye(3), spin, step=1e-2, steps=200)
    monkeypatch.setenv("LGMPC_JIT", "0")
    interpreted = torque_free_body(inertia).simulate(np.eye(3), spin, step=1e-2, steps=200)
    np.testing.assert_allclose(interpreted.poses, compiled.poses, atol=1e-13)


def test_runge_kutta_is_exact_on_cubics_in_time() -> None:
    assert float(runge_kutta4(lambda t, y: ca.DM(4.0 * t**3), ca.DM(1.0), 2.0)) == pytest.approx(17.0, rel=1e-15)


@pytest.mark.parametrize(
    ("step", "steps", "every", "name"),
    [(0.0, 1, 1, "step"), (1.0, 0, 1, "steps"), (1.0, 1e3, 1, "steps"), (1.0, 4, 3, "every"), (1.0, 4, 2.0, "every")],
)
def test_grids_that_cannot_be_are_refused(step: float, steps: int, every: int, name: str) -> None:
    with pytest.raises(InputError, match=f"{name}: got"):
        rollout(gatherer(), np.zeros(1), step, steps, every, np.zeros(1))
