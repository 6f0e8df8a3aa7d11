"""Everything about the robot that one tick of the whole-body QP needs, from Pinocchio, in preallocated buffers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["WholeBodyTerms"]

# p @ this = -[p]x, row by row: -[p]x w = w x p
_MINUS_SKEW = np.stack([-pin.skew(axis).ravel() for axis in np.eye(3)])


class WholeBodyTerms:
    """Dynamics and Jacobians at the measured state, refreshed by :meth:`update`.

    The contact point of a spherical foot is the lowest point of the sphere, ``p = p_frame - r e_z``. Rolling without
    slipping holds the velocity of that material point at zero, ``v_frame + omega x (-r e_z) = 0``; as ``-r e_z`` does
    not move, its derivative is ``a_frame + alpha x (-r e_z) = 0``, which gives the Jacobian and the drift used here.

    Args:
        robot: a robot with a floating base, joints of one coordinate each, and contact frames.

    Attributes:
        robot: as given.
        q: (nq,) configuration of the last update.
        v: (nv,) velocity of the last update.
        mass_matrix: (nv, nv) joint-space inertia, armature included.
        bias: (nv,) Coriolis, centrifugal and gravity terms.
        momentum_matrix: (6, nv) centroidal momentum matrix ``A_G``, linear rows first.
        momentum: (6,) centroidal momentum [linear; angular], world axes.
        momentum_drift: (6,) ``A_G' v``.
        com: (3,) centre of mass, world.
        rotation: (3, 3) base orientation, body to world.
        contact_jacobian: (3 nc, nv) of the contact points, world axes.
        contact_drift: (3 nc,) acceleration of the contact points at zero joint-space acceleration.
        contact_points: (nc, 3) world positions of the contact points.

    Raises:
        InputError: if the robot has no floating base, no contact frames, or joints that ``v`` does not differentiate.
    """

    def __init__(self, robot: Robot) -> None:
        _check(robot)
        nc, nv, radius = len(robot.contact_ids), robot.nv, robot.contact_radius
        self.robot = robot
        self._data = data = robot.create_data()
        self._no_acceleration = np.zeros(nv)
        self.q = robot.q_reference.copy()
        self.v = np.zeros(nv)
        # Pinocchio writes these in place, so views of its memory are always current and cost nothing.
        self.mass_matrix: Array = data.M
        self.bias: Array = data.nle
        self.momentum_matrix: Array = data.Ag
        self.momentum: Array = data.hg.np
        self.momentum_drift: Array = data.dhg.np
        self.com: Array = data.com[0]
        self.rotation: Array = data.oMi[1].rotation
        self._joint_jacobian: Array = data.J
        self._frame_positions: list[Array] = [data.oMf[frame].translation for frame in robot.contact_ids]
        self.contact_points = np.zeros((nc, 3))
        self.contact_jacobian = np.zeros((3 * nc, nv))
        self.contact_drift = np.zeros(3 * nc)
        # v_p = v_origin + omega x p = [1, -[p]x] twist: the identities stay, the p are written at every tick.
        self._shift = np.zeros((nc, 3, 6))
        self._shift[:, :, :3] = np.eye(3)
        self._support = np.repeat([_support(robot, frame) for frame in robot.contact_ids], 3, axis=0)
        self._frame_drifts = np.zeros((nc, 6))
        # [a_frame; alpha] @ this = a_frame + alpha x (-r e_z) = a_frame + (-r alpha_y, r alpha_x, 0)
        self._to_contact = np.vstack([np.eye(3), [[0.0, radius, 0.0], [-radius, 0.0, 0.0], [0.0, 0.0, 0.0]]])
        self.update(self.q, self.v)

    def update(self, q: Array, v: Array) -> None:
        """Recompute every term at configuration ``q`` (nq,) and velocity ``v`` (nv,)."""
        model, data = self.robot.model, self._data
        self.q[:] = q
        self.v[:] = v
        # In world convention, crba leaves the joint Jacobian, A_G and the centre of mass as well. The last but one is
        # h' at zero acceleration, A_G' v, and leaves h and the spatial accelerations of the bodies.
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, self._no_acceleration)
        pin.updateFramePlacements(model, data)
        self._update_contacts()

    @property
    def contact_velocities(self) -> Array:
        """(nc, 3) velocities of the material points in contact, world axes, m/s: zero unless a foot slides or lifts."""
        velocities: Array = (self.contact_jacobian @ self.v).reshape(-1, 3)
        return velocities

    def foot_centre(self, foot: int) -> tuple[Array, Array]:
        """Return Jacobian (3, nv) and drift (3,) of the centre of a foot's sphere, world axes.

        They differentiate ``contact_points[foot]`` of a foot in the air: the lowest point of a turning sphere moves as
        its centre does, not as the material point that happens to be lowest.
        """
        frame = self.robot.contact_ids[foot]
        jacobian: Array = pin.getFrameJacobian(self.robot.model, self._data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        return jacobian, self._frame_drifts[foot, :3]

    def _update_contacts(self) -> None:
        model, data, aligned = self.robot.model, self._data, pin.LOCAL_WORLD_ALIGNED
        points, drifts, shift = self.contact_points, self._frame_drifts, self._shift
        for i, frame in enumerate(self.robot.contact_ids):
            drifts[i] = pin.getFrameClassicalAcceleration(model, data, frame, aligned).np
            points[i] = self._frame_positions[i]
        points[:, 2] -= self.robot.contact_radius
        shift[:, :, 3:] = np.dot(points, _MINUS_SKEW).reshape(-1, 3, 3)
        np.dot(shift.reshape(-1, 6), self._joint_jacobian, out=self.contact_jacobian)
        self.contact_jacobian *= self._support
        np.dot(drifts, self._to_contact, out=self.contact_drift.reshape(-1, 3))


def _support(robot: Robot, frame: int) -> Array:
    """Return (nv,) ones for the degrees of freedom that move ``frame``, zeros for the others."""
    model = robot.model
    support = np.zeros(robot.nv)
    for joint in model.supports[model.frames[frame].parentJoint]:
        start = model.idx_vs[joint]
        support[start : start + model.nvs[joint]] = 1.0
    return support


def _check(robot: Robot) -> None:
    """Refuse robots that the whole-body QP is not made for."""
    if not robot.floating_base:
        raise InputError("robot", f"{robot.name} with a fixed base", "a robot with a floating base")
    if robot.nq - 7 != robot.nu:
        raise InputError("robot", f"{robot.name} with continuous or spherical joints", "joints of one coordinate each")
    if not robot.contact_ids:
        raise InputError("robot", f"{robot.name} without contact frames", "a robot with contact frames")
