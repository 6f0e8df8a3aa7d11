"""Comparison of the drifts of conserved quantities among integrators (chapter 4.18)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.integrators.runge_kutta import matrix_runge_kutta, projected_runge_kutta
from lgmpc.mechanics.integrators.variational import discrete_euler_poincare, moser_veselov
from lgmpc.mechanics.reduction.euler_poincare import LeftEulerPoincare, Method
from lgmpc.mechanics.reduction.terms import Motion
from lgmpc.typing import Array

__all__ = ["Drift", "compare_integrators", "drift_table"]

_METHODS: dict[str, Method] = {
    "RK4 on matrix entries": matrix_runge_kutta,
    "RK4, projected": projected_runge_kutta,
    "discrete Euler-Poincare": discrete_euler_poincare,
    "discrete Moser-Veselov": moser_veselov,
}


@dataclass(frozen=True)
class Drift:
    """The drift of one method.

    Attributes:
        method: its name.
        motion: the computed motion.
        energy: (n,) relative change of the energy; the change (J) if the initial energy is 0.
        momentum: (n,) norm of the change of the spatial angular momentum over the initial norm; of its vertical
            component under gravity.
        orthogonality: (n,) Frobenius norm of ``R^T R - I``.
        seconds: elapsed time, s, including compilation at the first call.
    """

    method: str
    motion: Motion
    energy: Array
    momentum: Array
    orthogonality: Array
    seconds: float


def compare_integrators(
    system: LeftEulerPoincare,
    rotation: Array,
    velocity: Array,
    advected: Array | None = None,
    *,
    step: float,
    steps: int,
) -> tuple[Drift, ...]:
    """Return the drifts of RK4 on matrix entries, RK4 with projection, discrete Euler-Poincare and Moser-Veselov.

    Args:
        system: on SO(3): free, or under gravity, which is invariant under rotations about the vertical.
        rotation: (3, 3) at the start.
        velocity: (3,) body angular velocity at the start, rad/s.
        advected: (m,) at the start, if the system has advected quantities.
        step: s.
        steps: their number.

    Raises:
        InputError: a system on another group, or as for :meth:`~lgmpc.mechanics.EulerPoincare.simulate`.
    """
    if system.group.size != 3:
        raise InputError("system", f"on {system.group.name}", "a body that turns, on SO(3)")
    drifts = []
    for name, method in _METHODS.items():
        begun = time.perf_counter()
        motion = system.simulate(rotation, velocity, advected, step=step, steps=steps, method=method)
        drifts.append(_measure(name, system, motion, time.perf_counter() - begun))
    return tuple(drifts)


def _measure(name: str, system: LeftEulerPoincare, motion: Motion, seconds: float) -> Drift:
    energy = system.energies(motion)
    # From the matrices without projection, so that they include the loss of orthogonality.
    momentum = np.einsum("nij,nj->ni", motion.poses, system.momenta(motion))
    kept = momentum if system.advected is None and system.potential is None else momentum[:, 2:]
    change = (energy - energy[0]) / (abs(energy[0]) or 1.0)
    lost = np.linalg.norm(kept - kept[0], axis=1) / (float(np.linalg.norm(kept[0])) or 1.0)
    defect: Array = np.linalg.norm(np.swapaxes(motion.poses, 1, 2) @ motion.poses - np.eye(3), axis=(1, 2))
    return Drift(name, motion, change, lost, defect, seconds)


def drift_table(drifts: tuple[Drift, ...]) -> str:
    """Return a table of the largest deviations, one line a method."""
    lines = [f"{'method':<26}{'energy':>12}{'momentum':>12}{'|R^T R - I|':>14}{'seconds':>10}"]
    for drift in drifts:
        worst = (float(np.abs(values).max()) for values in (drift.energy, drift.momentum, drift.orthogonality))
        energy, momentum, orthogonality = worst
        lines.append(f"{drift.method:<26}{energy:>12.2e}{momentum:>12.2e}{orthogonality:>14.2e}{drift.seconds:>10.3f}")
    return "\n".join(lines)
