"""Build the whole-body QP from terms, tasks and limits: pure arithmetic, no solver.

Variables ``z = (a, f)``: joint-space acceleration (nv,) and contact forces (3 nc,), world axes, on the robot::

    minimise    1/2 ||J a - rhs||_W^2 + 1/2 w_f ||f - f_des||^2 + 1/2 w_a ||a||^2
    subject to  M_b a + h_b = J_cb^T f + w                      (floating-base rows of the dynamics)
                |M_j a + h_j - J_cj^T f| <= tau_max              (torque limits)
                friction pyramid inscribed in the cone           (each stance foot)
                bounds on joint accelerations and normal forces  (joint limits, contact)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.robot.friction import friction_pyramid
from lgmpc.typing import Array
from lgmpc.wbc.reference import WholeBodyReference
from lgmpc.wbc.tasks import TaskStack
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = ["QpAssembly", "WholeBodyLimits"]

_UNBOUNDED = 1e20  # what ProxQP takes for infinity


@dataclass(frozen=True)
class WholeBodyLimits:
    """Hard limits of the QP.

    Attributes:
        friction: Coulomb coefficient that the controller believes.
        friction_facets: sides of the pyramid inscribed in the friction cone.
        normal_force_min: N, each stance foot.
        normal_force_max: N, each stance foot.
        joint_horizon: s; a joint nears its position limits no faster than ``exp(-2 t / joint_horizon)``, its velocity
            limit no faster than ``exp(-t / joint_horizon)``, and so passes neither.
        joint_acceleration_max: rad/s^2, bound that the joint limits may ask for at most.
    """

    friction: float = 0.6
    friction_facets: int = 12
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


class QpAssembly:
    """The QP's matrices in preallocated buffers.

    Args:
        robot: the robot.
        stack: its tasks.
        limits: hard limits.
        force_weight: weight of staying near the reference contact forces.
        acceleration_weight: regularisation of joint-space accelerations.

    Attributes:
        hessian: (n, n) with n = nv + 3 nc.
        gradient: (n,).
        equality: (6, n) and equality_rhs (6,): floating-base dynamics.
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
        rows = nu + facets * nc
        self._nv, self._nu, self._base = nv, nu, base
        self._stack, self._limits = stack, limits
        self._force_weight, self._acceleration_weight = force_weight, acceleration_weight
        self._effort, self._negative_effort = robot.effort_limit, -robot.effort_limit
        self._joint_lower, self._joint_upper = robot.joint_lower, robot.joint_upper
        self._speeding = robot.velocity_limit / limits.joint_horizon
        self.hessian = np.zeros((n, n))
        self.gradient = np.zeros(n)
        # The dynamics' rows [M, -J_c^T] are written at once: the base's are equalities, the joints' limit torques.
        constraints = np.zeros((base + rows, n))
        self.equality, self.inequality = constraints[:base], constraints[base:]
        self._mass_block, self._force_block = constraints[:nv, :nv], constraints[:nv, nv:]
        self.equality_rhs = np.zeros(base)
        self.lower = np.full(rows, -_UNBOUNDED)
        self.upper = np.zeros(rows)
        self.box_lower = np.full(n, -_UNBOUNDED)
        self.box_upper = np.full(n, _UNBOUNDED)
        self._task_hessian = self.hessian[:nv, :nv]
        self._task_diagonal = np.einsum("ii->i", self._task_hessian)  # a view
        self._weighted = np.zeros_like(stack.jacobian)
        self._wrench = np.zeros((2, 3))
        self._wrench_on_base = np.zeros((2, 3))
        self.hessian[nv:, nv:] = force_weight * np.eye(3 * nc)
        pyramid = friction_pyramid(limits.friction, facets)
        self._friction = limits.friction
        self._pyramid_slopes: list[Array] = []
        for i in range(nc):
            block = self.inequality[nu + facets * i : nu + facets * (i + 1), nv + 3 * i : nv + 3 * i + 3]
            block[:] = pyramid
            self._pyramid_slopes.append(block[:, 2])
        self._joint_box_lower, self._joint_box_upper = self.box_lower[base:nv], self.box_upper[base:nv]
        self._stance: list[bool] = []
        self._normal_lower, self._normal_upper = self.box_lower[nv + 2 :: 3], self.box_upper[nv + 2 :: 3]

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the QP of this tick; the task stack must have been updated."""
        self._objective(reference)
        self._dynamics(terms, reference)
        self._joint_bounds(terms)
        friction = self._limits.friction if reference.friction is None else reference.friction
        if friction != self._friction:
            self._friction = friction
            for slopes in self._pyramid_slopes:
                slopes[:] = -friction * math.cos(math.pi / self._limits.friction_facets)
        stance = reference.stance.tolist()
        if stance != self._stance:
            self._stance = stance
            np.multiply(stance, self._limits.normal_force_min, out=self._normal_lower)
            np.multiply(stance, self._limits.normal_force_max, out=self._normal_upper)

    def torques(self, terms: WholeBodyTerms, solution: Array) -> Array:
        """Joint torques (nu,) that produce the QP's accelerations and forces: ``M_j a + h_j - J_cj^T f``."""
        torques: Array = np.dot(self.inequality[: self._nu], solution)
        torques += terms.bias[self._base :]
        return torques

    def _objective(self, reference: WholeBodyReference) -> None:
        nv, stack, weighted = self._nv, self._stack, self._weighted
        np.multiply(stack.jacobian, stack.weight[:, None], out=weighted)
        self._task_hessian[:] = np.dot(weighted.T, stack.jacobian)
        self._task_diagonal += self._acceleration_weight
        np.dot(stack.rhs, weighted, out=self.gradient[:nv])
        self.gradient[nv:] = reference.contact_forces.ravel()
        self.gradient[nv:] *= self._force_weight
        np.negative(self.gradient, out=self.gradient)

    def _dynamics(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        nu, base, bias = self._nu, self._base, terms.bias
        self._mass_block[:] = terms.mass_matrix
        np.negative(terms.contact_jacobian.T, out=self._force_block)
        np.subtract(self._external_force(terms, reference), bias[:base], out=self.equality_rhs)
        np.subtract(self._negative_effort, bias[base:], out=self.lower[:nu])
        np.subtract(self._effort, bias[base:], out=self.upper[:nu])

    def _external_force(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> Array:
        """Generalised force on the base of the external wrench, which is given about the centre of mass."""
        wrench = self._wrench
        wrench.ravel()[:] = reference.external_wrench
        x, y, z = (terms.com - terms.q[:3]).tolist()
        fx, fy, fz = wrench[0].tolist()
        wrench[1] += (y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)  # now about the base
        np.dot(wrench, terms.rotation, out=self._wrench_on_base)
        return self._wrench_on_base.ravel()

    def _joint_bounds(self, terms: WholeBodyTerms) -> None:
        """Acceleration bounds that keep each joint within its limits.

        With ``T`` the joint horizon: ``a <= (v_max - v) / T`` and ``a <= 4 (q_max - q - v T) / T^2``, and the same from
        below. The second is the approach ``(d/dt + 2 / T)^2 (q_max - q) >= 0``, critically damped: whatever begins no
        faster than ``2 (q_max - q) / T`` never passes the limit. A joint already past a limit is asked for at most
        ``joint_acceleration_max``, and the two sides never cross.
        """
        horizon, cap = self._limits.joint_horizon, self._limits.joint_acceleration_max
        joints, rates = terms.q[-self._nu :], terms.v[-self._nu :]
        ahead = rates * horizon
        ahead += joints
        slowing = rates / horizon
        gain = 4.0 / horizon**2
        upper, lower = self._joint_box_upper, self._joint_box_lower
        np.subtract(self._joint_upper, ahead, out=upper)
        upper *= gain
        np.minimum(upper, self._speeding - slowing, out=upper)
        np.maximum(upper, -cap, out=upper)
        np.subtract(self._joint_lower, ahead, out=lower)
        lower *= gain
        np.maximum(lower, -self._speeding - slowing, out=lower)
        np.minimum(lower, cap, out=lower)
        np.minimum(lower, upper, out=lower)
