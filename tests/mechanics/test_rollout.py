from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.mechanics import SO3, EulerPoincare, torque_free_body
from lgmpc.mechanics.euler_poincare import runge_kutta4

PUSHED = EulerPoincare(
    "pushed", SO3, lambda s: ca.sumsqr(s.velocity) / 2, body_force=lambda s: ca.vertcat(s.time, 0, 0)
)


@pytest.mark.parametrize(("steps", "every"), [(1, 1), (10, 5), (9000, 1500), (10000, 10000)])
def test_every_step_is_made_once_at_its_own_time(steps: int, every: int) -> None:
    """A torque that grows with time, about one axis: the velocity is ``t^2 / 2``."""
    motion = PUSHED.simulate(np.eye(3), np.zeros(3), step=1e-3, steps=steps, every=every)
    np.testing.assert_allclose(motion.times, 1e-3 * every * np.arange(steps // every + 1), rtol=1e-15)
    np.testing.assert_allclose(motion.velocities[:, 0], motion.times**2 / 2, rtol=1e-11)


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
        PUSHED.simulate(np.eye(3), np.zeros(3), step=step, steps=steps, every=every)
