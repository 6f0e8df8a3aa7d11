"""The full-body stage on Pinocchio's analytic derivatives: where nothing can be compiled, and as a cross-check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions.base import Action, Stage, StageValue
from lgmpc.actions.dynamics import actuated
from lgmpc.actions.full_body import ContactForwardDynamics
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.integrators import SemiImplicitEuler
from lgmpc.actions.multibody import MultibodyAction
from lgmpc.costs import Bounded, Cost, StageSymbols, constraint_of, cost_of
from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.typing import Array

__all__ = ["NumericContactAction", "StageQuadratic"]


@dataclass(frozen=True)
class StageQuadratic:
    """The linear-quadratic expansion of a stage; see :attr:`lgmpc.actions.Action.quadratic_function`.

    Attributes:
        A: (ndx, ndx) next state by state.
        B: (ndx, nu) next state by control.
        b: (ndx,) gap.
        Q: (ndx, ndx) Hessian.
        S: (nu, ndx).
        R: (nu, nu).
        q: (ndx,) gradient.
        r: (nu,).
        C: (ng, ndx) constraint by state.
        D: (ng, nu) constraint by control.
        lower: (ng,) lower bounds minus the constraint's value.
        upper: (ng,) upper bounds minus the constraint's value.
        cost: the cost's value.
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
    cost: float


class NumericContactAction(Action):
    """A contact action evaluated and expanded by Pinocchio instead of compiled expressions: equal to rounding.

    Nothing is compiled; an expansion takes hundreds of times as long as machine code. Costs and constraints are
    interpreted, as functions of state, control, acceleration and forces. The expressions are the given action's;
    solvers of the symbolic problem and measures of solutions use them, FDDP and SQP do not. Derivatives: Carpentier and
    Mansard, "Analytical derivatives of rigid body dynamics algorithms", RSS 2018.

    Args:
        action: contact forward dynamics without loads, with semi-implicit Euler steps.

    Raises:
        InputError: another dynamics or integrator, or loads.
    """

    def __init__(self, action: MultibodyAction) -> None:
        if not isinstance(action.dynamics, ContactForwardDynamics):
            raise InputError("action", type(action.dynamics).__name__, "ContactForwardDynamics")
        joints = actuated(action.dynamics.model)
        if not np.array_equal(action.dynamics.actuation.full(), np.eye(int(action.dynamics.model.nv))[:, joints]):
            raise InputError("action.dynamics.actuation", "a matrix of one's own", "the standard one, of all joints")
        if action.dynamics.loads:
            raise InputError("action", f"dynamics with {len(action.dynamics.loads)} loads", "dynamics without loads")
        if type(action.integrator) is not SemiImplicitEuler:
            raise InputError("action", type(action.integrator).__name__, "SemiImplicitEuler")
        self.action = action
        self.name, self.state, self.nu, self.parameters = action.name, action.state, action.nu, action.parameters
        self.contacts = action.dynamics.contacts
        self.model: pin.Model = action.dynamics.model
        self._data = self.model.createData()
        self._frames = [int(self.model.getFrameId(contact.frame)) for contact in self.contacts.contacts]
        self._joints = actuated(self.model)
        self._items = self._item_function()
        kept = ("cost", "value", "lower", "upper")
        self._values = self._items.factory(f"{action.name}_items_values", self._items.name_in(), list(kept))

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
        values = self.action.parameters.split(p)
        z = self._solve(x, u, values)
        cost, *path = (out.full()[:, 0] for out in self._values(x, u, z, p))
        return StageValue(self._step(x, z, values), float(cost[0]), *path)

    def quadratic(self, x: Array, u: Array, x_next: Array, p: Array) -> StageQuadratic:
        """Expand the action around (x, u) for a trajectory whose next state is ``x_next``.

        Args:
            x: (nx,) state.
            u: (nu,) control.
            x_next: (nx,) next state.
            p: (np,) parameters.
        """
        values, state, nv = self.action.parameters.split(p), self.action.state, self.model.nv
        z = self._solve(x, u, values)
        slope = self._slope(x, u, z, values)
        ndx, h = state.ndx, float(values["duration"][0])
        there = self._step(x, z, values)
        by_x, by_step = state.Jintegrate(x, h * self._rate(x, z, h))
        rate = h * slope[:nv]
        rate[:, nv:ndx] += np.eye(nv)
        moved = h * by_step[:nv, :nv] @ rate
        moved[:, :nv] += by_x[:nv, :nv]
        onto = state.Jdiff(x_next, there)[1] @ np.vstack([moved, rate])
        items = self._evaluate_items(x, u, z, p)
        total = np.hstack([items["by_x"], items["by_u"]]) + items["by_z"] @ slope
        hessian = total.T @ (items["curvature"] * total)
        gradient = total.T @ items["gradient"][:, 0]
        path = np.hstack([items["path_by_x"], items["path_by_u"]]) + items["path_by_z"] @ slope
        value = items["value"][:, 0]
        return StageQuadratic(
            A=onto[:, :ndx],
            B=onto[:, ndx:],
            b=state.diff(x_next, there),
            Q=hessian[:ndx, :ndx],
            S=hessian[ndx:, :ndx],
            R=hessian[ndx:, ndx:],
            q=gradient[:ndx],
            r=gradient[ndx:],
            C=path[:, :ndx],
            D=path[:, ndx:],
            lower=items["lower"][:, 0] - value,
            upper=items["upper"][:, 0] - value,
            cost=float(items["cost"][0, 0]),
        )

    def _step(self, x: Array, z: Array, values: Mapping[str, Array]) -> Array:
        h = float(values["duration"][0])
        return self.action.state.integrate(x, h * self._rate(x, z, h))

    def _rate(self, x: Array, z: Array, h: float) -> Array:
        """Return (ndx,) the rate of the state over a semi-implicit Euler step: next velocity, acceleration."""
        a = z[: self.model.nv]
        return np.concatenate([x[self.model.nq :] + h * a, a])

    def _flags(self, values: Mapping[str, Array]) -> Array:
        flags: Array = np.repeat(values["contact_flags"], [contact.size for contact in self.contacts.contacts])
        return flags

    def _kkt(self, mass: Array, jacobian: Array, values: Mapping[str, Array]) -> Array:
        flags = self._flags(values)
        rows = flags[:, None] * jacobian
        return np.block([[mass, -rows.T], [rows, np.diag(1 - flags + values["contact_damping"])]])

    def _solve(self, x: Array, u: Array, values: Mapping[str, Array]) -> Array:
        """Return (nv + nf,) accelerations and forces."""
        model, data, nv = self.model, self._data, self.model.nv
        q, v = x[: model.nq], x[model.nq :]
        pin.computeForwardKinematicsDerivatives(model, data, q, v, np.zeros(nv))
        pin.updateFramePlacements(model, data)
        rows, _, by_a = self._contact_rows(q, v, values)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        effort = -pin.nonLinearEffects(model, data, q, v)
        effort[self._joints] += u
        right = np.concatenate([effort, -self._flags(values) * rows])
        return np.asarray(np.linalg.solve(self._kkt(mass, by_a, values), right), dtype=np.float64)

    def _slope(self, x: Array, u: Array, z: Array, values: Mapping[str, Array]) -> Array:
        """Return (nv + nf, ndx + nu) the derivatives of accelerations and forces."""
        model, data, nv = self.model, self._data, self.model.nv
        q, v, a = x[: model.nq], x[model.nq :], z[:nv]
        flags = self._flags(values)
        pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        _, by_x, by_a = self._contact_rows(q, v, values)
        external, turning = self._external(flags * z[nv:])
        tau_q, tau_v, mass = pin.computeRNEADerivatives(model, data, q, v, a, external)
        mass = np.triu(mass) + np.triu(mass, 1).T
        right = np.zeros((nv + self.contacts.nf, 2 * nv + self.action.nu))
        right[:nv, :nv], right[:nv, nv : 2 * nv] = tau_q + turning, tau_v
        right[self._joints, 2 * nv :] = -np.eye(self.action.nu)
        right[nv:, : 2 * nv] = flags[:, None] * by_x
        return np.asarray(np.linalg.solve(self._kkt(mass, by_a, values), -right), dtype=np.float64)

    def _external(self, forces: Array) -> tuple[Any, Array]:
        """Return the forces in the joints' frames, and the rest of d(-J^T f)/dq when these are held constant.

        A force that is constant in world axes changes in the joint's frame by ``f x theta``.
        """
        model, data = self.model, self._data
        external = [pin.Force.Zero() for _ in range(model.njoints)]
        turning = np.zeros((model.nv, model.nv))
        start = 0
        for contact, frame in zip(self.contacts.contacts, self._frames, strict=True):
            wrench = np.zeros(6)
            wrench[: contact.size] = forces[start : start + contact.size]
            start += contact.size
            joint = model.frames[frame].parentJoint
            back, arm = data.oMi[joint].rotation.T, model.frames[frame].placement.translation
            force, moment = back @ wrench[:3], back @ wrench[3:]
            external[joint] += pin.Force(force, moment + np.cross(arm, force))
            jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL)
            turned_force, turned_moment = pin.skew(force), pin.skew(moment)
            turned = np.vstack([turned_force, turned_moment + pin.skew(arm) @ turned_force])
            turning -= jacobian.T @ turned @ jacobian[3:]
        return external, turning

    def _contact_rows(self, q: Array, v: Array, values: Mapping[str, Array]) -> tuple[Array, Array, Array]:
        """Return the contacts' accelerations plus Baumgarte's terms (nf,), their derivatives by dx, and J."""
        model, data, nv = self.model, self._data, self.model.nv
        stiffness, damping = values["contact_gains"]
        value, by_x, by_a, surface = [], [], [], 0
        for i, (contact, frame) in enumerate(zip(self.contacts.contacts, self._frames, strict=True)):
            v_q, a_q, a_v, jacobian = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
            speed, acceleration = (
                pin.getFrameVelocity(model, data, frame, pin.LOCAL),
                pin.getFrameAcceleration(model, data, frame, pin.LOCAL),
            )
            placement, turn = data.oMf[frame], jacobian[3:]
            rotation = placement.rotation
            spin, sweep = pin.skew(speed.angular), pin.skew(speed.linear)
            # Classical acceleration: spatial plus omega x v, then both rotated to world axes.
            linear = acceleration.linear + np.cross(speed.angular, speed.linear)
            linear_q = a_q[:3] + spin @ v_q[:3] - sweep @ v_q[3:] - pin.skew(linear) @ turn
            linear_v = a_v[:3] + spin @ jacobian[:3] - sweep @ turn
            rate_q = v_q[:3] - sweep @ turn
            held = values["contact_points"][3 * i : 3 * i + 3]
            error = placement.translation - held
            value.append(rotation @ (linear + damping * speed.linear) + stiffness * error)
            by_q = rotation @ (linear_q + damping * rate_q + stiffness * jacobian[:3])
            by_x.append(np.hstack([by_q, rotation @ (linear_v + damping * jacobian[:3])]))
            by_a.append(rotation @ jacobian[:3])
            if contact.size == 6:
                goal = quaternion.to_matrix(values["contact_orientations"][4 * surface : 4 * surface + 4])
                surface += 1
                phi = so3.log(rotation @ goal.T)
                value.append(rotation @ (acceleration.angular + damping * speed.angular) + stiffness * phi)
                angular_q = a_q[3:] - pin.skew(acceleration.angular) @ turn + damping * (v_q[3:] - spin @ turn)
                pulled = stiffness * so3.left_jacobian_inverse(phi) @ rotation @ turn
                by_x.append(np.hstack([rotation @ angular_q + pulled, rotation @ (a_v[3:] + damping * turn)]))
                by_a.append(rotation @ turn)
        return np.concatenate(value), np.vstack(by_x), np.vstack(by_a).reshape(-1, nv)

    def _item_function(self) -> ca.Function:
        """Return costs, constraints and their derivatives as functions of (x, u, z, p), z = [accelerations; forces]."""
        action, robot = self.action, self.action.robot
        x, dx = ca.SX.sym("x", action.state.nx), ca.SX.sym("dx", action.state.ndx)
        u, p = ca.SX.sym("u", action.nu), ca.SX.sym("p", action.parameters.size)
        z = ca.SX.sym("z", robot.nv + self.contacts.nf)
        values = action.parameters.split(p)
        moved = action.state.integrate_symbolic(x, dx)
        forces = self.contacts.by_frame(z[robot.nv :])
        s = StageSymbols(robot, moved, values, u=u, a=z[: robot.nv], tau=u, forces=forces)
        cost, path = cost_of(action.costs, s, scale=values["duration"]), constraint_of(action.constraints, s)
        residual, weight = cost.residual, cost.weight
        outputs = {
            "cost": cost.value,
            "curvature": weight * cost.curvature,
            "gradient": weight * cost.gradient,
            "value": path.value,
            "lower": path.lower,
            "upper": path.upper,
        }
        for prefix, column in (("", residual), ("path_", path.value)):
            for name, variable in (("x", dx), ("u", u), ("z", z)):
                outputs[f"{prefix}by_{name}"] = ca.jacobian(column, variable)
        still = ca.substitute(list(outputs.values()), [dx], [ca.SX.zeros(*dx.shape)])
        return ca.Function(f"{action.name}_items", [x, u, z, p], still, ["x", "u", "z", "p"], list(outputs))

    def _evaluate_items(self, x: Array, u: Array, z: Array, p: Array) -> dict[str, Array]:
        outputs = self._items(x, u, z, p)
        return {name: out.full() for name, out in zip(self._items.name_out(), outputs, strict=True)}
