r"""Kinodynamics: centroidal momentum driven by contact forces, with the robot's full kinematics.

State ``x = (q, h)`` with the centroidal momentum h = [l; k]; control ``u = [f; v_j]``: contact forces and joint
velocities. The base's velocity follows from ``h = A_b v_b + A_j v_j`` (A the centroidal momentum matrix), so that no
mass matrix and no torque appears:

    l' = m g + sum f_i + f_e,      k' = sum (p_i(q) - c(q)) x f_i + moments + tau_e,      q' = v(q, h, v_j)

with an external force f_e and moment tau_e about the centre of mass.

Dai, Valenzuela, Tedrake, "Whole-body motion planning with centroidal dynamics and full kinematics", Humanoids 2014.

Over an interval of duration t, with h' at its beginning: ``h+ = h + t h'``, ``q+ = q (+) t v(q, h + t h' / 2, v_j)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions.base import Stage
from lgmpc.actions.contacts import Contact, ContactSet
from lgmpc.actions.dynamics import actuated
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.multibody import ItemAction
from lgmpc.costs import Bounded, ConstraintItem, Cost, CostItem, Parameter, StageSymbols, constraint_of, cost_of
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import State, StateMultibody
from lgmpc.typing import Array

__all__ = ["KinodynamicAction", "StateMomentum"]


class StateMomentum(State):
    """``x = (q, h)``: a configuration and a centroidal momentum; ``nx = nq + 6``, ``ndx = nv + 6``.

    Args:
        model: the robot.

    Raises:
        ModelError: unsupported joints.
    """

    def __init__(self, model: pin.Model) -> None:
        self._body = StateMultibody(model)
        nv = self._body.nv
        endless = np.full(6, np.inf)
        lower, upper = np.r_[self._body.lower[:nv], -endless], np.r_[self._body.upper[:nv], endless]
        super().__init__(self._body.nq + 6, nv + 6, lower, upper)

    def neutral(self) -> Array:
        """Return the neutral configuration without momentum."""
        return np.concatenate([self._body.neutral()[: self._body.nq], np.zeros(6)])

    def integrate(self, x: Array, dx: Array) -> Array:
        """Return ``x (+) dx``."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        moved = self._body.integrate(self._pose(x), self._turn(dx))[..., : self._body.nq]
        return np.concatenate([moved, x[..., -6:] + dx[..., -6:]], axis=-1)

    def diff(self, x0: Array, x1: Array) -> Array:
        """Return ``x1 (-) x0``."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        turned = self._body.diff(self._pose(x0), self._pose(x1))[..., : self._body.nv]
        return np.concatenate([turned, x1[..., -6:] - x0[..., -6:]], axis=-1)

    def Jintegrate(self, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the derivatives of ``integrate`` with respect to ``x`` and to ``dx``."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        by_x, by_dx = self._body.Jintegrate(self._pose(x), self._turn(dx))
        return self._block(by_x, 1.0), self._block(by_dx, 1.0)

    def Jdiff(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Return the derivatives of ``diff`` with respect to ``x0`` and ``x1``."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        by_0, by_1 = self._body.Jdiff(self._pose(x0), self._pose(x1))
        return self._block(by_0, -1.0), self._block(by_1, 1.0)

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x (+) dx`` as a CasADi column."""
        nq, nv = self._body.nq, self._body.nv
        moved = self._body.integrate_symbolic(ca.vertcat(x[:nq], ca.DM.zeros(nv)), ca.vertcat(dx[:nv], ca.DM.zeros(nv)))
        return ca.vertcat(moved[:nq], x[nq:] + dx[nv:])

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 (-) x0`` as a CasADi column."""
        nq, still = self._body.nq, ca.DM.zeros(self._body.nv)
        turned = self._body.diff_symbolic(ca.vertcat(x0[:nq], still), ca.vertcat(x1[:nq], still))
        return ca.vertcat(turned[: self._body.nv], x1[nq:] - x0[nq:])

    def _pose(self, x: Array) -> Array:
        return np.concatenate([x[..., : self._body.nq], np.zeros((*x.shape[:-1], self._body.nv))], axis=-1)

    def _turn(self, dx: Array) -> Array:
        return np.concatenate([dx[..., : self._body.nv], np.zeros((*dx.shape[:-1], self._body.nv))], axis=-1)

    def _block(self, jacobian: Array, sign: float) -> Array:
        nv = self._body.nv
        out = np.zeros((*jacobian.shape[:-2], self.ndx, self.ndx))
        out[..., :nv, :nv] = jacobian[..., :nv, :nv]
        out[..., nv:, nv:] = sign * np.eye(6)
        return out


class KinodynamicAction(ItemAction):
    """Centroidal momentum and full kinematics over an interval (see the module).

    The path constraint requires, for each contact, zero velocity (plus ``contact_stiffness`` times its error from
    ``contact_points``) while its flag is 1 and zero force while it is 0. Running costs are multiplied by the
    duration. In costs and constraints ``v`` is the velocity, ``momentum`` that of the state; there is no acceleration
    and no effort.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        model: the robot; its first joint is a free-flyer.
        contacts: names of frames (points) or contacts.
        costs: evaluated at the interval's beginning; those of the state alone are the terminal cost.
        constraints: evaluated at the interval's beginning.

    Raises:
        InputError: no free base, a name that is no identifier, an unknown contact frame, or two items of one name.
        ModelError: unsupported joints.
    """

    def __init__(
        self,
        name: str,
        model: pin.Model,
        contacts: Sequence[str | Contact],
        costs: Sequence[CostItem] = (),
        constraints: Sequence[ConstraintItem] = (),
    ) -> None:
        joints = actuated(model)
        if joints.start == 0:
            raise InputError("model", f"{model.name}, whose base is fixed", "a model whose first joint is a free-flyer")
        self.contacts = ContactSet(model, contacts)
        self._gravity = ca.DM(np.asarray(model.gravity.linear))
        n = len(self.contacts.contacts)
        parameters = (
            Parameter("duration", 1, "length of the interval, s", 0.01, "positive"),
            Parameter("contact_flags", n, "1 in contact, 0 in the air", 1.0),
            Parameter("contact_points", 3 * n, "points at which the contact frames' origins are held, world, m"),
            Parameter("contact_stiffness", 1, "rate at which contacts return to contact_points, 1/s"),
            Parameter("external_wrench", 6, "[force; moment about the centre of mass], world axes, N, N.m"),
        )
        nu = self.contacts.nf + joints.stop - joints.start
        super().__init__(name, SymbolicModel(model), StateMomentum(model), nu, parameters, costs, constraints)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the interval."""
        values, robot, contacts = self.parameters.split(p), self.robot, self.contacts
        q, h, f, joint_rates = x[: robot.nq], x[robot.nq :], u[: contacts.nf], u[contacts.nf :]
        flags, duration = contacts.flags(values), values["duration"]
        base = robot.momentum_matrix(q)[:, :6]

        def momentum(rates: Any) -> Any:
            return robot.momentum(q, ca.vertcat(rates, joint_rates))

        def solve(right: Any) -> Any:
            return ca.solve(base, right)

        still = momentum(ca.SX.zeros(6))
        rates = unknowns.define(solve(h - still), lambda z: momentum(z) - h, solve)
        v = ca.vertcat(rates, joint_rates)
        h_rate = self._momentum_rate(q, flags * f, values)
        gained = duration / 2 * h_rate
        extra = unknowns.define(solve(gained), lambda z: base @ z - gained, solve)
        v_mean = ca.vertcat(rates + extra, joint_rates)
        x_next = ca.vertcat(robot.integrate(q, duration * v_mean), h + duration * h_rate)

        speeds = contacts.velocity(robot, q, v)
        rows = flags * (speeds + self._pull(q, values)) + (1 - flags) * f
        zero = ca.SX.zeros(contacts.nf)
        forces = contacts.by_frame(flags * f, robot, q)
        s = StageSymbols(robot, x, values, u=u, forces=forces, momentum=h, v=v)
        cost = cost_of(self.costs, s, scale=duration)
        return Stage(x_next, cost, Bounded.stack(Bounded(rows, zero, zero), constraint_of(self.constraints, s)))

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the costs that depend on the state alone, not multiplied by a duration."""
        s = StageSymbols(self.robot, x, self.parameters.split(p), momentum=x[self.robot.nq :])
        return cost_of(self.costs, s, terminal=True)

    def _momentum_rate(self, q: Any, forces: Any, values: dict[str, Any]) -> Any:
        center, force, moment = self.robot.com(q), self.robot.mass * self._gravity, ca.SX.zeros(3)
        for frame, wrench in self.contacts.by_frame(forces, self.robot, q).items():
            force += wrench[:3]
            moment += ca.cross(self.robot.frame_placement(q, frame).translation - center, wrench[:3])
            if wrench.shape[0] == 6:
                moment += wrench[3:]
        return ca.vertcat(force, moment) + values["external_wrench"]

    def _pull(self, q: Any, values: dict[str, Any]) -> Any:
        """Return (nf,) minus the velocities at which contacts return to their points."""
        rows = []
        for i, contact in enumerate(self.contacts.contacts):
            rows.append(values["contact_stiffness"] * self.contacts.error(self.robot, q, i, values))
            rows.append(ca.SX(max(contact.size - 3, 0), 1))
        return ca.vertcat(*rows)
