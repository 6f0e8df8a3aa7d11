r"""Error definitions of extended Kalman filters: right-invariant, left-invariant, and the quaternion filter's.

The three filters are one programme (:mod:`lgmpc.estimation.invariant_ekf.programme`); they differ only in the error
``xi`` between estimate and truth, hence in the linearisations of motion and measurement (without biases):

============== ============================================ ==================== =======================
form           error of the extended pose                   transition           observation matrix
============== ============================================ ==================== =======================
right          ``exp(xi) = X_est X_true^-1`` (world axes)   of gravity alone     constant
left           ``exp(xi) = X_true^-1 X_est`` (body axes)    of the IMU alone     of the estimate
multiplicative ``R_est = R_true exp(xi)``, else difference  of both              of the estimate
============== ============================================ ==================== =======================

Both invariant forms: Barrau and Bonnabel (IEEE TAC 2017), with contacts Hartley et al. (IJRR 2020). The multiplicative
one is the standard "quaternion" error-state filter (Bloesch et al., RSS 2012), for comparison.
All expressions are CasADi's; poses are in SE_{2+k}(3), columns velocity, position and k points of contact.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from lgmpc.lie.symbolic import sek3, so3


@dataclass(frozen=True)
class Propagation:
    """One step of the extended pose, symbolically.

    Attributes:
        before: (5 + k, 5 + k) pose.
        after: the pose after the step.
        rolled: (3, k) displacements of the points by rolling feet, world axes, m: known, and part of ``after``.
        increment: (5 + k, 5 + k) the IMU's increment Upsilon.
        jacobian: (9, 6) of the increment: ``increment(w + dw, a + da) = increment exp(jacobian [dw; da])``.
        gravity: (3,) world axes, m/s2.
        duration: s.
    """

    before: Any
    after: Any
    rolled: Any
    increment: Any
    jacobian: Any
    gravity: Any
    duration: Any

    @property
    def points(self) -> int:
        """Number of columns beside velocity and position."""
        return int(self.before.shape[1]) - 5


@dataclass(frozen=True)
class Observation:
    """One point's measurement, linearised: ``innovation = matrix xi + noise``.

    Attributes:
        innovation: (3,) m.
        matrix: (3, 9 + 3k).
        axes: (3, 3) the axes that the innovation is in, from the body's.
    """

    innovation: Any
    matrix: Any
    axes: Any


class ErrorForm(Protocol):
    """The protocol of an error definition."""

    @property
    def name(self) -> str:
        """Name, part of the names of compiled functions."""

    def transition(self, motion: Propagation) -> Any:
        """Return (9 + 3k, 9 + 3k) the transition matrix of the error over a step."""

    def disturbance(self, motion: Propagation) -> Any:
        """Return (9 + 3k, 6) the derivative of the error by an error of the IMU sample."""

    def observe(self, pose: Any, point: int, measured: Any, offset: Any) -> Observation:
        """Return the linearised measurement of a point.

        Args:
            pose: the estimate.
            point: its index, 0 to k - 1.
            measured: (3,) from the base to the measured frame, body axes, m.
            offset: (3,) from the point to the measured frame, world axes, m.
        """

    def from_differences(self, pose: Any) -> Any:
        """Return (9 + 3k, 9 + 3k) the map from plain differences between estimate and truth to this error.

        Plain differences are the rotation ``exp(d) = R_est R_true^-1``, world axes, and the columns' differences; to
        first order.
        """

    def error(self, estimate: Any, truth: Any) -> Any:
        """Return (9 + 3k,) the exact error of one pose relative to another."""

    def retract(self, pose: Any, error: Any) -> Any:
        """Return the pose corrected by the error (9 + 3k,)."""


@dataclass(frozen=True)
class _RightInvariant:
    """World axes: the transition depends on gravity alone, the observation matrix is constant."""

    name: str = "right"

    def transition(self, motion: Propagation) -> Any:
        fall = ca.horzcat(motion.duration * motion.gravity, 0.5 * motion.duration**2 * motion.gravity)
        # Columns added from the left transform by the same adjoint, those of gravity and of rolling alike.
        return _shift(ca.horzcat(fall, motion.rolled)) @ _flow(motion)

    def disturbance(self, motion: Propagation) -> Any:
        return sek3.adjoint(motion.after) @ _padded(motion.jacobian, motion)

    def observe(self, pose: Any, point: int, measured: Any, offset: Any) -> Observation:
        rotation = pose[:3, :3]
        innovation = rotation @ measured + pose[:3, 4] - pose[:3, 5 + point] - offset
        eye = ca.SX.eye(3)
        matrix = _rows(-so3.hat(offset), eye, -eye, point, pose)
        return Observation(innovation, matrix, rotation)

    def from_differences(self, pose: Any) -> Any:
        arms = ca.vertcat(*(so3.hat(pose[:3, j]) for j in range(3, pose.shape[1])))
        return _blocks(ca.DM.eye(3), arms, ca.DM.eye(3))

    def error(self, estimate: Any, truth: Any) -> Any:
        return sek3.log(sek3.compose(estimate, sek3.inverse(truth)))

    def retract(self, pose: Any, error: Any) -> Any:
        return sek3.compose(sek3.exp(-error), pose)


@dataclass(frozen=True)
class _LeftInvariant:
    """Body axes: the transition depends on the IMU alone."""

    name: str = "left"

    def transition(self, motion: Propagation) -> Any:
        return sek3.adjoint(sek3.inverse(motion.increment)) @ _flow(motion)

    def disturbance(self, motion: Propagation) -> Any:
        return _padded(motion.jacobian, motion)

    def observe(self, pose: Any, point: int, measured: Any, offset: Any) -> Observation:
        expected, eye = _expected(pose, point, offset), ca.SX.eye(3)
        return Observation(measured - expected, _rows(-so3.hat(expected), eye, -eye, point, pose), eye)

    def from_differences(self, pose: Any) -> Any:
        back = pose[:3, :3].T
        return _blocks(back, ca.DM(3 * (pose.shape[1] - 3), 3), back)

    def error(self, estimate: Any, truth: Any) -> Any:
        return sek3.log(sek3.compose(sek3.inverse(truth), estimate))

    def retract(self, pose: Any, error: Any) -> Any:
        return sek3.compose(pose, sek3.exp(-error))


@dataclass(frozen=True)
class _Multiplicative:
    """The rotation's error multiplies, in body axes; all others are differences in world axes."""

    name: str = "multiplicative"

    def transition(self, motion: Propagation) -> Any:
        rotation, step, matrix = motion.before[:3, :3], motion.increment, _flow(motion)
        matrix[:3, :3] = step[:3, :3].T
        for row, column in ((3, 3), (6, 4)):
            matrix[row : row + 3, :3] = -rotation @ so3.hat(step[:3, column])
        return matrix

    def disturbance(self, motion: Propagation) -> Any:
        rotation, jacobian = motion.after[:3, :3], motion.jacobian
        world = ca.vertcat(jacobian[:3, :], rotation @ jacobian[3:6, :], rotation @ jacobian[6:, :])
        return _padded(world, motion)

    def observe(self, pose: Any, point: int, measured: Any, offset: Any) -> Observation:
        expected, back = _expected(pose, point, offset), pose[:3, :3].T
        return Observation(measured - expected, _rows(-so3.hat(expected), back, -back, point, pose), ca.SX.eye(3))

    def from_differences(self, pose: Any) -> Any:
        return _blocks(pose[:3, :3].T, ca.DM(3 * (pose.shape[1] - 3), 3), ca.DM.eye(3))

    def error(self, estimate: Any, truth: Any) -> Any:
        turn = so3.log(truth[:3, :3].T @ estimate[:3, :3])
        return ca.vertcat(turn, ca.vec(estimate[:3, 3:] - truth[:3, 3:]))

    def retract(self, pose: Any, error: Any) -> Any:
        moved = ca.SX(pose)
        moved[:3, :3] = pose[:3, :3] @ so3.exp(-error[:3])
        moved[:3, 3:] = pose[:3, 3:] - ca.reshape(error[3:], 3, pose.shape[1] - 3)
        return moved


RIGHT: ErrorForm = _RightInvariant()
"""The right-invariant error, in world axes, suited to contacts."""
LEFT: ErrorForm = _LeftInvariant()
"""The left-invariant error, in body axes."""
MULTIPLICATIVE: ErrorForm = _Multiplicative()
"""The error of the quaternion filter, for comparison."""
FORMS: dict[str, ErrorForm] = {form.name: form for form in (RIGHT, LEFT, MULTIPLICATIVE)}
"""All forms by name."""


def _flow(motion: Propagation) -> Any:
    """Return the differential of the free flow: the position's error grows by the velocity's."""
    matrix = ca.SX.eye(9 + 3 * motion.points)
    matrix[6:9, 3:6] = motion.duration * ca.SX.eye(3)
    return matrix


def _shift(columns: Any) -> Any:
    """Return the adjoint of a pose with these columns and no rotation."""
    arms = ca.vertcat(*(so3.hat(columns[:, j]) for j in range(columns.shape[1])))
    return _blocks(ca.SX.eye(3), arms, ca.SX.eye(3))


def _padded(jacobian: Any, motion: Propagation) -> Any:
    """Return the (9, 6) Jacobian with rows of zeros for the points, which do not depend on the IMU."""
    return ca.vertcat(jacobian, ca.SX(3 * motion.points, 6))


def _blocks(rotation: Any, arms: Any, columns: Any) -> Any:
    count = arms.shape[0] // 3
    rest = ca.vertcat(ca.DM(3, 3 * count), ca.kron(ca.DM.eye(count), columns))
    return ca.horzcat(ca.vertcat(rotation, arms), rest)


def _expected(pose: Any, point: int, offset: Any) -> Any:
    return pose[:3, :3].T @ (pose[:3, 5 + point] - pose[:3, 4] + offset)


def _rows(rotation: Any, position: Any, column: Any, point: int, pose: Any) -> Any:
    """Return (3, 9 + 3k) with these blocks for the errors of rotation, position and one point."""
    matrix = ca.SX(3, 3 * (int(pose.shape[1]) - 2))
    matrix[:, :3], matrix[:, 6:9] = rotation, position
    matrix[:, 9 + 3 * point : 12 + 3 * point] = column
    return matrix
