"""Build the whole-body QP from terms, tasks and limits: pure arithmetic, no solver.

Variables ``z = (a, f)``: joint-space acceleration (nv,) and contact forces (3 nc,), world axes, on the robot::

    minimise    1/2 ||J a - rhs||_W^2 + 1/2 w_f ||f - f_des||^2 + 1/2 w_a ||a||^2
    subject to  M_b a + h_b = J_cb^T f + w                      (floating-base rows of the dynamics)
                |M_j a + h_j - J_cj^T f| <= tau_max              (torque limits)
                friction pyramid inscribed in the cone           (each stance foot)
                bounds on joint accelerations and normal forces  (joint limits, contact)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc.reference import WholeBodyReference
from lgmpc.wbc.tasks import TaskStack
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = ["QpAssembly", "WholeBodyLimits", "friction_pyramid"]

_UNBOUNDED = 1e20  # what ProxQP takes for infinity


@dataclass(frozen=True)
class WholeBodyLimits:
    """Hard limits of the QP.

    Attributes:
        friction: Coulomb coefficient that the controller believes.
        friction_facets: sides of the pyramid inscribed in the friction cone.
        normal_force_min: N, each stance foot.
        normal_force_max: N, each stance foot.
        joint_horizon: s; a joint is slowed so that within this time it passes neither its position nor velocity limit.
        joint_acceleration_max: rad/s^2, bound that the joint limits may ask for at most.
    """

    friction: float = 0.6
    friction_facets: int = 8
    normal_force_min: float = 0.1
    normal_force_max: float = 25.0
    joint_horizon: float = 0.05
    joint_acceleration_max: float = 2000.0

    def __post_init__(self) -> None:
        """Refuse values that no contact can have."""
        for name in ("friction", "normal_force_max", "joint_horizon", "joint_acceleration_max"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise InputError(name, value, "a positive number")
        if self.friction_facets < 3:
            raise InputError("friction_facets", self.friction_facets, "at least 3")
        if not 0 <= self.normal_force_min < self.normal_force_max:
            raise InputError("normal_force_min", self.normal_force_min, f"between 0 and {self.normal_force_max}")


def friction_pyramid(friction: float, facets: int) -> Array:
    """Rows ``F`` with ``F f <= 0`` exactly for the regular pyramid inscribed in the friction cone.

    An outer pyramid lets diagonal forces exceed the cone and the feet slip; inscribed, its half-width is
    ``mu cos(pi / facets)`` and its edges lie on the cone.

    Args:
        friction: Coulomb coefficient.
        facets: number of sides; a side faces each axis when it is a multiple of 4.

    Returns:
        (facets, 3) matrix.
    """
    angles = 2.0 * np.pi * np.arange(facets) / facets
    width = friction * np.cos(np.pi / facets)
    return np.column_stack([np.cos(angles), np.sin(angles), np.full(facets, -width)])


class QpAssembly:
    """The QP's matrices in preallocated buffers.

    Attributes:
        hessian: (n, n) with n = nv + 3 nc.
        gradient: (n,).
        equality: (ne, n) and equality_rhs (ne,): floating-base dynamics (ne = 6, or nv - nu in general).
        inequality: (m, n) with lower (m,) and upper (m,): torques, then friction.
        box_lower, box_upper: (n,).
    """

    def __init__(
        self,
        robot: Robot,
        stack: TaskStack,
        limits: WholeBodyLimits,
        force_weight: float,
        acceleration_weight: float,
    ) -> None:
        nv, nu, nc = robot.nv, robot.nu, len(robot.contact_ids)
        n, base = nv + 3 * nc, nv - nu
        facets = limits.friction_facets
        self._nv, self._base = nv, base
        self._stack, self._limits = stack, limits
        self._force_weight = force_weight
        self._effort = robot.effort_limit
        self._velocity_limit = robot.velocity_limit
        self._joint_lower, self._joint_upper = robot.joint_lower, robot.joint_upper
        self.hessian = np.zeros((n, n))
        self.gradient = np.zeros(n)
        self.equality = np.zeros((base, n))
        self.equality_rhs = np.zeros(base)
        self.inequality = np.zeros((nu + facets * nc, n))
        self.lower = np.full(nu + facets * nc, -_UNBOUNDED)
        self.upper = np.zeros(nu + facets * nc)
        self.box_lower = np.full(n, -_UNBOUNDED)
        self.box_upper = np.full(n, _UNBOUNDED)
        self._base_force = np.zeros(base)
        self._weighted = np.zeros_like(stack.jacobian)
        self._regularisation = acceleration_weight * np.eye(nv)
        self.hessian[nv:, nv:] = force_weight * np.eye(3 * nc)
        pyramid = friction_pyramid(limits.friction, facets)
        for i in range(nc):
            self.inequality[nu + facets * i : nu + facets * (i + 1), nv + 3 * i : nv + 3 * i + 3] = pyramid
        self._normal_lower, self._normal_upper = self.box_lower[nv + 2 :: 3], self.box_upper[nv + 2 :: 3]

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the QP of this tick; the task stack must have been updated."""
        nv = self._nv
        stack = self._stack
        np.multiply(stack.jacobian, stack.weight[:, None], out=self._weighted)
        np.add(self._weighted.T @ stack.jacobian, self._regularisation, out=self.hessian[:nv, :nv])
        np.negative(stack.rhs @ self._weighted, out=self.gradient[:nv])
        np.multiply(reference.contact_forces.ravel(), -self._force_weight, out=self.gradient[nv:])
        self._dynamics(terms, reference)
        self._joint_bounds(terms)
        np.multiply(reference.stance, self._limits.normal_force_min, out=self._normal_lower)
        np.multiply(reference.stance, self._limits.normal_force_max, out=self._normal_upper)

    def torques(self, terms: WholeBodyTerms, solution: Array) -> Array:
        """Joint torques (nu,) that produce the QP's accelerations and forces: ``M_j a + h_j - J_cj^T f``."""
        rows = self._effort.size
        torques: Array = self.inequality[:rows] @ solution + terms.bias[self._base :]
        return torques

    def _external_force(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> Array:
        """Generalised force on the base of the external wrench, which is given about the centre of mass."""
        force, moment = reference.external_wrench[:3], reference.external_wrench[3:]
        x, y, z = terms.com - terms.q[:3]
        about_base = moment + (y * force[2] - z * force[1], z * force[0] - x * force[2], x * force[1] - y * force[0])
        generalised = self._base_force
        np.dot(force, terms.rotation, out=generalised[:3])
        np.dot(about_base, terms.rotation, out=generalised[3:])
        return generalised

    def _dynamics(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        nv, base, nu = self._nv, self._base, self._effort.size
        self.equality[:, :nv] = terms.mass_matrix[:base]
        self.equality[:, nv:] = terms.contact_jacobian[:, :base].T
        self.equality[:, nv:] *= -1.0
        np.subtract(self._external_force(terms, reference), terms.bias[:base], out=self.equality_rhs)
        torque_rows = self.inequality[:nu]
        torque_rows[:, :nv] = terms.mass_matrix[base:]
        torque_rows[:, nv:] = terms.contact_jacobian[:, base:].T
        torque_rows[:, nv:] *= -1.0
        bias = terms.bias[base:]
        np.subtract(-self._effort, bias, out=self.lower[:nu])
        np.subtract(self._effort, bias, out=self.upper[:nu])

    def _joint_bounds(self, terms: WholeBodyTerms) -> None:
        """Acceleration bounds that keep each joint within its limits over ``joint_horizon``.

        ``a <= (v_max - v) / T`` and ``q + v T + a T^2 / 2 <= q_max``, and the same from below. A joint already past a
        limit is asked for at most ``joint_acceleration_max``, and the two sides never cross.
        """
        nu, horizon, cap = self._effort.size, self._limits.joint_horizon, self._limits.joint_acceleration_max
        joints, rates = terms.q[-nu:], terms.v[-nu:]
        ahead = joints + horizon * rates
        gain = 2.0 / horizon**2
        upper = np.minimum((self._velocity_limit - rates) / horizon, gain * (self._joint_upper - ahead))
        lower = np.maximum((-self._velocity_limit - rates) / horizon, gain * (self._joint_lower - ahead))
        box = slice(self._base, self._nv)
        np.maximum(np.minimum(upper, cap), -cap, out=upper)
        np.maximum(np.minimum(np.minimum(lower, upper), cap), -cap, out=lower)
        self.box_upper[box] = upper
        self.box_lower[box] = lower
