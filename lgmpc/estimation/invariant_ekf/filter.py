"""The contact-aided invariant extended Kalman filter, on preallocated memory."""

import functools
import math
import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy import special

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError
from lgmpc.estimation.checks import duration_of, index_of, number, read_only, whole, write
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import programme
from lgmpc.estimation.invariant_ekf.forms import RIGHT, ErrorForm
from lgmpc.lie import checks
from lgmpc.typing import GRAVITY, Array, instance, numbers

_BASE_SIZES = {"pose": 12, "velocity": 3}


class InvariantEkf:
    r"""Base motion, contact points and IMU biases from an IMU and leg kinematics.

    The state is an extended pose in SE_{2+k}(3), columns velocity, position and k contact points (world axes), with a
    gyro and an accelerometer bias beside it (Hartley, Ghaffari, Eustice and Grizzle, IJRR 2020).
    Prediction is exact for body rates that are constant over a sample; without noise and biases, so are the error
    dynamics of both invariant forms, for errors of any size. Contact points are at rest
    except for slip, a white velocity noise, and the rolling of spherical feet.

    Position and yaw are not observable from feet: they drift, and the right-invariant form adds no false information
    about them: a shift or turn of the world is the same error at any estimate. The left-invariant form and the
    quaternion filter gain some by every correction. External poses of the base make both observable.

    All memory is allocated once: contacts are added and removed by flags, and no array changes its size.

    Args:
        contacts: k, number of feet.
        noise: densities of the IMU's noise.
        slip: density of the contact points' velocity noise, m/s/sqrt(Hz).
        gravity: (3,) world axes, m/s2.
        contact_offset: (3,) from a contact point to the frame that the kinematics measure, world axes, m: (0, 0, r) for
            spherical feet of radius r.
        form: :data:`RIGHT`, :data:`LEFT`, or :data:`MULTIPLICATIVE` for the quaternion filter.
        outlier_probability: of a foot whose errors are as assumed; feet whose innovations are less probable than this
            do not correct the estimate (chi-square test of the normalised innovation squared, Bar-Shalom, Li and
            Kirubarajan 2001, 5.4.2). 0: all feet correct it.

    Attributes:
        contact_offset: as given, to be written to where surfaces tilt.
        form: as given.
        contacts: as given.
        touching: (k,) which feet are in contact; read-only.
        innovations_squared: (k,) normalised innovation squared of each foot at the last :meth:`correct`, against the
            predicted state; chi-square distributed with three degrees of freedom if the errors are as assumed, 0 of
            feet that are not in contact; read-only.
        rejected: (k,) which feet did not correct the estimate then, because theirs is an outlier; read-only.
        pose: (5 + k, 5 + k) estimate, zero columns for open contacts; a live view, read-only as all that follow.
        rotation: (3, 3) base to world.
        velocity: (3,) of the base's origin, world axes, m/s.
        position: (3,) m.
        points: (3, k) contact points, world axes, m.
        gyro_bias: (3,) rad/s.
        accelerometer_bias: (3,) m/s2.
        covariance: (15 + 3k, 15 + 3k) of the form's error: rotation, velocity, position, contact points, gyro bias,
            accelerometer bias; zero rows for open contacts.

    Raises:
        InputError: an argument that is not valid.
    """

    def __init__(
        self,
        contacts: int,
        noise: ImuNoise | None = None,
        *,
        slip: float = 1e-2,
        gravity: Array | tuple[float, float, float] = (0.0, 0.0, -GRAVITY),
        contact_offset: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
        form: ErrorForm = RIGHT,
        outlier_probability: float = 0.0,
    ) -> None:
        contacts = whole("contacts", contacts, "at least one foot", 1)
        number("slip", slip, "a density that is not negative", 0.0)
        noise = ImuNoise() if noise is None else noise
        instance("noise", noise, ImuNoise)
        if not hasattr(form, "from_differences"):
            raise InputError("form", type(form).__name__, "RIGHT, LEFT or MULTIPLICATIVE")
        self.form, self.contacts = form, contacts
        columns, size = 5 + contacts, 15 + 3 * contacts
        self._state, self._scratch = (np.zeros(columns**2 + 6 + size**2) for _ in range(2))
        state, following = (_split_state(memory, columns, size) for memory in (self._state, self._scratch))
        self._pose, self._bias, self._covariance = state
        self._sample, self._rolling = np.zeros(6), np.zeros((contacts, 3))
        self._measured, self._spread = np.zeros((contacts, 3)), np.zeros((contacts, 3, 3))
        self._gate, self._squares = np.array([chi_square_bound(outlier_probability)]), np.zeros(contacts)
        self._flags, self._selected = np.zeros(contacts), np.zeros(contacts)
        self._used = np.zeros(contacts, dtype=np.bool_)
        self._one_point, self._one_noise = np.zeros(3), np.zeros((3, 3))
        self._height, self._given, self._square = np.zeros(2), np.zeros(15), np.zeros(1)
        offset = numbers("contact_offset", contact_offset, (3,), finite=True)
        densities = (*noise.densities, slip)
        gravity = numbers("gravity", gravity, (3,), finite=True)
        self._up = -gravity / max(float(np.linalg.norm(gravity)), sys.float_info.min)
        self._parameters = np.concatenate([[0.0], gravity, offset, np.square(densities)])
        self.contact_offset: Array = self._parameters[4:7]

        # Symmetric matrices are equal in row-major and column-major order; the pose is not symmetric.
        self._before = {"pose": _column_major(state[0]), "bias": state[1], "covariance": state[2].ravel()}
        self._after = {"pose_next": _column_major(following[0]), "covariance_next": following[2].ravel()}
        self._predict = StageKernel.of(programme.prediction, form, contacts).bind(
            1,
            **self._before,
            **self._after,
            sample=self._sample,
            rolling=self._rolling.ravel(),
            contact=self._flags,
            parameters=self._parameters,
        )
        self._correct = StageKernel.of(programme.correction, form, contacts).bind(
            1,
            **self._before,
            **self._after,
            bias_next=following[1],
            measured=self._measured.ravel(),
            noise=self._spread.ravel(),
            contact=self._flags,
            offset=self._parameters[4:7],
            gate=self._gate,
            squares=self._squares,
        )
        self._augment = StageKernel.of(programme.augmentation, form, contacts).bind(
            1,
            pose=self._before["pose"],
            covariance=self._before["covariance"],
            **self._after,
            measured=self._one_point,
            noise=self._one_noise.ravel(),
            selected=self._selected,
            offset=self._parameters[4:7],
        )
        self._next_bias = following[1]
        self._rejected = np.zeros(contacts, dtype=np.bool_)
        self.innovations_squared, self.rejected = read_only(self._squares), self._rejected.view()
        self.rejected.flags.writeable = False
        self.touching = self._used.view()
        self.touching.flags.writeable = False
        self.pose = read_only(self._pose)
        self.rotation, self.velocity, self.position = self.pose[:3, :3], self.pose[:3, 3], self.pose[:3, 4]
        self.points = self.pose[:3, 5:]
        self.gyro_bias, self.accelerometer_bias = (read_only(self._bias[part]) for part in (slice(3), slice(3, 6)))
        self.covariance = read_only(self._covariance)
        self.reset(np.eye(5), np.zeros(15))

    def reset(
        self,
        pose: Array,
        deviations: Array,
        gyro_bias: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
        accelerometer_bias: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Set the state, with no foot in contact.

        Args:
            pose: (5, 5) rotation, velocity, position.
            deviations: (15,) standard deviations of plain differences, world axes: rotation (rad), velocity, position,
                gyro bias, accelerometer bias.
            gyro_bias: (3,) rad/s.
            accelerometer_bias: (3,) m/s2.

        Raises:
            InputError: an argument of another form, or a negative deviation.
        """
        pose = checks.extended_pose("pose", pose)
        if pose.shape != (5, 5):
            raise InputError("pose", f"shape {pose.shape}", "shape (5, 5): rotation, velocity, position")
        deviations = checks.finite("deviations", deviations)
        if deviations.shape != (15,) or (deviations < 0.0).any():
            raise InputError("deviations", deviations, "15 numbers that are not negative")
        self._pose[:] = np.eye(len(self._pose))
        self._pose[:5, :5] = pose
        self._bias[:3] = numbers("gyro_bias", gyro_bias, (3,), finite=True)
        self._bias[3:6] = numbers("accelerometer_bias", accelerometer_bias, (3,), finite=True)
        change = np.array(ca.DM(self.form.from_differences(ca.DM(pose))))
        self._covariance[:] = 0.0
        self._covariance[:9, :9] = (change * deviations[:9] ** 2) @ change.T
        self._covariance[-6:, -6:] = np.diag(deviations[9:] ** 2)
        self._used[:] = self._rejected[:] = False
        self._flags[:] = self._squares[:] = 0.0

    def predict(self, gyro: Array, accelerometer: Array, duration: float, foot_rates: Array | None = None) -> None:
        """Predict over one IMU sample.

        Args:
            gyro: (3,) mean angular velocity over the sample, body axes, rad/s.
            accelerometer: (3,) mean specific force, body axes, m/s2.
            duration: of the sample, s.
            foot_rates: (k, 3) angular velocities of the feet relative to the base, base axes, rad/s, for the
                rolling of spherical feet. Zero unless given.

        Raises:
            InputError: a vector that is not finite or of another shape, or a duration that is not positive.
        """
        write("gyro", gyro, self._sample[:3])
        write("accelerometer", accelerometer, self._sample[3:])
        if foot_rates is not None:
            write("foot_rates", foot_rates, self._rolling)
        self._parameters[0] = duration_of("duration", duration)
        self._next_bias[:] = self._bias
        self._predict()
        self._state[:] = self._scratch

    def begin_contact(self, foot: int, measured: Array, covariance: Array) -> None:
        """Add the contact point of ``foot`` to the state, at its measured position.

        Args:
            foot: index, 0 to k - 1.
            measured: (3,) from the base to its contact frame, body axes, m.
            covariance: (3, 3) of ``measured``, m2.

        Raises:
            InputError: no such foot, or arrays that are not finite or of another shape.
        """
        index_of("foot", foot, self.contacts)
        self._write_one(measured, covariance)
        self._selected[:] = 0.0
        self._selected[foot] = 1.0
        self._next_bias[:] = self._bias
        self._augment()
        self._state[:] = self._scratch
        self._used[foot] = True
        self._flags[foot] = 1.0

    def end_contact(self, foot: int) -> None:
        """Marginalise the contact point of ``foot``.

        Raises:
            InputError: no such foot.
        """
        index_of("foot", foot, self.contacts)
        rows = slice(9 + 3 * foot, 12 + 3 * foot)
        self._pose[:3, 5 + foot] = 0.0
        self._covariance[rows], self._covariance[:, rows] = 0.0, 0.0
        self._used[foot] = False
        self._flags[foot] = 0.0

    def correct_height(self, foot: int, height: float, deviation: float) -> None:
        """Correct the estimate with the known height of the contact point of ``foot``: the floor's.

        Args:
            foot: index, 0 to k - 1; in contact.
            height: its coordinate against gravity, m.
            deviation: standard deviation of the height, m; above zero.

        Raises:
            InputError: no such foot, one that is not in contact, or numbers that are not finite or not positive.
        """
        index_of("foot", foot, self.contacts)
        if not self.touching[foot]:
            raise InputError("foot", foot, "one in contact (begin_contact first)")
        number("height", height, "a finite number")
        number("deviation", deviation, "a positive length", above=0.0)
        self._selected[:] = 0.0
        self._selected[foot] = 1.0
        self._height[:] = height, deviation**2
        self._height_correction()
        self._state[:] = self._scratch

    def correct(self, measured: Array, covariances: Array) -> None:
        """Correct the estimate with the positions of the feet in contact; those of the others are not used.

        Args:
            measured: (k, 3) from the base to the contact frames, body axes, m.
            covariances: (k, 3, 3) of each, m2; positive definite.

        Raises:
            InputError: arrays that are not finite or of another shape.
        """
        write("measured", measured, self._measured)
        write("covariances", covariances, self._spread)
        self._correct()
        np.greater(self._squares, self._gate, out=self._rejected)
        self._state[:] = self._scratch

    def correct_pose(self, pose: Array, deviations: tuple[float, float], gate: float = math.inf) -> float:
        """Correct the estimate with a measured pose of the base.

        Args:
            pose: (12,) columns of the rotation, base to world, and position, m.
            deviations: standard deviations of rotation (rad) and position (m) in each axis; above zero.
            gate: largest normalised innovation squared that corrects the estimate.

        Returns:
            The normalised innovation squared, of six degrees of freedom.

        Raises:
            InputError: numbers that are not finite, or not twelve.
        """
        turn, shift = deviations
        return self._correct_base(self._pose_correction, "pose", pose, (turn**2, shift**2, gate))

    def correct_velocity(self, velocity: Array, deviation: float, gate: float = math.inf) -> float:
        """Correct the estimate with a measured velocity of the base's origin.

        Args:
            velocity: (3,) base axes, m/s.
            deviation: its standard deviation in each axis, m/s; above zero.
            gate: largest normalised innovation squared that corrects the estimate.

        Returns:
            The normalised innovation squared, of three degrees of freedom.

        Raises:
            InputError: numbers that are not finite, or not three.
        """
        return self._correct_base(self._velocity_correction, "velocity", velocity, (deviation**2, gate))

    def error(self, pose: Array, biases: Array) -> Array:
        """Return (15 + 3k,) the error of the estimate, whose covariance is :attr:`covariance`.

        Args:
            pose: (5 + k, 5 + k) true pose, with the true points of the feet in contact.
            biases: (6,) true biases, gyro first.

        Raises:
            InputError: no pose of this size, or no six numbers.
        """
        pose, biases = checks.extended_pose("pose", pose), numbers("biases", biases, (6,), finite=True)
        if pose.shape != self.pose.shape:
            raise InputError("pose", f"shape {pose.shape}", f"shape {self.pose.shape}")
        truth = pose.copy()
        truth[:3, 5:] *= self._used
        error = np.array(ca.DM(self.form.error(ca.DM(self.pose), ca.DM(truth)))).ravel()
        return np.concatenate([error, self._bias - biases])

    def _write_one(self, measured: Array, covariance: Array) -> None:
        write("measured", measured, self._one_point)
        write("covariance", covariance, self._one_noise)

    def _correct_base(self, correct: Callable[[], int], name: str, measured: Array, rest: tuple[float, ...]) -> float:
        """Correct with a measurement of the base; ``rest`` are its variances and the gate."""
        size = _BASE_SIZES[name]
        write(name, measured, self._given[:size])
        self._given[size : size + len(rest)] = rest
        correct()
        square = float(self._square[0])
        if square <= rest[-1]:
            self._state[:] = self._scratch
        return square

    @functools.cached_property
    def _pose_correction(self) -> Callable[[], int]:
        return self._bind_correction(programme.pose_correction, {"given": self._given[:15], "square": self._square})

    @functools.cached_property
    def _velocity_correction(self) -> Callable[[], int]:
        return self._bind_correction(programme.velocity_correction, {"given": self._given[:5], "square": self._square})

    @functools.cached_property
    def _height_correction(self) -> Callable[[], int]:
        inputs = {"selected": self._selected, "up": self._up, "height": self._height}
        return self._bind_correction(programme.height_correction, inputs)

    def _bind_correction(
        self, function: Callable[[ErrorForm, int], ca.Function], memory: dict[str, Array]
    ) -> Callable[[], int]:
        """Connect a correction to the filter's memory, and to that of its own arguments and results."""
        kernel = StageKernel.of(function, self.form, self.contacts)
        return kernel.bind(1, **self._before, **self._after, bias_next=self._next_bias, **memory)


def chi_square_bound(probability: float) -> float:
    """Return what a sum of three squares of independent standard normal numbers exceeds with this probability."""
    words = "a probability from 0 to below 1"
    if number("outlier_probability", probability, words, 0.0) >= 1.0:
        raise InputError("outlier_probability", probability, words)
    return float(special.chdtri(3, probability))


def _split_state(memory: Array, columns: int, size: int) -> tuple[Array, Array, Array]:
    """Return pose, biases and covariance as views of one array, so that one copy copies all."""
    pose, bias, covariance = np.split(memory, [columns**2, columns**2 + 6])
    return pose.reshape((columns, columns), order="F"), bias, covariance.reshape(size, size)


def _column_major(matrix: Array) -> Array:
    """Return the flat memory of a matrix in column-major order."""
    return matrix.T.reshape(-1)
