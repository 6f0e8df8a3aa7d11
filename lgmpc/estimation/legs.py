"""Positions, rates and forces of the feet, from joint encoders and motor currents."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.compile import compile_function
from lgmpc.errors import InputError
from lgmpc.lie.symbolic import quaternion
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

__all__ = ["ContactDetector", "LegSensing"]

_DAMPING = 1e-5
"""m2; a stretched leg's torques do not depend on the force along it: the estimate tends to zero, not to infinity."""


class LegSensing:
    r"""Foot positions with their covariance, foot rates and foot forces, from the joints (Hartley et al. 2020).

    The position ``h(s)`` of a contact frame in the base has the covariance ``J Sigma J^T + sigma_f^2 I`` with the
    foot's Jacobian J, the encoders' ``Sigma = sigma_e^2 I``, and ``sigma_f`` for what the kinematic model leaves out.
    The force balances the joint torques and the legs' weight at rest, ``J^T f = g(s) - tau`` in the least-squares
    sense: right where each leg has its own joints and little inertia (Solo12: no foot sensors, but motor currents).

    Args:
        robot: a robot with a floating base, joints of one coordinate each, and contact frames.
        encoder_noise: standard deviation of a joint angle, rad.
        foot_noise: standard deviation of the model's error of a foot position in each axis, m; above zero.
        progress: called with a description of what is being compiled.

    Attributes:
        positions: (nc, 3) base to contact frames, base axes, m; live, as all that follow.
        covariances: (nc, 3, 3) of the positions, m2.
        rates: (nc, 3) angular velocities of the feet relative to the base, base axes, rad/s.
        forces: (nc, 3) forces on the robot, world axes, N.

    Raises:
        InputError: a robot of another kind, or noise that cannot be.
    """

    def __init__(
        self,
        robot: Robot,
        encoder_noise: float,
        foot_noise: float,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        if not robot.floating_base or robot.nq - 7 != robot.nu or robot.nc == 0:
            expected = "a robot with a floating base, joints of one coordinate each, and contact frames"
            raise InputError("robot", robot.name, expected)
        if not (math.isfinite(encoder_noise) and encoder_noise >= 0.0):
            raise InputError("encoder_noise", encoder_noise, "an angle that is not negative")
        if not (math.isfinite(foot_noise) and foot_noise > 0.0):
            raise InputError("foot_noise", foot_noise, "a positive length")
        self._function = compile_function(_leg_function(robot), progress=progress)
        self._joints, self._speeds, self._torques, self._rotation, variances = self._function.inputs
        variances[:] = encoder_noise**2, foot_noise**2
        nc = robot.nc
        positions, covariances, rates, forces = self._function.outputs
        self.positions, self.rates, self.forces = positions.T, rates.T, forces.T
        self.covariances: Array = covariances.T.reshape(nc, 3, 3)

    def update(self, joints: Array, speeds: Array, torques: Array, rotation: Array) -> None:
        """Take joint angles, rates and torques (nu,), and the base's orientation (3, 3), body to world."""
        self._joints[:] = joints
        self._speeds[:] = speeds
        self._torques[:] = torques
        self._rotation[:] = rotation
        self._function.run()


def _leg_function(robot: Robot) -> ca.Function:
    model, nu = robot.symbolic, robot.nu
    joints, speeds, torques = (ca.SX.sym(name, nu) for name in ("joints", "speeds", "torques"))
    rotation, variances = ca.SX.sym("rotation", 3, 3), ca.SX.sym("variances", 2)
    level = ca.vertcat(ca.SX.zeros(6), 1.0, joints)  # the base's own axes
    tilted = ca.vertcat(ca.SX.zeros(3), quaternion.from_matrix(rotation), joints)
    unbalanced = model.gravity(tilted)[6:] - torques
    positions, covariances, rates, forces = [], [], [], []
    for frame in robot.contact_ids:
        whole = model.frame_jacobian(level, frame, pin.LOCAL_WORLD_ALIGNED)[:, 6:]
        jacobian = whole[:3, :]
        square = jacobian @ jacobian.T
        positions.append(model.frame_placement(level, frame).translation)
        covariances.append(variances[0] * square + variances[1] * ca.SX.eye(3))
        rates.append(whole[3:, :] @ speeds)
        forces.append(rotation @ _solve(square + _DAMPING * ca.SX.eye(3), jacobian @ unbalanced))
    return ca.Function(
        "leg_sensing",
        [joints, speeds, torques, rotation, variances],
        [ca.horzcat(*each) for each in (positions, covariances, rates, forces)],
        ["joints", "speeds", "torques", "rotation", "variances"],
        ["positions", "covariances", "rates", "forces"],
    )


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return the solution of three equations by Cramer's rule."""
    a, b, c = (matrix[:, i] for i in range(3))
    over = 1.0 / ca.dot(a, ca.cross(b, c))
    return over * ca.vertcat(*(ca.dot(right, ca.cross(*pair)) for pair in ((b, c), (c, a), (a, b))))


class ContactDetector:
    """Which feet stand, from their normal forces: a switch with hysteresis for each.

    Args:
        feet: how many.
        touch_force: a foot that carries more than this has touched down, N.
        release_force: one that carries less has lifted off, N.

    Attributes:
        touching: (feet,) present estimate.

    Raises:
        InputError: no feet, or forces that are not ``0 <= release_force <= touch_force``.
    """

    def __init__(self, feet: int, touch_force: float, release_force: float) -> None:
        if feet < 1:
            raise InputError("feet", feet, "at least one")
        if not 0.0 <= release_force <= touch_force < math.inf:
            got = f"{release_force} with touch_force {touch_force}"
            raise InputError("release_force", got, "a force from 0 to touch_force, N")
        self._touch, self._release = touch_force, release_force
        self.touching = np.zeros(feet, dtype=np.bool_)

    def update(self, normal_forces: Array) -> BoolArray:
        """Take the feet's normal forces (feet,), N, and return which stand; one that is not finite changes nothing."""
        # Plain numbers: for a handful of feet they are faster than NumPy's calls.
        for foot, force in enumerate(normal_forces.tolist()):
            if force > self._touch:
                self.touching[foot] = True
            elif force < self._release:
                self.touching[foot] = False
        return self.touching

    def reset(self) -> None:
        """Set every foot in the air."""
        self.touching[:] = False
