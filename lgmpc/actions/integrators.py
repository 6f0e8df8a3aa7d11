"""Integration of accelerations to the next state, on the configuration's group; robots' variational integrator."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.dynamics import Dynamics, DynamicsSolution, FreeForwardDynamics
from lgmpc.actions.implicit import Unknowns
from lgmpc.errors import InputError
from lgmpc.lie.symbolic import se3, so3
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state.configuration import BlockKind, configuration_blocks
from lgmpc.typing import instance


class Integrator(ABC):
    """One step of an integration method."""

    @abstractmethod
    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, DynamicsSolution]:
        """Return the state (nx,) after ``values["duration"]``, and the motion at its beginning."""

    def move(self, v: Any, v_next: Any, values: Mapping[str, Any]) -> Any:
        """Return m of ``x_next = x (+) m``, as a function of both velocities; None if a step is not one such motion."""
        return None


class SemiImplicitEuler(Integrator):
    """``v+ = v + h a,  q+ = q (+) h v+``: first order, as Crocoddyl's IntegratedActionModelEuler."""

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, DynamicsSolution]:
        """Return the state after the step, and the motion at its beginning."""
        h = values["duration"]
        motion = dynamics.motion(q, v, u, values, unknowns)
        v_next = v + h * motion.a
        return ca.vertcat(dynamics.robot.integrate(q, h * v_next), v_next), motion

    def move(self, v: Any, v_next: Any, values: Mapping[str, Any]) -> Any:
        """Return ``(h v+, v+ - v)``."""
        return ca.vertcat(values["duration"] * v_next, v_next - v)


class RungeKutta4(Integrator):
    """The classical fourth-order method, commutator-free on the configuration's group.

    The configuration moves by two exponentials a step; the compiled stage is about four times as large as with the
    semi-implicit Euler method. Celledoni, Marthinsen, Owren, "Commutator-free Lie group methods", Future Generation
    Computer Systems 19 (2003), here for velocities in the body frame.
    """

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, DynamicsSolution]:
        """Return the state after the step, and the motion at its beginning."""
        h, move = values["duration"], dynamics.robot.integrate
        first = dynamics.motion(q, v, u, values, unknowns)
        v2, q2 = v + h / 2 * first.a, move(q, h / 2 * v)
        a2 = dynamics.motion(q2, v2, u, values, unknowns).a
        v3, q3 = v + h / 2 * a2, move(q, h / 2 * v2)
        a3 = dynamics.motion(q3, v3, u, values, unknowns).a
        v4, q4 = v + h * a3, move(q2, h * (v3 - v / 2))
        a4 = dynamics.motion(q4, v4, u, values, unknowns).a
        halfway = move(q, h / 12 * (3 * v + 2 * v2 + 2 * v3 - v4))
        q_next = move(halfway, h / 12 * (-v + 2 * v2 + 2 * v3 + 3 * v4))
        return ca.vertcat(q_next, v + h / 6 * (first.a + 2 * a2 + 2 * a3 + a4)), first


_GROUPS: dict[BlockKind, Any] = {BlockKind.ROTATION: so3, BlockKind.PLACEMENT: se3}


class Variational(Integrator):
    r"""Lie-group variational integrator of a robot without contacts: second order, conserves momentum maps to rounding.

    From the discrete Lagrangian

        L_d = h T(q (+) h/2 xi, xi) - h/2 (V(q) + V(q+)),        q+ = q (+) h xi

    with the kinetic energy at the midpoint, where xi is the constant velocity between the two configurations.
    With M(q) the mass matrix, C the derivative of T by the midpoint and F the generalised force, gravity included, the
    discrete Lagrange-d'Alembert equations are, for momenta p = M v and ``x = h xi``,

        Jl(x)^-T (M xi - h/2 Jl(x/2)^T C) = p + h/2 F(q, xi)
        p+ = Jr(x)^-T (M xi + h/2 Jr(x/2)^T C) + h/2 F(q+, xi)

    Jl and Jr are the left and right Jacobians of the exponential of each joint's group: identities for angles. The
    first equation is solved for xi and differentiated implicitly. For one rigid body C is zero, and the method that of
    Lee, Leok and McClamroch (2007) and Bou-Rabee and Marsden (2009); for robots see Marsden and West, "Discrete
    mechanics and variational integrators", Acta Numerica 10 (2001), and Johnson and Murphey, "Scalable variational
    integrators for constrained mechanical systems in generalized coordinates", IEEE T-RO 25 (2009).

    Args:
        iterations: of Newton's method with the Jacobian fixed at the initial guess ``v + h/2 a``, whose error is of
            order h^2; each iteration multiplies the error by a factor of order h^3.
    """

    def __init__(self, iterations: int = 4) -> None:
        instance("iterations", iterations, (int, np.integer), "a whole number")
        if iterations < 1:
            raise InputError("iterations", iterations, "at least one")
        self.iterations = iterations

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, DynamicsSolution]:
        """Return the state after the step, and the motion at its beginning.

        Raises:
            InputError: the dynamics has contacts.
        """
        if not isinstance(dynamics, FreeForwardDynamics):
            raise InputError("integrator", "Variational", "one for contacts (SemiImplicitEuler, RungeKutta4)")
        robot, h = dynamics.robot, values["duration"]
        groups = _Groups(robot)
        midpoint = _midpoint(robot)
        motion = dynamics.motion(q, v, u, values, unknowns)
        momentum = robot.crba(q) @ v

        def force(here: Any, xi: Any) -> Any:
            return dynamics.forces(xi, u, values) - robot.gravity(here)

        def residual(xi: Any) -> Any:
            moved, pull = midpoint(robot.integrate(q, h / 2 * xi), xi)
            inner = moved - h / 2 * groups.left(h / 2 * xi, pull)
            return groups.left_inverse(h * xi, inner) - momentum - h / 2 * force(q, xi)

        symbol = ca.SX.sym("xi", robot.nv)
        slope = ca.jacobian(residual(symbol), symbol)

        def solver_at(xi: Any) -> Callable[[Any], Any]:
            return _Elimination(ca.substitute(slope, symbol, xi)).solve

        xi = v + h / 2 * motion.a
        solve = solver_at(xi)
        for _ in range(self.iterations):
            xi = xi - solve(residual(xi))
        found = xi
        xi = unknowns.define(found, residual, lambda right: solver_at(found)(right))

        # Jl^-T M xi by the first equation, not by evaluation: the base's momentum is then conserved to rounding.
        x, q_next = h * xi, robot.integrate(q, h * xi)
        pull = midpoint(robot.integrate(q, x / 2), xi)[1]
        before = momentum + h / 2 * force(q, xi) + h / 2 * groups.left_inverse(x, groups.left(x / 2, pull))
        after = groups.carried(x, before) + h / 2 * groups.right_inverse(x, groups.right(x / 2, pull))
        return ca.vertcat(q_next, robot.mass_factor(q_next).solve(after + h / 2 * force(q_next, xi))), motion


def _midpoint(robot: SymbolicModel) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return the function from (q, xi) to the momentum ``M xi`` and the derivative (nv,) of T by q."""
    q, xi, step = ca.SX.sym("q", robot.nq), ca.SX.sym("xi", robot.nv), ca.SX.sym("step", robot.nv)
    momentum = robot.crba(q) @ xi
    tangent = ca.substitute(ca.jacobian(robot.integrate(q, step), step), step, ca.SX.zeros(robot.nv))
    pull = tangent.T @ ca.jacobian(0.5 * ca.dot(xi, momentum), q).T

    def evaluate(at: Any, speed: Any) -> tuple[Any, Any]:
        first, second = ca.substitute([momentum, pull], [q, xi], [at, speed])
        return first, second

    return evaluate


class _Groups:
    """The transposed Jacobians of the exponential of a configuration's group, joint by joint; identities for angles."""

    def __init__(self, robot: SymbolicModel) -> None:
        blocks = configuration_blocks(robot.model)
        self._blocks = [(block.v, _GROUPS.get(block.kind)) for block in blocks]

    def left(self, x: Any, covector: Any) -> Any:
        """Return ``Jl(x)^T covector``."""
        return self._each(x, covector, lambda group, part: group.left_jacobian(part))

    def right(self, x: Any, covector: Any) -> Any:
        """Return ``Jr(x)^T covector``."""
        return self._each(x, covector, lambda group, part: group.right_jacobian(part))

    def left_inverse(self, x: Any, covector: Any) -> Any:
        """Return ``Jl(x)^-T covector``."""
        return self._each(x, covector, lambda group, part: group.left_jacobian_inverse(part))

    def right_inverse(self, x: Any, covector: Any) -> Any:
        """Return ``Jr(x)^-T covector``."""
        return self._each(x, covector, lambda group, part: group.right_jacobian_inverse(part))

    def carried(self, x: Any, covector: Any) -> Any:
        """Return ``Ad^T_{exp(x)} covector``: a momentum in the frame displaced by exp(x)."""
        return self._each(x, covector, lambda group, part: group.adjoint(group.exp(part)))

    def _each(self, x: Any, covector: Any, matrix: Callable[[Any, Any], Any]) -> Any:
        parts = []
        for v, group in self._blocks:
            part = covector[v]
            moved = group is not None and part.nnz() > 0  # a free base has none: T does not depend on its placement
            parts.append(matrix(group, x[v]).T @ part if moved else part)
        return ca.vertcat(*parts)


class _Elimination:
    """Gaussian elimination of a matrix with the mass matrix's sparsity, leaves of the tree first: no fill-in.

    Without pivoting: the matrix differs from the mass matrix, which is positive definite, by terms of order h.
    """

    def __init__(self, matrix: Any) -> None:
        self._order = list(range(matrix.shape[0]))[::-1]
        self._entries: dict[tuple[int, int], Any] = {}
        place = {index: k for k, index in enumerate(self._order)}
        for i, j in zip(*matrix.sparsity().get_triplet(), strict=True):
            self._entries[place[i], place[j]] = matrix[i, j]
        entries, n = self._entries, len(self._order)
        for k in range(n):
            columns = [j for j in range(k + 1, n) if (k, j) in entries]
            for i in range(k + 1, n):
                if (i, k) not in entries:
                    continue
                entries[i, k] = entries[i, k] / entries[k, k]
                for j in columns:
                    entries[i, j] = entries.get((i, j), 0.0) - entries[i, k] * entries[k, j]

    def solve(self, right: Any) -> Any:
        """Return the solution for (nv, m) right-hand sides."""
        rows = [right[index, :] for index in self._order]
        n, entries = len(rows), self._entries
        for i in range(n):
            for j in range(i):
                if (i, j) in entries:
                    rows[i] = rows[i] - entries[i, j] * rows[j]
        for i in reversed(range(n)):
            for j in range(i + 1, n):
                if (i, j) in entries:
                    rows[i] = rows[i] - entries[i, j] * rows[j]
            rows[i] = rows[i] / entries[i, i]
        return ca.vertcat(*(rows[self._order.index(index)] for index in range(n)))
