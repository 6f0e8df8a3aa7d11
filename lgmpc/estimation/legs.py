"""Positions, motion and forces of the feet, from joint encoders, motor currents and the IMU."""

import math

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.compile import StageKernel
from lgmpc.control.interface import Measurement
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of, number, whole
from lgmpc.robot import Robot, leg_joints
from lgmpc.robot.feet import UP
from lgmpc.robot.friction import joint_friction_torque
from lgmpc.typing import Array, BoolArray, instance

_DAMPING = 1e-5
"""Regularisation, m2: torques of a stretched leg do not depend on the force along it, whose estimate tends to zero."""


class LegSensing:
    r"""Foot positions with their covariance, foot motion and foot forces, from joints and IMU (Hartley et al. 2020).

    The position ``h(s)`` of a contact frame in the base has the covariance ``J Sigma J^T + sigma_f^2 I`` with the
    foot's Jacobian J, the encoders' ``Sigma = sigma_e^2 I``, and ``sigma_f`` for errors of the kinematic model.

    The forces follow from the joint torques in least squares, ``J^T f = M (a, s'') + h - tau`` (joint rows). The
    inertia of the legs is included, without which swinging legs would seem to be in contact, as is the known
    friction of the joints. The accelerations require no estimate: the accelerometer measures that of the base minus
    gravity, and differences of two readings are means over the time between them, as are the torques. Each leg must
    have its own joints.

    Args:
        robot: a robot with a floating base, joints of one coordinate each, and contact frames.
        period: time between two readings, s.
        encoder_noise: standard deviation of a joint angle, rad.
        foot_noise: standard deviation of the model's error of a foot position in each axis, m; above zero.

    Attributes:
        positions: (nc, 3) base to contact frames, base axes, m; a live view, as all that follow.
        covariances: (nc, 3, 3) of the positions, m2.
        rates: (nc, 3) angular velocities of the feet relative to the base, base axes, rad/s.
        velocities: (nc, 3) of the material points in contact, world axes, m/s: zero unless feet slide or lift.
        spreads: (nc, 3, 3) covariance of :attr:`velocities` per variance of a joint's speed, world axes, m2.
        forces: (nc, 3) forces on the robot, world axes, N.
        normals: (nc, 3) unit normals of the surfaces under the feet, world axes, to be written to; level at first.

    Raises:
        InputError: a robot of another kind, a period that is not positive, or negative noise.
    """

    def __init__(self, robot: Robot, period: float, encoder_noise: float, foot_noise: float) -> None:
        instance("robot", robot, Robot)
        if not robot.floating_base or robot.nq - 7 != robot.nu or robot.nc == 0:
            expected = "a robot with a floating base, joints of one coordinate each, and contact frames"
            raise InputError("robot", robot.name, expected)
        number("encoder_noise", encoder_noise, "an angle that is not negative", 0.0)
        number("foot_noise", foot_noise, "a positive length", above=0.0)
        self._rate = 1.0 / duration_of("period", period)
        kernel = StageKernel.of(_leg_function, robot)
        memory = {name: np.zeros(size) for name, size in kernel.input_sizes.items()}
        self._joints, self._speeds, self._torques = (memory[name] for name in ("joints", "speeds", "torques"))
        self._gyro, self._accelerometer = memory["gyro"], memory["accelerometer"]
        self._faster, self._turning = memory["joint_acceleration"], memory["angular_acceleration"]
        self._rotation, self._velocity = memory["rotation"].reshape(3, 3).T, memory["velocity"]
        self.normals = memory["normals"].reshape(robot.nc, 3)
        self.normals[:] = UP
        memory["joint_friction"][:] = robot.joint_friction
        memory["variances"][:] = encoder_noise**2, foot_noise**2
        outputs = {name: np.zeros(size) for name, size in kernel.output_sizes.items()}
        self._run = kernel.bind(1, **memory, **outputs)
        self._patches, nc = robot.foot_points, robot.nc
        self.positions, self.rates, self.velocities, self.forces = (
            outputs[name].reshape(nc, 3) for name in ("positions", "rates", "velocities", "forces")
        )
        self.covariances: Array = outputs["covariances"].reshape(nc, 3, 3)
        self.spreads: Array = outputs["spreads"].reshape(nc, 3, 3)
        self._running = False

    def reset(self) -> None:
        """Discard the last reading: at the next one the accelerations are assumed to be zero."""
        self._running = False

    def load_noise(self, joints: Array, deviation: float) -> float:
        """Return the standard deviation of a vertical foot's load at rest by noise of the joints' speeds, N.

        Args:
            joints: (nu,) angles, at which the base is upright.
            deviation: standard deviation of a joint's speed, rad/s.

        Returns:
            The largest of all feet.
        """
        self.reset()
        self._joints[:], self._rotation[...], self._faster[:] = joints, np.eye(3), 0.0
        loads = []
        for change in (0.0, *(math.sqrt(2.0) * deviation * self._rate * np.eye(len(joints)))):
            self._faster[:] = change
            self._run()
            loads.append(self._patches.total(self.forces[:, 2]))
        return float(np.linalg.norm(np.subtract(loads[1:], loads[0]), axis=0).max())

    def update(
        self, reading: Measurement, rotation: Array, velocity: Array, gyro_bias: Array, periods: int = 1
    ) -> None:
        """Update from a reading of the sensors and the estimate of the base.

        Args:
            reading: of the sensors.
            rotation: (3, 3) of the base, body to world.
            velocity: (3,) of its origin, world axes, m/s.
            gyro_bias: (3,) rad/s.
            periods: since the last reading; more than one if readings were lost.
        """
        if self._running:
            rate = self._rate / periods
            np.subtract(reading.speeds, self._speeds, out=self._faster)
            self._faster *= rate
            # The difference of the mean rates of two intervals is the change of rate between their midpoints.
            np.subtract(reading.gyro, gyro_bias, out=self._turning)
            self._turning -= self._gyro
            self._turning *= rate
        else:
            self._faster[:] = self._turning[:] = 0.0
        self._running = True
        self._joints[:] = reading.joints
        self._speeds[:] = reading.speeds
        self._torques[:] = reading.torques
        np.subtract(reading.gyro, gyro_bias, out=self._gyro)
        self._accelerometer[:] = reading.accelerometer
        self._rotation[:] = rotation
        self._velocity[:] = velocity
        self._run()


def _leg_function(robot: Robot) -> ca.Function:
    model, nu = robot.symbolic, robot.nu
    sizes: dict[str, tuple[int, ...]] = dict.fromkeys(("joints", "speeds", "torques", "joint_acceleration"), (nu,))
    sizes |= dict.fromkeys(("gyro", "accelerometer", "angular_acceleration"), (3,)) | {"rotation": (3, 3)}
    sizes |= {"velocity": (3,), "variances": (2,), "joint_friction": (nu,), "normals": (3 * robot.nc,)}
    inputs = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
    joints, speeds, torques, faster, gyro, accelerometer, turning, rotation, velocity, *others = inputs.values()
    variances, friction, normals = others
    level = ca.vertcat(ca.SX.zeros(6), 1.0, joints)  # the base's own axes
    # In the base's own axes; its linear velocity, on which joint torques do not depend, is zero. The accelerometer
    # measures its acceleration minus gravity.
    accelerations = ca.vertcat(accelerometer + robot.gravity, turning, faster)
    unbalanced = model.rnea(level, ca.vertcat(ca.SX.zeros(3), gyro, speeds), accelerations)[6:] - torques
    unbalanced += joint_friction_torque(friction, speeds)
    outputs: dict[str, list[ca.SX]] = {
        name: [] for name in ("positions", "covariances", "rates", "velocities", "spreads", "forces")
    }
    jacobians: list[ca.SX] = []
    for i, frame in enumerate(robot.contact_ids):
        whole = model.frame_jacobian(level, frame, pin.LOCAL_WORLD_ALIGNED)[:, 6:]
        jacobian = whole[:3, :]
        square = jacobian @ jacobian.T
        position, rates = model.frame_placement(level, frame).translation, whole[3:, :] @ speeds
        moving = rotation @ (ca.cross(gyro, position) + jacobian @ speeds)
        rolling = ca.cross(rotation @ (gyro + rates), robot.foot_points.lever(normals[3 * i : 3 * i + 3]))
        outputs["positions"].append(position)
        outputs["covariances"].append(ca.vec(variances[0] * square + variances[1] * ca.SX.eye(3)))
        outputs["rates"].append(rates)
        outputs["velocities"].append(velocity + moving + rolling)
        outputs["spreads"].append(ca.vec(rotation @ square @ rotation.T))
        jacobians.append(jacobian)
    patches = robot.foot_points
    for first, count, frame in zip(patches.starts.tolist(), patches.counts.tolist(), robot.foot_ids, strict=True):
        leg = [robot.model.joints[joint].idx_v - 6 for joint in leg_joints(robot, frame)]
        forces = _least_forces(ca.vertcat(*jacobians[first : first + count]), unbalanced, leg)
        outputs["forces"] += [rotation @ force for force in ca.vertsplit(forces, 3)]
    results = ca.cse([ca.vertcat(*each) for each in outputs.values()])
    return ca.Function("leg_sensing", list(inputs.values()), results, list(inputs), list(outputs))


def _least_forces(jacobian: ca.SX, torques: ca.SX, leg: list[int]) -> ca.SX:
    """Return the smallest forces (3 k,) at the k points of a foot that balance the torques of a leg in least squares.

    Of the forces at the corners of a sole only the wrench is determined, by the six joints of its leg.
    """
    if jacobian.shape[0] == 3:
        return _solve(jacobian @ jacobian.T + _DAMPING * ca.SX.eye(3), jacobian @ torques)
    j = jacobian[:, leg]
    return j @ ca.solve(j.T @ j + _DAMPING * ca.SX.eye(len(leg)), torques[leg])


def normalised_square() -> ca.Function:
    """Return the square of a contact point's velocity, normalised by its covariance: the joints' and the base's."""
    velocity, spread, base, variance = (ca.SX.sym(name, n) for name, n in zip("vsbr", (3, 9, 9, 1), strict=True))
    covariance = variance * ca.reshape(spread, 3, 3) + ca.reshape(base, 3, 3)
    square = ca.dot(velocity, _solve(covariance, velocity))
    names = ["velocity", "spread", "base", "variance"]
    return ca.Function("normalised_square", [velocity, spread, base, variance], [square], names, ["square"])


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return the solution of three linear equations by Cramer's rule."""
    a, b, c = (matrix[:, i] for i in range(3))
    over = 1.0 / ca.dot(a, ca.cross(b, c))
    return over * ca.vertcat(*(ca.dot(right, ca.cross(*pair)) for pair in ((b, c), (c, a), (a, b))))


class ContactDetector:
    """Detects contacts of feet from their normal forces, with hysteresis.

    Args:
        feet: their number.
        touch_force: a larger normal force is a touchdown, N.
        release_force: a smaller one is a lift-off, N.

    Attributes:
        touching: (feet,) current contacts.

    Raises:
        InputError: no feet, or forces that are not ``0 <= release_force <= touch_force``.
    """

    def __init__(self, feet: int, touch_force: float, release_force: float) -> None:
        feet = whole("feet", feet, "at least one", 1)
        number("touch_force", touch_force, "a force that is not negative, N", 0.0)
        if number("release_force", release_force, "a force from 0 to touch_force, N", 0.0) > touch_force:
            got = f"{release_force} with touch_force {touch_force}"
            raise InputError("release_force", got, "a force from 0 to touch_force, N")
        self._touch, self._release = touch_force, release_force
        self.touching = np.zeros(feet, dtype=np.bool_)

    def update(self, normal_forces: Array) -> BoolArray:
        """Return the contacts for normal forces (feet,), N; one that is not finite changes nothing."""
        # Python floats: faster than NumPy for a few feet.
        for foot, force in enumerate(normal_forces.tolist()):
            if force > self._touch:
                self.touching[foot] = True
            elif force < self._release:
                self.touching[foot] = False
        return self.touching

    def reset(self) -> None:
        """Set every foot in the air."""
        self.touching[:] = False
