"""Drift of integrators over 1000 s of a free rigid body (chapter 4.18)."""

import time
from dataclasses import dataclass

import numpy as np

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape, largest
from lgmpc.lie import so3
from lgmpc.mechanics import UP, EulerPoincare, Motion, heavy_top, integrators, torque_free_body
from lgmpc.typing import Array

DURATION = 1000.0
STEPS = (0.1, 0.2)
POINTS = 400
"""Number of points of a curve."""
ROUNDING = 1e-11
"""Bound of rounding errors: 1e4 steps of 1e-16 each, with a margin."""
_PLATE = Shape("box", (0.71, 0.5, 0.01))  # its moments of inertia are as 1 to 2 to 3
_METHODS = {
    "RK4 on matrix entries": integrators.matrix_runge_kutta,
    "RK4, projected": integrators.projected_runge_kutta,
    "discrete Euler-Poincare": integrators.discrete_euler_poincare,
    "discrete Moser-Veselov": integrators.moser_veselov,
}


@dataclass(frozen=True)
class _Drift:
    """The drift of one method.

    Attributes:
        method: its name.
        motion: the computed motion.
        energy: (n,) relative change of the energy.
        momentum: (n,) norm of the change of the spatial angular momentum over the initial norm; of its vertical
            component under gravity.
        orthogonality: (n,) Frobenius norm of ``R^T R - I``.
    """

    method: str
    motion: Motion
    energy: Array
    momentum: Array
    orthogonality: Array


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    body, spin = torque_free_body(np.diag([1.0, 2.0, 3.0])), np.array([1.0, 0.0, 0.8])
    begun = time.perf_counter()
    free = {h: _drifts(body, np.eye(3), spin, None, h) for h in STEPS}
    seconds = time.perf_counter() - begun
    # Lagrange's top, tilted by 0.4 rad: a quasi-periodic motion under gravity.
    top, tilt = heavy_top(np.diag([0.5, 0.5, 0.3]), np.array([0.0, 0.0, 0.3])), so3.exp(np.array([0.4, 0.0, 0.0]))
    start = tilt, np.array([0.3, -0.2, 6.0]), tilt.T @ UP
    heavy = {h: _drifts(top, *start, h) for h in (0.01, 0.02)}

    classic, projected, euler_poincare, moser = free[0.1]
    rows = [
        Row("energy lost by RK4, h = 0.1 s", 1.24e-5, -float(classic.energy[-1]), 0.01e-5),
        Row("energy lost by RK4, h = 0.2 s", 3.9e-4, -float(free[0.2][0].energy[-1]), 0.03e-4),
        Row("order of that loss", 5.0, _order(free[0.2][0], classic, last=True), 0.1),
        Row("orthogonality after projection", 0.0, largest(projected.orthogonality), 1e-14),
    ]
    for drift in (euler_poincare, moser):
        rows.append(Row(f"momentum drift, {drift.method}", 0.0, largest(drift.momentum), ROUNDING))
        rows.append(Row(f"orthogonality, {drift.method}", 0.0, largest(drift.orthogonality), ROUNDING))
    rows.append(Row("energy drift, discrete Moser-Veselov", 0.0, largest(moser.energy), ROUNDING))
    for index in (2, 3):
        coarse, fine = heavy[0.02][index], heavy[0.01][index]
        rows.append(Row(f"heavy top: order of the energy error, {fine.method}", 2.0, _order(coarse, fine), 0.1))
        growth = largest(fine.energy[-1000:]) / largest(fine.energy[: len(fine.energy) // 10])
        rows.append(Row(f"that error, last 10 s over first 100 s, {fine.method}", 1.0, growth, 0.2))
        rows.append(Row(f"heavy top: vertical momentum drift, {fine.method}", 0.0, largest(fine.momentum), 1e-10))

    shown = moser.motion
    return Outcome(
        tuple(rows),
        panels=(
            _panel("Free body, h = 0.1 s: energy", free[0.1], "energy"),
            _panel("Free body: spatial momentum", free[0.1], "momentum"),
            _panel("Free body: |R^T R - I|", free[0.1], "orthogonality"),
            _panel("Heavy top, h = 0.01 s: energy", heavy[0.01], "energy"),
        ),
        times=shown.times[:200],
        bodies=(Body("body", (_PLATE,), np.zeros((200, 3)), shown.poses[:200]),),
        remarks=(
            f"1000 s at h = 0.1 and 0.2 s with four methods: {seconds:.2f} s of elapsed time.",
            "Discrete Moser-Veselov conserves energy and momentum to rounding: the orbit is exact, its timing is not.",
            "Projection keeps RK4's matrices orthogonal; energy and momentum drift as before.",
        ),
    )


def _drifts(
    system: EulerPoincare, rotation: Array, velocity: Array, advected: Array | None, step: float
) -> list[_Drift]:
    drifts, steps = [], round(DURATION / step)
    for name, method in _METHODS.items():
        motion = system.simulate(rotation, velocity, advected, step=step, steps=steps, method=method)
        energy = system.energies(motion)
        # From the matrices without projection, so that they include the loss of orthogonality.
        momentum = np.einsum("nij,nj->ni", motion.poses, system.momenta(motion))
        kept = momentum if advected is None else momentum[:, 2:]
        lost = np.linalg.norm(kept - kept[0], axis=1) / np.linalg.norm(kept[0])
        defect = np.linalg.norm(np.swapaxes(motion.poses, 1, 2) @ motion.poses - np.eye(3), axis=(1, 2))
        drifts.append(_Drift(name, motion, (energy - energy[0]) / abs(energy[0]), lost, defect))
    return drifts


def _order(coarse: _Drift, fine: _Drift, last: bool = False) -> float:
    """Return the exponent of a law h^p for the energy's error, between a step and half of it."""
    errors = [abs(float(d.energy[-1])) if last else largest(d.energy) for d in (coarse, fine)]
    return float(np.log2(errors[0] / errors[1]))


def _panel(title: str, drifts: list[_Drift], quantity: str) -> Panel:
    curves = tuple(_curve(drift.method, drift.motion.times, getattr(drift, quantity)) for drift in drifts)
    return Panel(title, "time, s", "largest relative error so far", curves, log_x=True, log_y=True)


def _curve(label: str, times: Array, errors: Array) -> Curve:
    """Return the largest error so far, decimated; zeros are replaced by the unit of rounding."""
    worst = np.maximum.accumulate(np.abs(errors))
    rows = np.unique(np.geomspace(1, len(worst) - 1, POINTS).astype(int))
    return Curve(label, times[rows], np.maximum(worst[rows], 1e-17))
