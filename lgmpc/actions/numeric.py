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
        inputs = self._items.sx_in()
        # One column in memory of numpy's: CasADi converts its matrices number by number.
        column = ca.vertcat(*(ca.vec(ca.densify(output)) for output in self._items.call(inputs)))
        self._column = ca.Function(f"{action.name}_items_column", inputs, [column])
        self._given = [np.zeros(self._column.numel_in(i)) for i in range(self._column.n_in())]
        self._found = np.zeros(self._column.numel_out(0))
        buffer: Any
        buffer, self._evaluate_column = self._column.buffer()
        for i, array in enumerate(self._given):
            buffer.set_arg(i, array.data)
        buffer.set_res(0, self._found.data)
        self._buffer = buffer  # which the call refers to
        ends = np.cumsum([self._items.numel_out(i) for i in range(self._items.n_out())]).tolist()
        self._places = tuple(
            (name, slice(start, end), self._items.size_out(i)[::-1])
            for i, (name, start, end) in enumerate(zip(self._items.name_out(), [0, *ends], ends, strict=False))
        )
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
        flags, nv = self._flags(values), self.model.nv
        rows, size = flags[:, None] * jacobian, nv + flags.size
        out = np.zeros((size, size))
        out[:nv, :nv], out[:nv, nv:], out[nv:, :nv] = mass, -rows.T, rows
        out.ravel()[nv * (size + 1) :: size + 1] = 1 - flags + values["contact_damping"]
        return out

    def _solve(self, x: Array, u: Array, values: Mapping[str, Array]) -> Array:
        """Return (nv + nf,) accelerations and forces."""
        model, data, nv = self.model, self._data, self.model.nv
        q, v = x[: model.nq], x[model.nq :]
        pin.forwardKinematics(model, data, q, v, np.zeros(nv))
        pin.computeJointJacobians(model, data)
        pin.updateFramePlacements(model, data)
        rows, by_a = self._contact_values(values)
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
        by_x, by_a = self._contact_slopes(values)
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
            external[joint] += pin.Force(force, moment + pin.skew(arm) @ force)
            jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL)
            turned_force, turned_moment = pin.skew(force), pin.skew(moment)
            turned = np.vstack([turned_force, turned_moment + pin.skew(arm) @ turned_force])
            turning -= jacobian.T @ turned @ jacobian[3:]
        return external, turning

    def _contact_values(self, values: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return the contacts' accelerations plus Baumgarte's terms (nf,), and J."""
        model, data = self.model, self._data
        stiffness, damping = values["contact_gains"]
        value, by_a, surface = [], [], 0
        for i, (contact, frame) in enumerate(zip(self.contacts.contacts, self._frames, strict=True)):
            speed = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
            acceleration = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL)
            placement, jacobian = data.oMf[frame], pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            rotation = placement.rotation
            error = placement.translation - values["contact_points"][3 * i : 3 * i + 3]
            value.append(rotation @ (acceleration.linear + damping * speed.linear) + stiffness * error)
            by_a.append(rotation @ jacobian[:3])
            if contact.size == 6:
                phi = self._turned(rotation, values, surface)
                surface += 1
                value.append(rotation @ (acceleration.angular + damping * speed.angular) + stiffness * phi)
                by_a.append(rotation @ jacobian[3:])
        return np.concatenate(value), np.concatenate(by_a)

    def _contact_slopes(self, values: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return the derivatives by dx of :meth:`_contact_values`, and J."""
        model, data, nv = self.model, self._data, self.model.nv
        stiffness, damping = values["contact_gains"]
        by_x = np.empty((self.contacts.nf, 2 * nv))
        by_a, row, surface = np.empty((self.contacts.nf, nv)), 0, 0
        for contact, frame in zip(self.contacts.contacts, self._frames, strict=True):
            v_q, a_q, a_v, jacobian = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
            speed = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
            acceleration = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL)
            rotation, turn = data.oMf[frame].rotation, jacobian[3:]
            spin, sweep = pin.skew(speed.angular), pin.skew(speed.linear)
            # Classical acceleration: spatial plus omega x v, then both rotated to world axes.
            linear_q = a_q[:3] + spin @ v_q[:3] - sweep @ v_q[3:] - pin.skew(acceleration.linear) @ turn
            linear_v = a_v[:3] + spin @ jacobian[:3] - sweep @ turn
            rate_q = v_q[:3] - sweep @ turn
            rows = slice(row, row + 3)
            by_x[rows, :nv] = rotation @ (linear_q + damping * rate_q + stiffness * jacobian[:3])
            by_x[rows, nv:] = rotation @ (linear_v + damping * jacobian[:3])
            by_a[rows] = rotation @ jacobian[:3]
            if contact.size == 6:
                rows = slice(row + 3, row + 6)
                phi = self._turned(rotation, values, surface)
                surface += 1
                angular_q = a_q[3:] - pin.skew(acceleration.angular) @ turn + damping * (v_q[3:] - spin @ turn)
                pulled = stiffness * so3.left_jacobian_inverse(phi) @ rotation @ turn
                by_x[rows, :nv], by_x[rows, nv:] = rotation @ angular_q + pulled, rotation @ (a_v[3:] + damping * turn)
                by_a[rows] = rotation @ turn
            row += contact.size
        return by_x, by_a

    def _turned(self, rotation: Array, values: Mapping[str, Array], surface: int) -> Array:
        """Return the rotation vector of a surface's error of orientation, in world axes."""
        goal = quaternion.to_matrix(values["contact_orientations"][4 * surface : 4 * surface + 4])
        phi: Array = so3.log(rotation @ goal.T)
        return phi

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
        for array, value in zip(self._given, (x, u, z, p), strict=True):
            array[...] = value
        self._evaluate_column()
        found = self._found.copy()
        return {name: found[place].reshape(shape).T for name, place, shape in self._places}
