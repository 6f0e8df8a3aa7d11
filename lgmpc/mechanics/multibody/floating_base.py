"""Equations of motion of a floating-base robot: Euler-Poincare for the base, Euler-Lagrange for the joints.

    d/dt dT/dxi - ad*_xi dT/dxi = -(T_e L_g)^* dV        the base, on SE(3)           (chapter 4.7.5, sign corrected)
    d/dt dT/dq' - dT/dq + dV/dq = tau                    the joints, on T^n

Together ``M(q) v' + C(q, v) v + g(q) = S^T tau + J^T lambda`` (chapter 4.7.2). The derivatives are CasADi's.

Marsden and Scheurle, "The reduced Euler-Lagrange equations", Fields Inst. Commun. 1 (1993); Featherstone, "Rigid
body dynamics algorithms" (2008), chapter 9, for the same equations by recursion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.compile import compile_function
from lgmpc.errors import InputError
from lgmpc.lie import quaternion
from lgmpc.lie.checks import typed
from lgmpc.lie.symbolic import se3
from lgmpc.mechanics.checks import check_vector
from lgmpc.mechanics.multibody.articulated import ArticulatedBody
from lgmpc.typing import Array

__all__ = ["EquationsOfMotion", "FloatingBaseDynamics"]


@dataclass(frozen=True)
class EquationsOfMotion:
    """The terms of ``M v' + C v + g = S^T tau + J^T lambda`` at one state; six rows of a free base first.

    Attributes:
        mass: (nv, nv) M; its blocks are the locked inertia, the coupling and the joints' own (chapter 4.7.3).
        coriolis: (nv, nv) C, of the Levi-Civita connection of M: ``M' - 2 C`` is skew.
        gravity: (nv,) g.
        selection: (n, nv) S, from velocities to the actuated ones.
    """

    mass: Array
    coriolis: Array
    gravity: Array
    selection: Array

    @property
    def free(self) -> int:
        """Degrees of freedom of the base: 6, or 0 if it is fixed."""
        return len(self.mass) - len(self.selection)

    @property
    def locked_inertia(self) -> Array:
        """(6, 6) M_bb: the whole robot as one rigid body, about the base's origin, base axes; (0, 0) if it is fixed."""
        return self.mass[: self.free, : self.free]

    @property
    def coupling(self) -> Array:
        """(6, n) M_bj: wrench on the base per joint acceleration; (0, n) for a fixed base."""
        return self.mass[: self.free, self.free :]

    @property
    def joint_inertia(self) -> Array:
        """(n, n) M_jj."""
        return self.mass[self.free :, self.free :]

    def recoil(self, joint_acceleration: ArrayLike) -> Array:
        """Return (6,) the acceleration of a free base that joint accelerations (n,) alone cause.

        ``-M_bb^-1 M_bj q''``, such as the reaction of the trunk to lifting a leg (chapter 4.12.5).

        Raises:
            InputError: another shape, or not finite.
        """
        acceleration = check_vector("joint_acceleration", joint_acceleration, self.coupling.shape[1])
        return np.asarray(-np.linalg.solve(self.locked_inertia, self.coupling @ acceleration), dtype=np.float64)


class FloatingBaseDynamics:
    """Mass matrix, Coriolis matrix and gravity of a robot, derived from its Lagrangian and compiled.

    For a robot with a fixed base only the joints' equations remain.

    Args:
        model: revolute and prismatic joints; optionally a free-flyer first.

    Attributes:
        body: the tree of which the energies are.

    Raises:
        ModelError: another kind of joint.
    """

    @typed
    def __init__(self, model: pin.Model) -> None:
        self.body = ArticulatedBody.from_model(model)
        self.nq, self.nv = int(model.nq), int(model.nv)
        self._terms, self._inverse = map(compile_function, _expressions(self.body))

    def equations(self, q: ArrayLike, v: ArrayLike) -> EquationsOfMotion:
        """Return the terms of the equations of motion.

        Args:
            q: (nq,) configuration [position; quaternion x y z w; joints].
            v: (nv,) velocity [body twist of the base, linear first; joint speeds].

        Raises:
            InputError: wrong shape, not finite, or no unit quaternion.
        """
        self._set(self._terms, q, v)
        self._terms.run()
        mass, coriolis, gravity = (np.array(self._terms.output(name)) for name in ("mass", "coriolis", "gravity"))
        return EquationsOfMotion(mass, coriolis, gravity, np.eye(self.nv)[self.nv - len(self.body.links) :])

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return (nv,) the generalised forces of an acceleration ``a`` (nv,); the base's six first.

        Raises:
            InputError: as :meth:`equations`.
        """
        self._set(self._inverse, q, v)
        self._inverse.input("a")[:] = check_vector("a", a, self.nv)
        self._inverse.run()
        return np.array(self._inverse.output("force"))

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, jacobian: ArrayLike | None = None, force: ArrayLike = ()
    ) -> Array:
        """Return (nv,) the acceleration under joint torques and contact forces.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            tau: (n,) torques, N.m.
            jacobian: (nc, nv) of the contacts; none if omitted.
            force: (nc,) contact forces, N.

        Raises:
            InputError: as :meth:`equations`, or contacts of another shape.
        """
        terms = self.equations(q, v)
        load: Array = terms.selection.T @ check_vector("tau", tau, len(terms.selection))
        if jacobian is not None:
            rows = np.asarray(jacobian, dtype=np.float64)
            if rows.ndim != 2 or rows.shape[1] != self.nv:
                raise InputError("jacobian", f"shape {rows.shape}", f"shape (nc, {self.nv})")
            load = load + rows.T @ check_vector("force", force, len(rows))
        load = load - terms.coriolis @ check_vector("v", v, self.nv) - terms.gravity
        return np.asarray(np.linalg.solve(terms.mass, load), dtype=np.float64)

    def _set(self, function: Any, q: ArrayLike, v: ArrayLike) -> None:
        configuration = check_vector("q", q, self.nq)
        function.input("v")[:] = check_vector("v", v, self.nv)
        if self.body.floating:
            pose = function.input("pose")
            pose[:3, :3] = quaternion.to_matrix(configuration[3:7])
            pose[:3, 3] = configuration[:3]
        function.input("joints")[:] = configuration[self.nq - len(self.body.links) :]


def _expressions(body: ArticulatedBody) -> list[ca.Function]:
    n, nv = len(body.links), body.nv
    free = nv - n
    pose = ca.SX.sym("pose", 4, 4) if body.floating else ca.SX.eye(4)
    joints, v, a = ca.SX.sym("joints", n), ca.SX.sym("v", nv), ca.SX.sym("a", nv)
    rates = v[free:]

    kinetic = body.kinetic_energy(pose, joints, v)
    momentum = ca.gradient(kinetic, v)
    mass = ca.jacobian(momentum, v)

    # The pose is varied on the left-trivialised tangent: g exp(delta).
    delta = ca.SX.sym("delta", 6)
    potential = body.potential_energy(pose @ _exp_first_order(delta), joints)
    gravity = ca.vertcat(ca.gradient(potential, delta)[:free], ca.gradient(potential, joints))
    gravity = ca.substitute(gravity, delta, ca.SX.zeros(6))

    # Koszul's formula on SE(3) x T^n: M depends on the joints alone, and only the base's frame fields do not commute.
    along = ca.jacobian(momentum, joints)  # dM/dq_j v
    turning = ca.horzcat(ca.SX(nv, free), along)
    rate = ca.reshape(ca.jtimes(ca.vec(mass), joints, rates), nv, nv)
    bracket, structure = ca.SX(nv, nv), ca.SX(nv, nv)
    force = ca.jtimes(momentum, joints, rates) + mass @ a + gravity
    force[free:] -= ca.gradient(kinetic, joints)
    if free:
        bracket[:6, :6] = se3.ad(v[:6])
        structure[:6, :6] = ca.horzcat(*[se3.coadjoint(ca.DM.eye(6)[:, j]) @ momentum[:6] for j in range(6)])
        force[:6] -= se3.coadjoint(v[:6]) @ momentum[:6]
    lowered = mass @ bracket
    coriolis = 0.5 * (rate + turning - turning.T + lowered - lowered.T - structure)

    inputs, names = ([pose], ["pose"]) if body.floating else ([], [])
    inputs, names = [*inputs, joints, v], [*names, "joints", "v"]
    terms = ca.Function("equations", inputs, [mass, coriolis, gravity], names, ["mass", "coriolis", "gravity"])
    inverse = ca.Function("inverse_dynamics", [*inputs, a], [force], [*names, "a"], ["force"])
    return [terms, inverse]


def _exp_first_order(delta: Any) -> Any:
    """Return exp(delta) to first order, which is exact for a gradient at zero."""
    return ca.DM.eye(4) + se3.hat(delta)
