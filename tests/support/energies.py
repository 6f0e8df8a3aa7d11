"""Equations of motion of robots from their kinetic and potential energies: an oracle of all recursive algorithms.

Euler-Poincare for the base, Euler-Lagrange for the joints (chapter 4.7.5, sign corrected; Marsden and Scheurle, "The
reduced Euler-Lagrange equations", Fields Inst. Commun. 1, 1993):

    d/dt dT/dxi - ad*_xi dT/dxi = -(T_e L_g)^* dV,        d/dt dT/dq' - dT/dq + dV/dq = tau

Only the constants of Pinocchio's models are used, none of its algorithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.lie import quaternion, se3
from lgmpc.lie.symbolic import se3 as symbolic


@dataclass(frozen=True)
class Terms:
    """M, C (of the Levi-Civita connection of M) and g at one state, the base's six rows first."""

    mass: np.ndarray
    coriolis: np.ndarray
    gravity: np.ndarray


class Energies:
    """A tree of a free base, if the model has one, and revolute and prismatic joints."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.floating = model.joints[1].shortname() == "JointModelFreeFlyer"
        self.free = 6 * self.floating
        pose, joints, v = ca.SX.sym("pose", 4, 4), ca.SX.sym("joints", model.nv - self.free), ca.SX.sym("v", model.nv)
        terms = self._terms(pose if self.floating else ca.SX.eye(4), joints, v)
        self._function = ca.Function("terms", [pose, joints, v], terms)

    def __call__(self, q: np.ndarray, v: np.ndarray) -> Terms:
        pose = pin.XYZQUATToSE3(q[:7]).homogeneous if self.floating else np.eye(4)
        joints = q[self.model.nq - self.model.nv + self.free :]
        return Terms(*(value.full() for value in self._function(pose, joints, v)))

    def _bodies(self, pose: ca.SX, joints: ca.SX, v: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Placement and body velocity of every joint's body: ``xi_i = Ad(T_i^-1) xi_parent + S_i q'_i`` (4.9)."""
        model, first = self.model, 1 + self.floating
        found = [(ca.SX.eye(4), ca.SX.zeros(6))] + [(pose, v[:6])] * self.floating
        for j in range(first, model.njoints):
            axis = np.asarray(model.joints[j].createData().S).reshape(6)
            position, rate = joints[j - first], v[self.free + j - first]
            step = ca.DM(model.jointPlacements[j].homogeneous) @ symbolic.exp(ca.DM(axis) * position)
            before, twist = found[model.parents[j]]
            found.append((before @ step, symbolic.adjoint(symbolic.inverse(step)) @ twist + ca.DM(axis) * rate))
        return found[1:]

    def _terms(self, pose: ca.SX, joints: ca.SX, v: ca.SX) -> list[ca.SX]:
        model, free, nv = self.model, self.free, self.model.nv
        inertias = list(model.inertias)[1:]
        bodies = self._bodies(pose, joints, v)
        kinetic = sum(ca.dot(xi, ca.DM(body.matrix()) @ xi) for (_, xi), body in zip(bodies, inertias, strict=True)) / 2
        kinetic += ca.dot(v**2, ca.DM(model.armature)) / 2
        momentum = ca.gradient(kinetic, v)
        mass = ca.jacobian(momentum, v)

        delta = ca.SX.sym("delta", 6)  # the pose is varied on the left-trivialised tangent
        moved, potential = self._bodies(pose @ (ca.DM.eye(4) + symbolic.hat(delta)), joints, v), 0
        for (place, _), body in zip(moved, inertias, strict=True):
            center = place[:3, 3] + place[:3, :3] @ ca.DM(body.lever)
            potential -= body.mass * ca.dot(ca.DM(model.gravity.linear), center)
        gravity = ca.vertcat(ca.gradient(potential, delta)[:free], ca.gradient(potential, joints))
        gravity = ca.substitute(gravity, delta, ca.SX.zeros(6))

        # Koszul's formula on SE(3) x T^n: M depends on the joints alone, only the base's frame fields do not commute.
        turning = ca.horzcat(ca.SX(nv, free), ca.jacobian(momentum, joints))  # dM/dq_j v
        rate = ca.reshape(ca.jtimes(ca.vec(mass), joints, v[free:]), nv, nv)
        bracket, structure = ca.SX(nv, nv), ca.SX(nv, nv)
        if free:
            bracket[:6, :6] = symbolic.ad(v[:6])
            structure[:6, :6] = ca.horzcat(*[symbolic.coadjoint(ca.DM.eye(6)[:, j]) @ momentum[:6] for j in range(6)])
        lowered = mass @ bracket
        return [mass, 0.5 * (rate + turning - turning.T + lowered - lowered.T - structure), gravity]


def centroidal_matrices(terms: Terms, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A_G, its rate, and Phi^T, which maps a wrench from the base's frame to the centre of mass (chapter 4.8.3).

    ``A_G = Phi^T M_b``, ``dA_G/dt = Phi^T (M_b' - ad*_zeta M_b)``, M' = C + C^T, zeta the twist of the base relative to
    the centre of mass (Wensing and Orin, Int. J. Humanoid Robotics 13, 2016).
    """
    locked = terms.mass[:6, :6]
    rotation, mass = quaternion.to_matrix(q[3:7]), locked[0, 0]
    from_base = rotation @ (np.array([locked[5, 1], locked[3, 2], locked[4, 0]]) / mass)
    carry = se3.adjoint(se3.inverse(se3.from_parts(rotation, -from_base))).T
    matrix = carry @ terms.mass[:6]
    zeta = v[:6].copy()
    zeta[:3] -= rotation.T @ (matrix[:3] @ v) / mass
    mass_rate = terms.coriolis[:6] + terms.coriolis[:, :6].T
    return matrix, carry @ (mass_rate - se3.coadjoint(zeta) @ terms.mass[:6]), carry
