"""Everything about the robot that one tick of the whole-body QP needs, from Pinocchio, in preallocated buffers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["WholeBodyTerms"]


class WholeBodyTerms:
    """Dynamics and Jacobians at the measured state, refreshed by :meth:`update`.

    The contact point of a spherical foot is the lowest point of the sphere, ``p = p_frame - r e_z``. Rolling without
    slipping holds the velocity of that material point at zero, ``v_frame + omega x (-r e_z) = 0``; as ``-r e_z`` does
    not move, its derivative is ``a_frame + alpha x (-r e_z) = 0``, which gives the Jacobian and the drift used here.

    Attributes:
        q: (nq,) configuration of the last update.
        v: (nv,) velocity of the last update.
        mass_matrix: (nv, nv) joint-space inertia, armature included.
        bias: (nv,) Coriolis, centrifugal and gravity terms.
        momentum_matrix: (6, nv) centroidal momentum matrix ``A_G``, linear rows first.
        momentum: (6,) centroidal momentum [linear; angular], world axes.
        momentum_drift: (6,) ``A_G' v``.
        com: (3,) centre of mass, world.
        contact_jacobian: (3 nc, nv) of the contact points, world axes.
        contact_drift: (3 nc,) acceleration of the contact points at zero joint-space acceleration.
        contact_points: (nc, 3) world positions of the contact points.
        rotation: (3, 3) base orientation, body to world.
    """

    def __init__(self, robot: Robot) -> None:
        nc, nv = len(robot.contact_ids), robot.nv
        self.robot = robot
        self._data = data = robot.create_data()
        self._no_acceleration = np.zeros(nv)
        self._radius = robot.contact_radius
        self._frame_jacobians = np.zeros((nc, 6, nv))
        self._frame_drifts = np.zeros((nc, 6))
        self.q = robot.q_reference.copy()
        self.v = np.zeros(nv)
        # Pinocchio writes these in place, so views of its memory are always current and cost nothing.
        self.mass_matrix: Array = data.M
        self.bias: Array = data.nle
        self.momentum_matrix: Array = data.Ag
        self.com: Array = data.com[0]
        self.momentum = np.zeros(6)
        self.momentum_drift = np.zeros(6)
        self.contact_jacobian = np.zeros((3 * nc, nv))
        self.contact_drift = np.zeros(3 * nc)
        self.contact_points = np.zeros((nc, 3))
        self.rotation = np.eye(3)
        self.update(self.q, self.v)

    def update(self, q: Array, v: Array) -> None:
        """Recompute every term at configuration ``q`` (nq,) and velocity ``v`` (nv,)."""
        model, data = self.robot.model, self._data
        self.q[:] = q
        self.v[:] = v
        pin.crba(model, data, q)
        pin.nonLinearEffects(model, data, q, v)
        np.dot(pin.dccrba(model, data, q, v), v, out=self.momentum_drift)
        np.dot(self.momentum_matrix, v, out=self.momentum)
        pin.forwardKinematics(model, data, q, v, self._no_acceleration)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        self.rotation[:] = data.oMi[1].rotation
        self._update_contacts()

    @property
    def rotational_inertia(self) -> Array:
        """(3, 3) inertia about the centre of mass of the robot as one rigid body, world axes, kg.m2."""
        inertia: Array = self._data.Ig.inertia
        return inertia

    def _update_contacts(self) -> None:
        model, data, aligned = self.robot.model, self._data, pin.LOCAL_WORLD_ALIGNED
        frames, jacobians, drifts = data.oMf, self._frame_jacobians, self._frame_drifts
        for i, frame in enumerate(self.robot.contact_ids):
            jacobians[i] = pin.getFrameJacobian(model, data, frame, aligned)
            drifts[i] = pin.getFrameClassicalAcceleration(model, data, frame, aligned).np
            self.contact_points[i] = frames[frame].translation
        self.contact_points[:, 2] -= self._radius
        # omega x (-r e_z) = (-r omega_y, r omega_x, 0), for the Jacobian's columns and for the drift alike
        jacobian = self.contact_jacobian.reshape(-1, 3, self.v.size)
        jacobian[:] = jacobians[:, :3]
        jacobian[:, 0] -= self._radius * jacobians[:, 4]
        jacobian[:, 1] += self._radius * jacobians[:, 3]
        drift = self.contact_drift.reshape(-1, 3)
        drift[:] = drifts[:, :3]
        drift[:, 0] -= self._radius * drifts[:, 4]
        drift[:, 1] += self._radius * drifts[:, 3]
