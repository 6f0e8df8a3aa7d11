"""Contact forward dynamics and its derivatives by Pinocchio's algorithms, for several stages at once.

Pinocchio is called once a stage and quantity; all that follows is linear algebra over the stages. With the contacts'
rows ``Phi J`` of flags Phi, compliance ``D = 1 - Phi + damping`` and ``g = -f``,

    [ M       (Phi J)^T ] [ a ]   [ B u - nle                            ]
    [ Phi J   -D        ] [ g ] = [ -Phi (dJ/dt v + Baumgarte's terms)   ],

and a and g change as the inverse of this matrix times the derivatives of the residual at constant a and g. Carpentier
and Mansard, "Analytical derivatives of rigid body dynamics algorithms", RSS 2018.

Rows of J are rows of the contact frames' Jacobians, or combinations of them along axes of a contact of size 1 or 2. Of
an axis d that turns with its frame, the rate of ``d . v`` in local axes is ``d . (a - omega x v)``, with the spatial
acceleration in brackets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from lgmpc.actions.contacts import ContactSet
from lgmpc.actions.dynamics import actuated
from lgmpc.lie import quaternion, so3
from lgmpc.typing import Array

__all__ = ["ContactSolution", "PinocchioContactDynamics"]


@dataclass(frozen=True, eq=False)
class _Frames:
    """The contact frames of n stages (c of them), in local axes unless said otherwise.

    Attributes:
        rotations: (n, c, 3, 3) from local to world axes.
        positions: (n, c, 3) world.
        twists: (n, c, 6) velocities, linear first.
        drifts: (n, c, 6) classical accelerations at a = 0.
        jacobians: (n, c, 6, nv).
    """

    rotations: Array
    positions: Array
    twists: Array
    drifts: Array
    jacobians: Array


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Solutions of the equations of motion of n stages.

    Attributes:
        z: (n, nv + nf) accelerations and forces.
        inverse: (n, nv + nf, nv + nf) of the matrix above.
        frames: of the contacts.
        errors: (n, c, 6) position and rotation vector between a contact and where it is held, world axes.
    """

    z: Array
    inverse: Array
    frames: _Frames
    errors: Array


class PinocchioContactDynamics:
    """The equations above for one robot with contacts.

    A stage whose equations are singular or not finite has solutions and derivatives that are NaN.

    Args:
        model: the robot; all joints but a free base are actuated.
        contacts: its contacts.
    """

    def __init__(self, model: pin.Model, contacts: ContactSet) -> None:
        self.model = model
        self._data = model.createData()
        self._nv = int(model.nv)
        self._still = np.zeros(self._nv)
        self._joints = actuated(model)
        self._ids = [int(model.getFrameId(contact.frame)) for contact in contacts.contacts]
        sizes = [contact.size for contact in contacts.contacts]
        self._of_row = np.repeat(np.arange(len(sizes)), sizes)
        # Of each row, the factors of all frames' quantities in world axes, and in the frames' own.
        self._world, self._own = np.zeros((2, sum(sizes), 6 * len(sizes)))
        row = 0
        for i, contact in enumerate(contacts.contacts):
            if contact.size >= 3:
                self._world[row : row + contact.size, 6 * i : 6 * i + contact.size] = np.eye(contact.size)
            else:
                held = np.reshape(contact.axes + contact.frame_axes, (-1, 3))
                own = row + len(contact.axes)
                self._world[row:own, 6 * i : 6 * i + 3] = held[: len(contact.axes)]
                self._own[own : row + contact.size, 6 * i : 6 * i + 3] = held[len(contact.axes) :]
            row += contact.size
        self._surfaces = [i for i, size in enumerate(sizes) if size == 6]
        # Wrenches of the contact frames, in their axes, to the joints that carry them, in the joints' axes.
        frames = [model.frames[i] for i in self._ids]
        self._bodies = sorted({int(frame.parentJoint) for frame in frames})
        self._onto_bodies = np.zeros((6 * len(self._bodies), 6 * len(frames)))
        for i, frame in enumerate(frames):
            row = 6 * self._bodies.index(int(frame.parentJoint))
            self._onto_bodies[row : row + 6, 6 * i : 6 * i + 6] = frame.placement.toDualActionMatrix()
        self._external = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])

    def solve(self, xs: Array, us: Array, values: Mapping[str, Array]) -> ContactSolution:
        """Solve for accelerations and forces.

        Args:
            xs: (n, nx) states.
            us: (n, nu) controls.
            values: (n, size) each parameter.
        """
        nv, flags = self._nv, self._flags(values)
        matrix, effort, frames = self._equations(xs)
        effort[:, self._joints] += us
        errors = self._errors(frames, values)
        stiffness, damping = (gain[..., None] for gain in _gains(values))
        local = (frames.drifts + damping * frames.twists)[..., None]
        pulled = _turned(frames.rotations, local) + (stiffness * errors)[..., None]
        local[..., :3, 0] -= np.cross(frames.twists[..., 3:], frames.twists[..., :3])
        held = flags * self._selected(pulled, local)[:, :, 0]
        rows = flags[:, :, None] * self._selected(_turned(frames.rotations, frames.jacobians), frames.jacobians)
        matrix[:, nv:, :nv], matrix[:, :nv, nv:] = rows, np.swapaxes(rows, 1, 2)
        diagonal = np.arange(nv, nv + flags.shape[1])
        matrix[:, diagonal, diagonal] = flags - 1.0 - values["contact_damping"]
        inverse = _inverse(matrix)
        z = (inverse @ np.concatenate([effort, -held], axis=1)[:, :, None])[:, :, 0]
        z[:, nv:] *= -1.0
        return ContactSolution(z, inverse, frames, errors)

    def slopes(self, xs: Array, solution: ContactSolution, values: Mapping[str, Array]) -> Array:
        """Return (n, nv + nf, ndx + nu) the derivatives of accelerations and forces.

        Args:
            xs: (n, nx) states.
            solution: at these states.
            values: (n, size) each parameter.
        """
        n, nv, flags, frames = len(xs), self._nv, self._flags(values), solution.frames
        forces = flags * solution.z[:, nv:]
        still = (forces @ self._world).reshape(n, -1, 6, 1)  # along axes that do not turn
        wrenches = _turned(np.swapaxes(frames.rotations, -1, -2), still)[..., 0]
        right = np.empty((n, solution.z.shape[1], 2 * nv))
        own = (forces @ self._own).reshape(n, -1, 6)
        velocity_by_q, by_q, by_v = self._derivatives(xs, solution.z[:, :nv], wrenches + own, right[:, :nv])
        right[:, :nv, :nv] += self._turning(frames, wrenches)
        spin, sweep = so3.hat.unchecked(frames.twists[..., 3:]), so3.hat.unchecked(frames.twists[..., :3])
        jacobian, turn = frames.jacobians, frames.jacobians[..., 3:, :]
        stiffness, damping = (gain[..., None, None] for gain in _gains(values))
        local_by_q, local_by_v = by_q + damping * velocity_by_q, by_v + damping * jacobian
        # Classical acceleration: spatial plus omega x v. In axes that turn by theta a vector w changes by w x theta.
        acceleration = frames.drifts + (jacobian @ solution.z[:, None, :nv, None])[..., 0]
        by_q[..., :3, :] += spin @ velocity_by_q[..., :3, :] - sweep @ velocity_by_q[..., 3:, :]
        by_v[..., :3, :] += spin @ jacobian[..., :3, :] - sweep @ turn
        by_q -= _crossed(acceleration, turn)
        by_q += damping * (velocity_by_q - _crossed(frames.twists, turn))
        by_v += damping * jacobian
        by_q[..., :3, :] += stiffness * jacobian[..., :3, :]
        by_q, by_v = _turned(frames.rotations, by_q), _turned(frames.rotations, by_v)
        if self._surfaces:
            s = self._surfaces
            back = so3.left_jacobian_inverse.unchecked(solution.errors[:, s, 3:])
            by_q[:, s, 3:] += stiffness[:, s] * (back @ (frames.rotations[:, s] @ turn[:, s]))
        right[:, nv:, :nv] = flags[:, :, None] * self._selected(by_q, local_by_q)
        right[:, nv:, nv:] = flags[:, :, None] * self._selected(by_v, local_by_v)
        slopes = np.concatenate([-(solution.inverse @ right), solution.inverse[:, :, self._joints]], axis=2)
        slopes[:, nv:] *= -1.0
        return slopes

    def _flags(self, values: Mapping[str, Array]) -> Array:
        """Return (n, nf)."""
        return values["contact_flags"][:, self._of_row]

    def _selected(self, world: Array, local: Array) -> Array:
        """Return the rows (n, nf, m) that have a force, of (n, c, 6, m) in world and in local axes."""
        n, *_, columns = world.shape
        rows: Array = self._world @ world.reshape(n, -1, columns)
        if self._own.any():
            rows += self._own @ local.reshape(n, -1, columns)
        return rows

    def _equations(self, xs: Array) -> tuple[Array, Array, _Frames]:
        """Return the matrix with M alone, ``-nle``, and the contact frames."""
        model, data, ids, nq, nv = self.model, self._data, self._ids, self.model.nq, self._nv
        n, c, size = len(xs), len(ids), nv + self._of_row.size
        matrix, effort = np.zeros((n, size, size)), np.empty((n, nv))
        rotations, positions = np.empty((n, c, 3, 3)), np.empty((n, c, 3))
        twists, drifts, jacobians = np.empty((n, c, 6)), np.empty((n, c, 6)), np.empty((n, c, 6, nv))
        for k, x in enumerate(xs):
            q, v = x[:nq], x[nq:]
            matrix[k, :nv, :nv] = pin.crba(model, data, q)
            effort[k] = pin.nonLinearEffects(model, data, q, v)
            pin.forwardKinematics(model, data, q, v, self._still)
            pin.computeJointJacobians(model, data)
            for i, frame in enumerate(ids):
                place = pin.updateFramePlacement(model, data, frame)
                rotations[k, i], positions[k, i] = place.rotation, place.translation
                twists[k, i] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).vector
                drifts[k, i] = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).vector
                jacobians[k, i] = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
        np.negative(effort, out=effort)
        mass = matrix[:, :nv, :nv]  # crba writes the upper triangle
        matrix[:, :nv, :nv] = np.triu(mass) + np.swapaxes(np.triu(mass, 1), 1, 2)
        return matrix, effort, _Frames(rotations, positions, twists, drifts, jacobians)

    def _derivatives(self, xs: Array, a: Array, wrenches: Array, right: Array) -> tuple[Array, Array, Array]:
        """Write the derivatives of RNEA by q and v with forces constant in the joints' axes (n, nv, 2 nv).

        Returns:
            the derivatives (n, c, 6, nv) of the contact frames' velocities by q, of their spatial accelerations by q
            and by v, in local axes.
        """
        model, data, nq, nv = self.model, self._data, self.model.nq, self._nv
        n, c = wrenches.shape[:2]
        bodies = (wrenches.reshape(n, -1) @ self._onto_bodies.T).reshape(n, -1, 6)
        velocity_by_q, by_q, by_v = (np.empty((n, c, 6, nv)) for _ in range(3))
        for k, x in enumerate(xs):
            q, v = x[:nq], x[nq:]
            pin.computeForwardKinematicsDerivatives(model, data, q, v, a[k])
            for i, frame in enumerate(self._ids):
                found = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
                velocity_by_q[k, i], by_q[k, i], by_v[k, i] = found[:3]
            for joint, wrench in zip(self._bodies, bodies[k], strict=True):
                self._external[joint] = pin.Force(wrench)
            right[k, :, :nv], right[k, :, nv:], _ = pin.computeRNEADerivatives(model, data, q, v, a[k], self._external)
        return velocity_by_q, by_q, by_v

    def _turning(self, frames: _Frames, wrenches: Array) -> Array:
        """Return (n, nv, nv) the rest of d(-J^T f)/dq when forces are held constant in the joints' axes.

        A force that is constant in world axes changes in axes that turn by theta by ``f x theta``.
        """
        n, nv = len(wrenches), self._nv
        turned = _crossed(wrenches, frames.jacobians[..., 3:, :]).reshape(n, -1, nv)
        rest: Array = -np.swapaxes(frames.jacobians.reshape(n, -1, nv), 1, 2) @ turned
        return rest

    def _errors(self, frames: _Frames, values: Mapping[str, Array]) -> Array:
        errors = np.zeros_like(frames.twists)
        errors[..., :3] = frames.positions - values["contact_points"].reshape(frames.positions.shape)
        if self._surfaces:
            goals = values["contact_orientations"].reshape(len(errors), -1, 4)
            turned = frames.rotations[:, self._surfaces] @ np.swapaxes(quaternion.to_matrix.unchecked(goals), -1, -2)
            # One after the other: logarithms of few rotations take longer as arrays.
            for k, i in np.ndindex(*turned.shape[:2]):
                errors[k, self._surfaces[i], 3:] = so3.log.unchecked(turned[k, i])
        return errors


def _gains(values: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return stiffness and damping (n, c) of each contact."""
    gains = values["contact_gains"]
    return gains[:, ::2], gains[:, 1::2]


def _turned(rotations: Array, columns: Array) -> Array:
    """Return (..., 6, m) pairs of 3-vectors, rotated."""
    pairs = columns.reshape(*columns.shape[:-2], 2, 3, columns.shape[-1])
    return (rotations[..., None, :, :] @ pairs).reshape(columns.shape)


def _crossed(pairs: Array, columns: Array) -> Array:
    """Return (..., 6, m) the cross products of pairs of 3-vectors (..., 6) with columns (..., 3, m)."""
    skews = so3.hat.unchecked(pairs.reshape(*pairs.shape[:-1], 2, 3))
    return (skews @ columns[..., None, :, :]).reshape(*pairs.shape, columns.shape[-1])


def _inverse(matrices: Array) -> Array:
    """Return the inverses (n, m, m) of symmetric indefinite matrices, which are overwritten; NaN of singular ones."""
    for matrix in matrices:
        factors, pivots, failed = lapack.dsytrf(matrix.T, overwrite_a=True)
        if not failed:
            matrix.T[...], failed = lapack.dsytri(factors, pivots, overwrite_a=True)
        if failed:
            matrix[...] = np.nan
    inverses: Array = np.tril(matrices) + np.swapaxes(np.tril(matrices, -1), 1, 2)
    return inverses
