"""From accelerations to the next state, on the configuration's group."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.dynamics import Dynamics, Motion
from lgmpc.actions.full_body import FreeForwardDynamics
from lgmpc.actions.implicit import Unknowns
from lgmpc.errors import InputError
from lgmpc.lie.symbolic import se3

__all__ = ["Integrator", "RungeKutta4", "SemiImplicitEuler", "Variational"]


class Integrator(ABC):
    """One step of an integration method."""

    @abstractmethod
    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, Motion]:
        """Return the state (nx,) after ``values["duration"]``, and the motion at its beginning."""


class SemiImplicitEuler(Integrator):
    """``v+ = v + h a,  q+ = q (+) h v+``: first order, as Crocoddyl's IntegratedActionModelEuler."""

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, Motion]:
        """Return the state after the step, and the motion at its beginning."""
        h = values["duration"]
        motion = dynamics.motion(q, v, u, values, unknowns)
        v_next = v + h * motion.a
        return ca.vertcat(dynamics.robot.integrate(q, h * v_next), v_next), motion


class RungeKutta4(Integrator):
    """The classical fourth-order method, commutator-free on the configuration's group.

    The configuration moves by two exponentials a step; the compiled stage is about four times as large as with the
    semi-implicit Euler method. Celledoni, Marthinsen, Owren, "Commutator-free Lie group methods", Future Generation
    Computer Systems 19 (2003), here for velocities in the body frame.
    """

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, Motion]:
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


class Variational(Integrator):
    r"""Lie-group variational integrator of one rigid body: second order, momentum maps kept to rounding.

    From the discrete Lagrangian ``h/2 <xi, G xi>`` minus half the potential at either end, with ``g+ = g exp(h xi)``:

        Jl^-T(h xi) G xi = mu + h/2 F,      mu+ = Ad^T_{exp(h xi)} (mu + h/2 F) + h/2 F+

    mu = G v is the body momentum, F the generalised force at the beginning (gravity included), F+ at the end, Jl the
    left Jacobian of the exponential. The first equation is solved by Newton's method and differentiated implicitly.
    Marsden and West, "Discrete mechanics and variational integrators" (2001); Bou-Rabee and Marsden,
    "Hamilton-Pontryagin integrators on Lie groups" (2009).

    Args:
        iterations: of Newton's method; the error, of order ``h |v|`` at first, squares with each.
    """

    def __init__(self, iterations: int = 4) -> None:
        self.iterations = iterations

    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, Motion]:
        """Return the state after the step, and the motion at its beginning.

        Raises:
            InputError: the dynamics is not that of one rigid body without added mass.
        """
        model, robot, h = dynamics.model, dynamics.robot, values["duration"]
        single = model.njoints == 2 and model.joints[1].shortname() == "JointModelFreeFlyer"
        if not (isinstance(dynamics, FreeForwardDynamics) and single and not dynamics.submerged):
            raise InputError("integrator", "Variational", "another one: this is for one rigid body without added mass")
        inertia = ca.DM(np.asarray(model.inertias[1].matrix()))

        def force(here: Any, speed: Any) -> Any:
            return dynamics.forces(here, speed, u, values) - robot.gravity(here)

        start = inertia @ v + h / 2 * force(q, v)

        def residual(xi: Any) -> Any:
            return se3.left_jacobian_inverse(h * xi).T @ (inertia @ xi) - start

        symbol = ca.SX.sym("xi", 6)
        slope = ca.jacobian(residual(symbol), symbol)

        def solve_at(xi: Any, right: Any) -> Any:
            return ca.solve(ca.substitute(slope, symbol, xi), right)

        xi = ca.solve(inertia, start)
        for _ in range(self.iterations):
            xi = xi - solve_at(xi, residual(xi))
        found = xi
        xi = unknowns.define(found, residual, lambda right: solve_at(found, right))
        moved = robot.integrate(q, h * xi)
        momentum = se3.adjoint(se3.exp(h * xi)).T @ start
        v_next = ca.solve(inertia, momentum + h / 2 * force(moved, xi))
        return ca.vertcat(moved, v_next), dynamics.motion(q, v, u, values, unknowns)
