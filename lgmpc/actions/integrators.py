"""Integration of accelerations to the next state, on the configuration's group."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import casadi as ca

from lgmpc.actions.dynamics import Dynamics, Motion
from lgmpc.actions.implicit import Unknowns

__all__ = ["Integrator", "RungeKutta4", "SemiImplicitEuler"]


class Integrator(ABC):
    """One step of an integration method."""

    @abstractmethod
    def step(
        self, dynamics: Dynamics, q: Any, v: Any, u: Any, values: Mapping[str, Any], unknowns: Unknowns
    ) -> tuple[Any, Motion]:
        """Return the state (nx,) after ``values["duration"]``, and the motion at its beginning."""

    def move(self, v: Any, v_next: Any, values: Mapping[str, Any]) -> Any:
        """Return m of ``x_next = x (+) m``, as a function of both velocities; None if a step is not one such motion."""
        return None


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
