r"""Variational integrators, derived from a discrete Hamilton's principle (chapter 4.18).

For a left-reduced system with ``l = 1/2 xi . G xi - U(a)``, or with a potential V(g) in place of the advected a. Both
conserve the momenta of Noether's theorem to rounding; their energy error is bounded and of second order in the step.

Moser and Veselov, "Discrete versions of some classical integrable systems and factorization of matrix polynomials",
Comm. Math. Phys. 139 (1991); Marsden, Pekarsky and Shkoller, "Discrete Euler-Poincare and Lie-Poisson equations",
Nonlinearity 12 (1999); Bobenko and Suris, "Discrete Lagrangian reduction, discrete Euler-Poincare equations, and
semidirect products", Lett. Math. Phys. 49 (1999), for advected quantities; Bou-Rabee and Marsden, "Hamilton-Pontryagin
integrators on Lie groups", Found. Comput. Math. 9 (2009); Lee, Leok and McClamroch, "Lie group variational integrators
for the full body problem", Comput. Methods Appl. Mech. Engrg. 196 (2007).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.errors import InputError
from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare
from lgmpc.mechanics.reduction.terms import Symbols, state_of

__all__ = ["cayley", "discrete_euler_poincare", "moser_veselov"]

NEWTON_STEPS = 5
"""Number of Newton steps: the error of the first guess is O(h^2), and each step squares it."""


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

    step = cayley(f)
    pose, advected = s.pose @ step, s.advected
    if system.advected is not None:
        advected = system.advected.act(step.T, s.advected)
    momentum = step.T @ kicked + h / 2 * system.loads(s.time + h, pose, s.velocity, advected, s.parameters)
    return system.step("moser_veselov", s, h, pose, _solve3(inertia, momentum), advected)


def cayley(f: Any) -> Any:
    """Return the rotation ``(I + hat(f)) (I - hat(f))^-1``, by ``2 atan |f|`` about f."""
    skew = ca.skew(f)
    return ca.DM.eye(3) + 2 / (1 + ca.dot(f, f)) * (skew + skew @ skew)


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

    # Calls, not copies: one iteration is compiled once and called several times.
    inputs = ["xi", "time", "step", "x", "p"]
    arguments = [xi, s.time, h, s.state, s.parameters]
    improve = ca.Function("improve", arguments, [newton], inputs, ["xi_next"])
    finish = ca.Function("finish", arguments, [state_of(pose, velocity, advected)], inputs, ["x_next"])
    outer = [ca.MX.sym(name, *improve.size_in(name)) for name in inputs[1:]]
    found = outer[2][system.group.size**2 :][: system.group.dim]
    for _ in range(NEWTON_STEPS):
        found = improve(found, *outer)
    name = f"{system.name}_discrete_euler_poincare"
    return ca.Function(name, outer, [finish(found, *outer)], inputs[1:], ["x_next"])


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
