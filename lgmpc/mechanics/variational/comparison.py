"""What each integrator loses of what the motion keeps, measured (chapter 4.14.2)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.variational.integrators import (
    discrete_euler_poincare,
    matrix_runge_kutta,
    moser_veselov,
    simulate,
)
from lgmpc.mechanics.variational.system import GroupSystem, Trajectory
from lgmpc.typing import Array

__all__ = ["Drift", "compare_integrators", "drift_table"]

_METHODS = {
    "RK4 on matrix entries": matrix_runge_kutta,
    "RK4, projected": lambda system: matrix_runge_kutta(system, projected=True),
    "discrete Euler-Poincare": discrete_euler_poincare,
    "discrete Moser-Veselov": moser_veselov,
}


@dataclass(frozen=True)
class Drift:
    """How far one method strays.

    Attributes:
        method: its name.
        trajectory: what it computed.
        energy: (n,) energy over its first value, less 1; a plain difference (J) where that is 0.
        momentum: (n,) norm of the change of the spatial angular momentum over that of its first value; of its vertical
            part alone where a potential breaks the rest of the symmetry.
        orthogonality: (n,) Frobenius norm of ``R^T R - I``.
        seconds: that it took.
    """

    method: str
    trajectory: Trajectory
    energy: Array
    momentum: Array
    orthogonality: Array
    seconds: float


def compare_integrators(system: GroupSystem, start: Array, h: float, duration: float) -> tuple[Drift, ...]:
    """Run RK4 on matrix entries, RK4 with projection, discrete Euler-Poincare and discrete Moser-Veselov alike.

    Args:
        system: on SO(3), free or with a potential that a turn about the vertical does not change.
        start: (nx,) first state.
        h: step, s.
        duration: s.

    Raises:
        InputError: a system on another group, or steps and durations that are not positive.
    """
    if system.nv != 3:
        raise InputError("system", f"of dimension {system.nv}", "a body that turns, on SO(3)")
    return tuple(_run(name, make(system), system, start, h, duration) for name, make in _METHODS.items())


def _run(name: str, step: ca.Function, system: GroupSystem, start: Array, h: float, duration: float) -> Drift:
    begun = time.perf_counter()
    trajectory = simulate(step, system, start, h, duration)
    seconds = time.perf_counter() - begun
    energy, momentum = trajectory.energy(), trajectory.spatial_momentum()
    kept = momentum if system.potential is None else momentum[:, 2:]
    scale = float(np.linalg.norm(kept[0])) or 1.0
    change = (energy - energy[0]) / (abs(energy[0]) or 1.0)
    lost = np.linalg.norm(kept - kept[0], axis=1) / scale
    return Drift(name, trajectory, change, lost, trajectory.orthogonality(), seconds)


def drift_table(drifts: tuple[Drift, ...]) -> str:
    """Return a table of the largest deviations, one line a method."""
    lines = [f"{'method':<26}{'energy':>12}{'momentum':>12}{'|R^T R - I|':>14}{'seconds':>10}"]
    for drift in drifts:
        worst = (float(np.abs(values).max()) for values in (drift.energy, drift.momentum, drift.orthogonality))
        energy, momentum, orthogonality = worst
        lines.append(f"{drift.method:<26}{energy:>12.2e}{momentum:>12.2e}{orthogonality:>14.2e}{drift.seconds:>10.3f}")
    return "\n".join(lines)
