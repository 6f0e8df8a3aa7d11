r"""Integrators of Euler-Poincare systems and a comparison of their drifts (chapter 4.18).

    body = torque_free_body(np.diag([1.0, 2.0, 3.0]))
    motion = body.simulate(np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000, method=moser_veselov)
    print(drift_table(compare_integrators(body, np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000)))

The variational ones follow from a discrete Hamilton's principle, for a left-reduced system with ``l = 1/2 xi . G xi -
U(a)``, or with a potential V(g) in place of the advected a. Both conserve the momenta of Noether's theorem to rounding;
their energy error is bounded and of second order in the step. That of multibody robots is
:class:`lgmpc.actions.Variational`.

Moser and Veselov, "Discrete versions of some classical integrable systems and factorization of matrix polynomials",
Comm. Math. Phys. 139 (1991); Marsden, Pekarsky and Shkoller, "Discrete Euler-Poincare and Lie-Poisson equations",
Nonlinearity 12 (1999); Bobenko and Suris, "Discrete Lagrangian reduction, discrete Euler-Poincare equations, and
semidirect products", Lett. Math. Phys. 49 (1999), for advected quantities; Bou-Rabee and Marsden, "Hamilton-Pontryagin
integrators on Lie groups", Found. Comput. Math. 9 (2009); Lee, Leok and McClamroch, "Lie group variational integrators
for the full body problem", Comput. Methods Appl. Mech. Engrg. 196 (2007).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.mechanics.euler_poincare import EulerPoincare, LeftEulerPoincare, Method, Motion, Symbols, state_of
from lgmpc.mechanics.rollout import runge_kutta4
from lgmpc.typing import Array

__all__ = [
    "Drift",
    "compare_integrators",
    "discrete_euler_poincare",
    "drift_table",
    "matrix_runge_kutta",
    "moser_veselov",
    "projected_runge_kutta",
]

NEWTON_STEPS = 5
"""Number of Newton steps: the error of the first guess is O(h^2), and each step squares it."""

_PROJECTIONS = 3
"""Number of Newton-Schulz iterations, which converge quadratically."""


def moser_veselov(system: EulerPoincare) -> ca.Function:
    r"""Discrete Moser-Veselov on SO(3), with a potential (Lee, Leok and McClamroch 2007); second order.

    From ``L_d = tr((I - F) J_d) / h - h/2 (V + V+)``, ``R+ = R F``, ``J_d = tr(J)/2 I - J``:

        h hat(mu + h/2 F_k) = F J_d - J_d F^T,        mu+ = F^T (mu + h/2 F_k) + h/2 F_k+1

    The equation is for the rotation F itself. Newton's method solves it in the Cayley vector f of F, in which it is
    quadratic: ``(1 + f.f) h m = 2 (J f + f x J f)``. A step cannot rotate by pi. Without forces it conserves
    the spatial momentum and also the energy to rounding: the orbit is exact, the time along it is not.

    Args:
        system: left-reduced, on SO(3), without forces other than a potential's.

    Raises:
        InputError: another system.
    """
    if system.group.size != 3 or system.body_force is not None or system.spatial_force is not None:
        raise InputError("system", "another", "a body that turns, on SO(3), under no forces but a potential's")
    s, h = system.symbols(), ca.SX.sym("step")
    inertia = _inertia(system, s)
    kicked = inertia @ s.velocity + h / 2 * system.loads(s.time, s.pose, s.velocity, s.advected, s.parameters)
    goal = h * kicked

    f = _solve3(inertia, goal) / 2
    for _ in range(NEWTON_STEPS):
        turned = inertia @ f
        residual = 2 * (turned + ca.cross(f, turned)) - (1 + ca.dot(f, f)) * goal
        slope = 2 * (inertia + ca.skew(f) @ inertia - ca.skew(turned)) - 2 * goal @ f.T
        f = f - _solve3(slope, residual)

    skew = ca.skew(f)
    step = ca.DM.eye(3) + 2 / (1 + ca.dot(f, f)) * (skew + skew @ skew)  # by 2 atan |f| about f
    pose, advected = s.pose @ step, s.advected
    if system.advected is not None:
        advected = system.advected.act(step.T, s.advected)
    momentum = step.T @ kicked + h / 2 * system.loads(s.time + h, pose, s.velocity, advected, s.parameters)
    return system.step("moser_veselov", s, h, pose, _solve3(inertia, momentum), advected)


def discrete_euler_poincare(system: EulerPoincare) -> ca.Function:
    r"""Discrete Euler-Poincare equations with the exponential as retraction; second order, symmetric.

    From ``L_d = h/2 xi . G xi - h/2 (U + U+)``, ``g+ = g exp(h xi)``, with forces at both ends (Lagrange-d'Alembert):

        Jl^-T(h xi) G xi = mu + h/2 F(g, xi),        mu+ = Ad^T_{exp(h xi)} (mu + h/2 F) + h/2 F(g+, xi)

    Jl the left Jacobian of the exponential; the first equation is solved for xi by Newton's method.

    Args:
        system: left-reduced.

    Raises:
        InputError: another system.
    """
    s, h, group = system.symbols(), ca.SX.sym("step"), system.group.symbolic
    inertia, xi = _inertia(system, s), ca.SX.sym("xi", system.group.dim)
    half = h / 2 * system.loads(s.time, s.pose, xi, s.advected, s.parameters)
    mu = inertia @ s.velocity + half
    residual = group.left_jacobian_inverse(h * xi).T @ (inertia @ xi) - mu
    newton = xi - ca.solve(ca.jacobian(residual, xi), residual)

    turned = group.exp(h * xi)
    pose, advected = group.compose(s.pose, turned), system.carry(s.advected, h * xi)
    momentum = group.adjoint(turned).T @ mu + h / 2 * system.loads(s.time + h, pose, xi, advected, s.parameters)
    velocity = ca.ldl_solve(momentum, *ca.ldl(inertia))

    arguments = [s.time, h, s.state, s.parameters]
    improve = ca.Function("improve", [xi, *arguments], [newton])
    finish = ca.Function("finish", [xi, *arguments], [state_of(pose, velocity, advected)])
    found = s.velocity
    for _ in range(NEWTON_STEPS):
        found = improve(found, *arguments)
    name = f"{system.name}_discrete_euler_poincare"
    return ca.Function(name, arguments, [finish(found, *arguments)], ["time", "step", "x", "p"], ["x_next"])


def _inertia(system: EulerPoincare, s: Symbols) -> Any:
    """Return (dim, dim) G.

    Raises:
        InputError: the system is reduced from the right, or its kinetic energy is not that of a constant metric.
    """
    if system.sign < 0:
        raise InputError("system", "one that is reduced from the right", "one that is reduced from the left")
    momentum = ca.gradient(system.reduced(s), s.velocity)
    metric = ca.densify(ca.jacobian(momentum, s.velocity))
    rest = ca.substitute(momentum, s.velocity, 0)
    state = ca.vertcat(s.velocity, s.advected)
    if ca.depends_on(metric, state) or not ca.simplify(rest).is_zero():
        raise InputError("system", "another Lagrangian", "l = 1/2 xi . G xi - U(advected), with a constant G")
    return metric


def _solve3(matrix: Any, right: Any) -> Any:
    """Return the solution of three linear equations by Cramer's rule."""
    a, b, c = (matrix[:, i] for i in range(3))
    bc = ca.cross(b, c)
    return ca.vertcat(ca.dot(bc, right), ca.dot(ca.cross(c, a), right), ca.dot(ca.cross(a, b), right)) / ca.dot(a, bc)


def matrix_runge_kutta(system: EulerPoincare) -> ca.Function:
    """Return the classical fourth-order step on the entries of the pose, ignoring the group (chapter 4.18).

    Args:
        system: any.
    """
    s, h = system.symbols(), ca.SX.sym("step")
    return system.step("matrix_runge_kutta", s, h, *_by_entries(system, s, h))


def projected_runge_kutta(system: EulerPoincare) -> ca.Function:
    """Return the same step with the rotation projected to the nearest one (chapter 4.18, "SVD projection").

    The nearest rotation is the orthogonal polar factor, the product U V^T of the singular vectors, computed to rounding
    by Newton-Schulz iterations. The advected quantity follows from the poses.

    Args:
        system: on a group whose elements begin with a rotation.
    """
    s, h, group = system.symbols(), ca.SX.sym("step"), system.group.symbolic
    pose, velocity, _ = _by_entries(system, s, h)
    rotation = pose[:3, :3]
    for _ in range(_PROJECTIONS):
        rotation = rotation @ (3 * ca.DM.eye(3) - rotation.T @ rotation) / 2
    pose[:3, :3] = rotation
    advected = s.advected
    if system.advected is not None:
        back = group.inverse(pose)
        moved = group.compose(back, s.pose) if system.sign > 0 else group.compose(pose, group.inverse(s.pose))
        advected = system.advected.act(moved, s.advected)
    return system.step("projected_runge_kutta", s, h, pose, velocity, advected)


def _by_entries(system: EulerPoincare, s: Symbols, h: Any) -> tuple[Any, Any, Any]:
    """Return pose, velocity and advected quantity after a step."""
    size, dim, group = system.group.size, system.group.dim, system.group.symbolic

    def parts(y: Any) -> tuple[Any, Any, Any]:
        return ca.reshape(y[: size * size], size, size), y[size * size : size * size + dim], y[size * size + dim :]

    def slope(elapsed: Any, y: Any) -> Any:
        pose, velocity, advected = parts(y)
        hat = group.hat(velocity)
        turned = pose @ hat if system.sign > 0 else hat @ pose
        rate = system.acceleration(s.time + elapsed, pose, velocity, advected, s.parameters)
        return ca.vertcat(ca.vec(turned), rate, -system.sign * system.generator(advected) @ velocity)

    return parts(runge_kutta4(slope, ca.vertcat(ca.vec(s.pose), s.velocity, s.advected), h))


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
