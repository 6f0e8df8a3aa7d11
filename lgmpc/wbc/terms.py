"""Quantities of the robot for planning and feedback at the sensed state, in one compiled call."""

import math

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.robot.contact_points import ContactPoints
from lgmpc.typing import Array


class WholeBodyTerms:
    """Centre of mass, momentum, base and contact points, refreshed by :meth:`update`.

    Args:
        robot: a robot with a floating base, joints of one coordinate each, and contact frames.

    Attributes:
        robot: as given.
        q: (nq,) configuration of the last update.
        v: (nv,) velocity of the last update.
        com: (3,) centre of mass, world, m.
        momentum: (6,) centroidal momentum [linear; angular], world axes.
        momentum_matrix: (6, nv) centroidal momentum matrix ``A_G``, with which ``momentum = A_G v``.
        momentum_drift: (6,) ``A_G' v``.
        locked_inertia: (3, 3) ``A_G[3:, 3:6]``: angular momentum per angular velocity (body axes) of the base, with
            the joints locked.
        rotation: (3, 3) base orientation, body to world.
        normals: (nc, 3) unit normals of the surfaces under the feet, world axes; level until written to.
        contact_points: (nc, 3) world positions of the contact points, m.
        contact_velocities: (nc, 3) velocities of the material points in contact, world axes, m/s: zero unless a foot
            slides or lifts.
        finite: whether all of ``q`` and ``v`` is.
        x: of :attr:`com`, m; with y and z a plain number, as all that follow.
        px: linear momentum, N.s; with py.
        upright: cosine of the base's tilt.
        yaw: heading of the base, rad.

    Raises:
        InputError: if the robot has no floating base, no contact frames, or joints that ``v`` does not differentiate.
        CompileError: the compiler failed.
    """

    def __init__(self, robot: Robot) -> None:
        _check(robot)
        self.robot = robot
        self.q = robot.q_reference.copy()
        self.v = np.zeros(robot.nv)
        kernel = StageKernel.of(_terms, robot)
        memory = {name: np.zeros(size) for name, size in kernel.output_sizes.items()}
        self.normals = np.tile(robot.up, (robot.nc, 1))
        self._run = kernel.bind(1, q=self.q, v=self.v, normals=self.normals.reshape(-1), **memory)
        self.com, self.momentum, self.momentum_drift = (memory[k] for k in ("com", "momentum", "momentum_drift"))
        self.momentum_matrix = memory["momentum_matrix"].reshape(6, robot.nv)
        self.locked_inertia = self.momentum_matrix[3:, 3:6]
        self.rotation = memory["rotation"].reshape(3, 3)
        self.contact_points = memory["contact_points"].reshape(robot.nc, 3)
        self.contact_velocities = memory["contact_velocities"].reshape(robot.nc, 3)
        self._summary = memory["summary"]
        self.update(self.q, self.v)

    def update(self, q: Array, v: Array) -> None:
        """Recompute every term at configuration ``q`` (nq,) and velocity ``v`` (nv,)."""
        self.q[...] = q
        self.v[...] = v
        self._run()
        size, self.x, self.y, self.z, self.px, self.py, ahead, left, self.upright = self._summary.tolist()
        self.finite = math.isfinite(size)
        self.yaw = math.atan2(left, ahead)

    def momentum_rate(self, acceleration: Array) -> Array:
        """Return (6,) the rate of the momentum at a joint-space acceleration (nv,), ``A_G a + A_G' v``."""
        rate: Array = self.momentum_matrix.dot(acceleration)
        rate += self.momentum_drift
        return rate


def _terms(robot: Robot) -> ca.Function:
    model = robot.symbolic
    q, v, normals = ca.SX.sym("q", robot.nq), ca.SX.sym("v", robot.nv), ca.SX.sym("normals", 3 * robot.nc)
    contacts = ContactPoints(robot, q, v, normals)
    com, momentum, rotation = model.com(q), model.momentum(q, v), model.joint_placement(q, 1).rotation
    # Matrices are stored row by row, as numpy has them.
    outputs = {
        "com": com,
        "momentum": momentum,
        "momentum_matrix": model.momentum_matrix(q).T,
        "momentum_drift": model.momentum_rate(q, v, None),
        "rotation": rotation.T,
        "contact_points": contacts.positions(),
        "contact_velocities": contacts.velocities(),
        "summary": ca.vertcat(ca.sumsqr(q) + ca.sumsqr(v), com, momentum[:2], rotation[:2, 0], rotation[2, 2]),
    }
    given = {"q": q, "v": v, "normals": normals}
    return ca.Function("wbc_terms", list(given.values()), ca.cse(list(outputs.values())), list(given), list(outputs))


def _check(robot: Robot) -> None:
    """Raise for robots that the whole-body QP does not support."""
    if not robot.floating_base:
        raise InputError("robot", f"{robot.name} with a fixed base", "a robot with a floating base")
    if robot.nq - 7 != robot.nu:
        raise InputError("robot", f"{robot.name} with continuous or spherical joints", "joints of one coordinate each")
    if not robot.contact_ids:
        raise InputError("robot", f"{robot.name} without contact frames", "a robot with contact frames")
