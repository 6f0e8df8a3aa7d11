"""The full-body stage on Pinocchio's analytic derivatives: where nothing can be compiled, and as a cross-check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from lgmpc.actions.base import Action, Stage, StageValue
from lgmpc.actions.dynamics import actuated
from lgmpc.actions.full_body import ContactForwardDynamics
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.integrators import SemiImplicitEuler
from lgmpc.actions.multibody import MultibodyAction
from lgmpc.actions.numeric_items import NumericItems
from lgmpc.actions.pinocchio_contacts import PinocchioContactDynamics
from lgmpc.costs import Bounded, Cost
from lgmpc.errors import InputError
from lgmpc.state import StateMultibody, blocks
from lgmpc.typing import Array

__all__ = ["NumericContactAction", "StageQuadratics"]


@dataclass(frozen=True, eq=False)
class StageQuadratics:
    """The linear-quadratic expansions of n stages; see :attr:`lgmpc.actions.Action.quadratic_function`.

    Attributes:
        A: (n, ndx, ndx) next state by state.
        B: (n, ndx, nu) next state by control.
        b: (n, ndx) gap.
        Q: (n, ndx, ndx) Hessian.
        S: (n, nu, ndx).
        R: (n, nu, nu).
        q: (n, ndx) gradient.
        r: (n, nu).
        C: (n, ng, ndx) constraint by state.
        D: (n, ng, nu) constraint by control.
        lower: (n, ng) lower bounds minus the constraint's value.
        upper: (n, ng) upper bounds minus the constraint's value.
        cost: (n,) the cost's value.
    """

    A: Array
    B: Array
    b: Array
    Q: Array
    S: Array
    R: Array
    q: Array
    r: Array
    C: Array
    D: Array
    lower: Array
    upper: Array
    cost: Array


class NumericContactAction(Action):
    """A contact action evaluated and expanded by Pinocchio instead of compiled expressions: equal to rounding.

    Nothing is compiled: Pinocchio gives the derivatives of the dynamics, CasADi interprets those of costs and
    constraints by state, control, acceleration and forces, numpy multiplies them, each for all stages at once. The
    expressions are the given action's; solvers of the symbolic problem and measures of solutions use them, FDDP and SQP
    do not. Where a stage has no solution its values are NaN, as from machine code.

    Args:
        action: contact forward dynamics without loads, with semi-implicit Euler steps.

    Attributes:
        nz: number of accelerations and forces.

    Raises:
        InputError: another dynamics or integrator, loads, or another actuation matrix.
    """

    def __init__(self, action: MultibodyAction) -> None:
        if not isinstance(action.dynamics, ContactForwardDynamics):
            raise InputError("action", type(action.dynamics).__name__, "ContactForwardDynamics")
        joints = actuated(action.dynamics.model)
        if not np.array_equal(action.dynamics.actuation.full(), np.eye(int(action.dynamics.model.nv))[:, joints]):
            raise InputError(
                "action.dynamics.actuation", "another matrix", "the identity on all joints but the free base"
            )
        if action.dynamics.loads:
            raise InputError("action", f"dynamics with {len(action.dynamics.loads)} loads", "dynamics without loads")
        if type(action.integrator) is not SemiImplicitEuler:
            raise InputError("action", type(action.integrator).__name__, "SemiImplicitEuler")
        self.action = action
        self.name, self.nu, self.parameters = action.name, action.nu, action.parameters
        self.contacts = action.dynamics.contacts
        self.model: pin.Model = action.dynamics.model
        self.state: StateMultibody = action.dynamics.state
        self._dynamics = PinocchioContactDynamics(self.model, self.contacts)
        self._items = NumericItems(action, self.contacts)
        self.nz = int(self.model.nv) + self.contacts.nf
        self._own = ("duration", *(parameter.name for parameter in action.dynamics.parameters))

    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return the state (nx,) at the end of the interval."""
        return self.action.step(x, u, p)

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the running cost."""
        return self.action.cost(x, u, p)

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the cost of the state at the end of the horizon."""
        return self.action.terminal_cost(x, p)

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the path constraint."""
        return self.action.constraint(x, u, p)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the interval."""
        return self.action.stage(x, u, p, unknowns)

    def evaluate(self, x: Array, u: Array, p: Array) -> StageValue:
        """Evaluate the action at one point.

        Args:
            x: (nx,) state.
            u: (nu,) control.
            p: (np,) parameters.
        """
        x_next, z = self.advance(x, u, p)
        found = self._items.values(x[None], u[None], z[None], p[None])
        value, lower, upper = (found[name][0, :, 0] for name in ("value", "lower", "upper"))
        return StageValue(x_next, float(found["cost"][0, 0, 0]), value, lower, upper)

    def advance(self, x: Array, u: Array, p: Array) -> tuple[Array, Array]:
        """Return the state (nx,) at the end of the interval, and accelerations and forces (nv + nf,).

        Args:
            x: (nx,) state.
            u: (nu,) control.
            p: (np,) parameters.
        """
        values = self._split(p[None])
        z = self._dynamics.solve(x[None], u[None], values).z[0]
        h = float(values["duration"][0, 0])
        return self.state.integrate(x, h * self._rates(x, z, h)), z

    def costs(self, xs: Array, us: Array, zs: Array, ps: Array) -> Array:
        """Return the running costs (n,) of n stages.

        Args:
            xs: (n, nx) states.
            us: (n, nu) controls.
            zs: (n, nv + nf) their accelerations and forces.
            ps: (n, np) parameters.
        """
        return self._items.values(xs, us, zs, ps)["cost"][:, 0, 0]

    def quadratics(self, xs: Array, us: Array, xs_next: Array, ps: Array) -> StageQuadratics:
        """Expand n stages around (xs, us) for trajectories whose next states are ``xs_next``.

        Args:
            xs: (n, nx) states.
            us: (n, nu) controls.
            xs_next: (n, nx) next states.
            ps: (n, np) parameters.
        """
        values, state, nv = self._split(ps), self.state, int(self.model.nv)
        solution = self._dynamics.solve(xs, us, values)
        slopes = self._dynamics.slopes(xs, solution, values)
        ndx, h = state.ndx, values["duration"]
        step = h * self._rates(xs, solution.z, h)
        reached = state.integrate(xs, step)
        gap = state.diff(xs_next, reached)
        rates = h[..., None] * slopes[:, :nv]
        rates[:, :, nv:ndx] += np.eye(nv)
        moved = h[..., None] * rates
        moved[:, :, :nv] += np.eye(nv)
        for block in state.curved:
            by_x, by_step = blocks.integrate_jacobians(block.kind, step[:, block.v])
            turned = h[..., None] * by_step @ rates[:, block.v]
            turned[:, :, block.v] += by_x
            moved[:, block.v] = blocks.difference_jacobians(block.kind, gap[:, block.v])[1] @ turned
        e = self._items.expand(xs, us, solution.z, ps, slopes)
        return StageQuadratics(
            A=np.concatenate([moved[:, :, :ndx], rates[:, :, :ndx]], axis=1),
            B=np.concatenate([moved[:, :, ndx:], rates[:, :, ndx:]], axis=1),
            b=gap,
            Q=e.hessian[:, :ndx, :ndx],
            S=e.hessian[:, ndx:, :ndx],
            R=e.hessian[:, ndx:, ndx:],
            q=e.gradient[:, :ndx],
            r=e.gradient[:, ndx:],
            C=e.rows[:, :, :ndx],
            D=e.rows[:, :, ndx:],
            lower=e.lower,
            upper=e.upper,
            cost=e.cost,
        )

    def _split(self, ps: Array) -> dict[str, Array]:
        """Return each parameter (n, size)."""
        return {name: self.parameters.view(ps, name) for name in self._own}

    def _rates(self, x: Array, z: Array, h: Any) -> Array:
        """Return (..., ndx) the rate of the state over a semi-implicit Euler step: next velocity, acceleration."""
        a = z[..., : self.model.nv]
        return np.concatenate([x[..., self.model.nq :] + h * a, a], axis=-1)
