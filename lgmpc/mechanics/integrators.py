r"""Integrators of Euler-Poincare systems (chapter 4.18); ``lgmpc demo integrators`` compares their drifts.

    body = torque_free_body(np.diag([1.0, 2.0, 3.0]))
    motion = body.simulate(np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000, method=moser_veselov)

The variational ones follow from a discrete Hamilton's principle, for a system with ``l = 1/2 xi . G xi - U(a)``,
or with a potential V(g) in place of the advected a. Both conserve the momenta of Noether's theorem to rounding;
their energy error is bounded and of second order in the step. That of multibody robots is
:class:`lgmpc.actions.Variational`.

Moser and Veselov, "Discrete versions of some classical integrable systems and factorization of matrix polynomials",
Comm. Math. Phys. 139 (1991); Marsden, Pekarsky and Shkoller, "Discrete Euler-Poincare and Lie-Poisson equations",
Nonlinearity 12 (1999); Bobenko and Suris, "Discrete Lagrangian reduction, discrete Euler-Poincare equations, and
semidirect products", Lett. Math. Phys. 49 (1999), for advected quantities; Bou-Rabee and Marsden, "Hamilton-Pontryagin
integrators on Lie groups", Found. Comput. Math. 9 (2009); Lee, Leok and McClamroch, "Lie group variational integrators
for the full body problem", Comput. Methods Appl. Mech. Engrg. 196 (2007).
"""

from typing import Any

import casadi as ca

from lgmpc.errors import InputError
from lgmpc.mechanics.euler_poincare import EulerPoincare, Symbols, runge_kutta4, state_of

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
        system: on SO(3), without forces other than a potential's.

    Raises:
        InputError: another system.
    """
    if system.group.size != 3 or system.body_force is not None:
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
        InputError: the kinetic energy is not that of a constant metric.
    """
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
    """Return the classical fourth-order step on the entries of the pose, ignoring the group (chapter 4.18)."""
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
        advected = system.advected.act(group.compose(group.inverse(pose), s.pose), s.advected)
    return system.step("projected_runge_kutta", s, h, pose, velocity, advected)


def _by_entries(system: EulerPoincare, s: Symbols, h: Any) -> tuple[Any, Any, Any]:
    """Return pose, velocity and advected quantity after a step."""
    size, dim, group = system.group.size, system.group.dim, system.group.symbolic

    def parts(y: Any) -> tuple[Any, Any, Any]:
        return ca.reshape(y[: size * size], size, size), y[size * size : size * size + dim], y[size * size + dim :]

    def slope(elapsed: Any, y: Any) -> Any:
        pose, velocity, advected = parts(y)
        turned = pose @ group.hat(velocity)
        rate = system.acceleration(s.time + elapsed, pose, velocity, advected, s.parameters)
        return ca.vertcat(ca.vec(turned), rate, -system.generator(advected) @ velocity)

    return parts(runge_kutta4(slope, ca.vertcat(ca.vec(s.pose), s.velocity, s.advected), h))
