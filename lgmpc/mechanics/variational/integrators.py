r"""One step of each method, as a CasADi function from ``x`` and ``h`` (s) to ``x_next``, to be compiled.

The variational methods come from discrete Lagrangians (chapter 4.18): Moser and Veselov, "Discrete versions of some
classical integrable systems and factorization of matrix polynomials", Comm. Math. Phys. 139 (1991); Marsden, Pekarsky
and Shkoller, "Discrete Euler-Poincare and Lie-Poisson equations", Nonlinearity 12 (1999); Bou-Rabee and Marsden,
"Hamilton-Pontryagin integrators on Lie groups", Found. Comput. Math. 9 (2009); Lee, Leok and McClamroch, "Lie group
variational integrators for the full body problem", Comput. Methods Appl. Mech. Engrg. 196 (2007).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.mechanics.rigid_body import check_positive
from lgmpc.mechanics.rollout import Rollout
from lgmpc.mechanics.variational.system import GroupSystem, Trajectory
from lgmpc.typing import Array

__all__ = [
    "discrete_euler_poincare",
    "lie_runge_kutta",
    "matrix_runge_kutta",
    "moser_veselov",
    "simulate",
]

NEWTON_STEPS = 5
"""The first guess is off by O(h^2); the error squares with each step."""


def simulate(step: ca.Function, system: GroupSystem, start: Array, h: float, duration: float) -> Trajectory:
    """Return the motion over ``duration`` (s) in equal steps of about ``h`` (s), computed in one compiled call.

    Args:
        step: from one of this module's makers, for this system.
        system: what moves.
        start: (nx,) first state.
        h: step, s.
        duration: s.

    Raises:
        InputError: a step or duration that is not positive, or a start of another shape.
    """
    first = checks.finite("start", start)
    if first.shape != (system.nx,):
        raise InputError("start", f"shape {first.shape}", f"shape ({system.nx},)")
    steps = max(1, round(check_positive("duration", duration, "s") / check_positive("h", h, "s")))
    x, t, length, p = (ca.SX.sym(name, n) for name, n in (("x", system.nx), ("time", 1), ("step", 1), ("p", 0)))
    stage = ca.Function(step.name(), [t, length, x, p], [step(x, length)], ["time", "step", "x", "p"], ["x_next"])
    _, states = Rollout(stage)(first, duration / steps, steps, 1, np.zeros(0))
    return Trajectory(system, duration / steps, states)


def moser_veselov(system: GroupSystem) -> ca.Function:
    r"""Discrete Moser-Veselov on SO(3), with a potential (Lee, Leok and McClamroch 2007); second order.

    From ``L_d = tr((I - F) J_d) / h - h/2 (V + V+)``, ``R+ = R F``, ``J_d = tr(J)/2 I - J``:

        h hat(mu + h/2 F_k) = F J_d - J_d F^T,        mu+ = F^T (mu + h/2 F_k) + h/2 F_k+1

    The equation is for the rotation F itself. Newton's method solves it in the Cayley vector f of F, in which it is
    quadratic: ``(1 + f.f) h m = 2 (J f + f x J f)``. Rotations by pi in a step are out of reach. Without forces it
    keeps the spatial momentum and the energy, too, to rounding: it moves along the true orbit, at another pace.

    Raises:
        InputError: the system is not on SO(3), or has other forces than those of a potential.
    """
    if system.nv != 3 or system.wrench is not None:
        raise InputError("system", "another", "a body that turns, on SO(3), under no forces but a potential's")
    x, h = ca.SX.sym("x", system.nx), ca.SX.sym("h")
    rotation, mu = system.split(x)
    inertia = ca.DM(system.inertia)
    kicked = mu + h / 2 * system.force(rotation, ca.SX.zeros(3))
    goal = h * kicked

    f = system.velocity(goal) / 2
    for _ in range(NEWTON_STEPS):
        turned = inertia @ f
        residual = 2 * (turned + ca.cross(f, turned)) - (1 + ca.dot(f, f)) * goal
        slope = 2 * (inertia + ca.skew(f) @ inertia - ca.skew(turned)) - 2 * goal @ f.T
        f = f - _solve3(slope, residual)

    step = cayley(f)
    moved = rotation @ step
    mu_next = step.T @ kicked + h / 2 * system.force(moved, ca.SX.zeros(3))
    return _function("moser_veselov", system, x, h, moved, mu_next)


def cayley(f: Any) -> Any:
    """Return the rotation ``(I + hat(f)) (I - hat(f))^-1``, by ``2 atan |f|`` about f."""
    skew = ca.skew(f)
    return ca.DM.eye(3) + 2 / (1 + ca.dot(f, f)) * (skew + skew @ skew)


def discrete_euler_poincare(system: GroupSystem) -> ca.Function:
    r"""Discrete Euler-Poincare equations with the exponential as retraction (chapter 4.18); second order, symmetric.

    From ``L_d = h/2 xi . G xi - h/2 (V + V+)``, ``g+ = g exp(h xi)``, with forces at both ends (Lagrange-d'Alembert):

        Jl^-T(h xi) G xi = mu + h/2 F(g, xi),        mu+ = Ad^T_{exp(h xi)} (mu + h/2 F) + h/2 F(g+, xi)

    Jl the left Jacobian of the exponential; the first equation is solved for xi by Newton's method.
    """
    group, inertia = system.group, ca.DM(system.inertia)
    x, h = ca.SX.sym("x", system.nx), ca.SX.sym("h")
    g, mu = system.split(x)
    symbol = ca.SX.sym("xi", system.nv)
    residual = group.left_jacobian_inverse(h * symbol).T @ (inertia @ symbol) - mu - h / 2 * system.force(g, symbol)
    newton = symbol - ca.solve(ca.jacobian(residual, symbol), residual)
    improve = ca.Function("improve", [symbol, x, h], [newton])

    xi = system.velocity(mu)
    for _ in range(NEWTON_STEPS):
        xi = improve(xi, x, h)
    moved = group.exp(h * xi)
    kicked = mu + h / 2 * system.force(g, xi)
    g_next = group.compose(g, moved)
    mu_next = group.adjoint(moved).T @ kicked + h / 2 * system.force(g_next, xi)
    return _function("discrete_euler_poincare", system, x, h, g_next, mu_next)


def lie_runge_kutta(system: GroupSystem) -> ca.Function:
    """The classical fourth-order method, commutator-free on the group: accurate, but no symplectic map.

    Celledoni, Marthinsen and Owren, "Commutator-free Lie group methods", Future Generation Computer Systems 19 (2003).
    """
    group = system.group
    x, h = ca.SX.sym("x", system.nx), ca.SX.sym("h")
    g, mu = system.split(x)

    def move(element: Any, tangent: Any) -> Any:
        return group.compose(element, group.exp(tangent))

    v1, a1 = system.rate(g, mu)
    g2 = move(g, h / 2 * v1)
    v2, a2 = system.rate(g2, mu + h / 2 * a1)
    v3, a3 = system.rate(move(g, h / 2 * v2), mu + h / 2 * a2)
    v4, a4 = system.rate(move(g2, h * (v3 - v1 / 2)), mu + h * a3)
    halfway = move(g, h / 12 * (3 * v1 + 2 * v2 + 2 * v3 - v4))
    g_next = move(halfway, h / 12 * (-v1 + 2 * v2 + 2 * v3 + 3 * v4))
    return _function("lie_runge_kutta", system, x, h, g_next, mu + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))


def matrix_runge_kutta(system: GroupSystem, projected: bool = False) -> ca.Function:
    """The classical fourth-order method on the entries of the matrix g, as if they were numbers (chapter 4.14.2).

    Args:
        system: what moves.
        projected: whether the rotation is replaced after each step by the nearest one, the orthogonal polar factor
            (the product U V^T of its singular vectors); three Newton-Schulz iterations find it to rounding.
    """
    x, h = ca.SX.sym("x", system.nx), ca.SX.sym("h")

    def rate(state: Any) -> Any:
        g, mu = system.split(state)
        xi, force = system.rate(g, mu)
        return system.join(g @ system.group.hat(xi), force)

    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    g, mu = system.split(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    if projected:
        r = g[:3, :3]
        for _ in range(3):
            r = r @ (3 * ca.DM.eye(3) - r.T @ r) / 2
        g[:3, :3] = r
    return _function(f"matrix_runge_kutta{'_projected' if projected else ''}", system, x, h, g, mu)


def _function(name: str, system: GroupSystem, x: Any, h: Any, g: Any, mu: Any) -> ca.Function:
    return ca.Function(name, [x, h], [system.join(g, mu)], ["x", "h"], ["x_next"])


def _solve3(matrix: Any, right: Any) -> Any:
    """Return the solution of three equations, by Cramer's rule."""
    a, b, c = (matrix[:, i] for i in range(3))
    bc = ca.cross(b, c)
    return ca.vertcat(ca.dot(bc, right), ca.dot(ca.cross(c, a), right), ca.dot(ca.cross(a, b), right)) / ca.dot(a, bc)
