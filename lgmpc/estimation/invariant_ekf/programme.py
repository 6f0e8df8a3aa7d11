"""The steps of the filter as CasADi functions: prediction, a new point, corrections; for any form of error.

Fixed sizes: a point that is not in use has a column of zeros, rows and columns of zeros in the covariance, and no gain.
The covariance's order is rotation, velocity, position, contact points, gyro bias, accelerometer bias.
"""

from typing import Any

import casadi as ca

from lgmpc.estimation.invariant_ekf.forms import ErrorForm, Propagation
from lgmpc.lie import coefficients
from lgmpc.lie.symbolic import sek3, so3

_CORRECTED = ["pose_next", "bias_next", "covariance_next"]


def prediction(form: ErrorForm, contacts: int) -> ca.Function:
    """Return one step under an IMU sample that is constant over it, exact for mean and covariance.

    Inputs: ``pose``, ``bias`` (6,) gyro first, ``covariance``, ``sample`` (6,) gyro and accelerometer, ``rolling``
    (3, contacts) angular velocity of each foot relative to the base, base axes, ``contact`` (contacts,) 0 or 1,
    ``parameters`` (12,): duration, gravity (3), offset (3) from the contact points to the contact frames in world axes,
    and the squared densities of gyro, accelerometer, their biases' walks, and slip.

    A spherical foot rolls: its contact point moves with ``omega_foot x offset``. That motion is treated as known; its
    dependence on attitude and bias (16 mm times a small angle on Solo12) is part of the slip noise.
    """
    pose, bias, covariance = _state(contacts)
    size, sample = 9 + 3 * contacts, ca.SX.sym("sample", 6)
    rolling, contact = ca.SX.sym("rolling", 3, contacts), ca.SX.sym("contact", contacts)
    parameters = ca.SX.sym("parameters", 12)
    duration, gravity, offset = parameters[0], parameters[1:4], parameters[4:7]
    density = {name: parameters[7 + i] for i, name in enumerate(("gyro", "force", "gyro_walk", "force_walk", "slip"))}

    before = _assume_group(pose)
    rates = before[:3, :3] @ (ca.repmat(sample[:3] - bias[:3], 1, contacts) + rolling)
    rolled = [contact[i] * duration * ca.cross(rates[:, i], offset) for i in range(contacts)]
    motion = _motion(before, sample - bias, gravity, duration, ca.horzcat(*rolled))
    transition, entering = form.transition(motion), form.disturbance(motion)
    pose_block, bias_block = covariance[:size, :size], covariance[size:, size:]
    cross = transition @ covariance[:size, size:]
    noise = ca.diag(ca.vertcat(*[density["gyro"]] * 3, *[density["force"]] * 3)) / duration
    half = 0.5 * entering @ (bias_block + noise) - cross
    mixed = half @ entering.T
    moving = ca.vertcat(ca.SX(9, 1), ca.kron(contact, ca.SX.ones(3)))
    slip = moving * density["slip"] * duration
    walk = ca.vertcat(*[density["gyro_walk"]] * 3, *[density["force_walk"]] * 3) * duration
    corner = cross - entering @ bias_block
    moved = ca.vertcat(
        ca.horzcat(transition @ pose_block @ transition.T + mixed + mixed.T + ca.diag(slip), corner),
        ca.horzcat(corner.T, bias_block + ca.diag(walk)),
    )
    names = ["pose", "bias", "covariance", "sample", "rolling", "contact", "parameters"]
    return ca.Function(
        f"inekf_predict_{form.name}_{contacts}",
        [pose, bias, covariance, sample, rolling, contact, parameters],
        [motion.after, _symmetric(moved)],
        names,
        ["pose_next", "covariance_next"],
    )


def augmentation(form: ErrorForm, contacts: int) -> ca.Function:
    """Return the state with one more contact point, at its measured position.

    Inputs: ``pose``, ``covariance``, ``measured`` (3,) base to the measured frame, body axes, ``noise`` (3, 3) its
    covariance, ``selected`` (contacts,) 1 for the new point, ``offset`` (3,) from the point to the measured frame,
    world axes.
    """
    pose, _, covariance = _state(contacts)
    measured, noise = ca.SX.sym("measured", 3), ca.SX.sym("noise", 3, 3)
    selected, offset = ca.SX.sym("selected", contacts), ca.SX.sym("offset", 3)
    before = _assume_group(pose)
    point = before[:3, :3] @ measured + before[:3, 4] - offset
    observation = form.observe(_with_point(before, point), 0, measured, offset)
    # The new point is the one without innovation: 0 = matrix xi + noise, solved for its own error.
    back = -observation.matrix[:, 9:].T
    axes = back @ observation.axes
    cross = back @ observation.matrix[:, :9] @ covariance[:9, :]
    own = cross[:, :9] @ (back @ observation.matrix[:, :9]).T + axes @ noise @ axes.T
    after, moved = ca.SX(before), ca.SX(covariance)
    for i in range(contacts):
        rows = slice(9 + 3 * i, 12 + 3 * i)
        moved[rows, :] = ca.if_else(selected[i], cross, moved[rows, :])
        moved[:, rows] = ca.if_else(selected[i], cross.T, moved[:, rows])
        moved[rows, rows] = ca.if_else(selected[i], own, covariance[rows, rows])
        after[:3, 5 + i] = ca.if_else(selected[i], point, before[:3, 5 + i])
    return ca.Function(
        f"inekf_augment_{form.name}_{contacts}",
        [pose, covariance, measured, noise, selected, offset],
        [after, _symmetric(moved)],
        ["pose", "covariance", "measured", "noise", "selected", "offset"],
        ["pose_next", "covariance_next"],
    )


def correction(form: ErrorForm, contacts: int) -> ca.Function:
    """Return the Kalman update with the positions of all feet in contact (Hartley et al. 2020).

    Inputs: ``pose``, ``bias``, ``covariance``, ``measured`` (3, contacts) base to contact frames, body axes, ``noise``
    (3, 3 contacts) their covariances side by side, ``contact`` (contacts,) 0 or 1, ``offset`` (3,), ``gate`` (1,).
    Output ``squares`` (contacts,): normalised innovations squared, of open contacts 0. A foot whose square is above the
    gate does not correct the estimate.

    Each square is that of the foot alone, against the predicted state: which foot is an outlier does not depend on
    their order. The others are processed sequentially with one linearisation, equivalent to a joint update because
    their noises are independent; ``V V^T`` with ``V = P H^T L^-T`` and ``L L^T = H P H^T + N`` keeps the covariance
    symmetric.
    """
    pose, bias, covariance = _state(contacts)
    size = 9 + 3 * contacts
    measured, noise = ca.SX.sym("measured", 3, contacts), ca.SX.sym("noise", 3, 3 * contacts)
    contact, offset, gate = ca.SX.sym("contact", contacts), ca.SX.sym("offset", 3), ca.SX.sym("gate")
    before, error, moved = _assume_group(pose), ca.SX.zeros(size + 6), covariance
    squares = []
    for i in range(contacts):
        observation = form.observe(before, i, measured[:, i], offset)
        matrix = ca.horzcat(observation.matrix, ca.SX(3, 6))
        own = observation.axes @ noise[:, 3 * i : 3 * i + 3] @ observation.axes.T
        # An open contact has no rows in the covariance, but its measurement would affect the others.
        alone = _cholesky(ca.if_else(contact[i], matrix @ covariance @ matrix.T + own, ca.SX.eye(3)))
        squares.append(ca.sumsqr(_solve_lower(alone, ca.if_else(contact[i], observation.innovation, 0.0))))
        used = ca.logic_and(contact[i], squares[i] <= gate)
        gain = moved @ matrix.T
        factor = _cholesky(ca.if_else(used, matrix @ gain + own, ca.SX.eye(3)))
        scaled = used * _solve_lower(factor, gain.T).T
        surprise = _solve_lower(factor, ca.if_else(used, observation.innovation - matrix @ error, 0.0))
        error += scaled @ surprise
        moved = _symmetric(moved - scaled @ scaled.T)
    return ca.Function(
        f"inekf_correct_{form.name}_{contacts}",
        [pose, bias, covariance, measured, noise, contact, offset, gate],
        ca.cse([*_corrected(form, before, bias, error), moved, ca.vertcat(*squares)]),
        ["pose", "bias", "covariance", "measured", "noise", "contact", "offset", "gate"],
        [*_CORRECTED, "squares"],
    )


def height_correction(form: ErrorForm, contacts: int) -> ca.Function:
    """Return the Kalman update with the known height of a point that is part of the state.

    Inputs: ``pose``, ``bias``, ``covariance``, ``selected`` (contacts,) 1 for the point, ``up`` (3,) unit vector
    against gravity, world axes, ``height`` (2,): the point's coordinate along it, m, and its variance, m2.

    Plain differences ``(d, e)`` of attitude and points result in the errors ``(B d, A d + C e)`` with the blocks of
    :meth:`ErrorForm.from_differences`; the height's difference is ``up . e``, solved for.
    """
    pose, bias, covariance = _state(contacts)
    selected, up, height = ca.SX.sym("selected", contacts), ca.SX.sym("up", 3), ca.SX.sym("height", 2)
    before = _assume_group(pose)
    change = form.from_differences(before)
    attitude, matrix = change[:3, :3], ca.SX(1, 15 + 3 * contacts)
    for i in range(contacts):
        rows = slice(9 + 3 * i, 12 + 3 * i)
        own = selected[i] * (change[rows, rows] @ up).T
        matrix[:, rows] = own
        matrix[:, :3] -= own @ change[rows, :3] @ attitude.T
    gain = covariance @ matrix.T
    innovation = ca.dot(up, before[:3, 5:] @ selected) - height[0]
    variance = matrix @ gain + height[1]
    return ca.Function(
        f"inekf_correct_height_{form.name}_{contacts}",
        [pose, bias, covariance, selected, up, height],
        [
            *_corrected(form, before, bias, gain * innovation / variance),
            _symmetric(covariance - gain @ gain.T / variance),
        ],
        ["pose", "bias", "covariance", "selected", "up", "height"],
        _CORRECTED,
    )


def pose_correction(form: ErrorForm, contacts: int) -> ca.Function:
    """Return the Kalman update with a measured pose of the base.

    Inputs: ``pose``, ``bias``, ``covariance``, ``given`` (15,): columns of the rotation, position, variances of both
    in each axis, gate. Output ``square`` (1,): normalised innovation squared, of six degrees of freedom. A pose whose
    square is above the gate does not correct the estimate.
    """
    state, given = _state(contacts), ca.SX.sym("given", 15)
    before, rotation, position = _assume_group(state[0]), ca.reshape(given[:9], 3, 3), given[9:12]
    innovation = ca.vertcat(so3.log(before[:3, :3] @ rotation.T), before[:3, 4] - position)
    rows = ca.kron(ca.DM([[1, 0, 0], [0, 0, 1]]), ca.DM.eye(3))
    noise = ca.diag(ca.kron(given[12:14], ca.DM.ones(3)))
    return _base_correction("pose", form, state, given, innovation, rows, noise)


def velocity_correction(form: ErrorForm, contacts: int) -> ca.Function:
    """Return the Kalman update with a measured velocity of the base's origin.

    Inputs: ``pose``, ``bias``, ``covariance``, ``given`` (5,): velocity in base axes, variance in each axis, gate.
    Output ``square`` (1,): as of :func:`pose_correction`, with three degrees of freedom.
    """
    state, given = _state(contacts), ca.SX.sym("given", 5)
    before, eye = _assume_group(state[0]), ca.SX.eye(3)
    innovation = before[:3, 3] - before[:3, :3] @ given[:3]
    rows = ca.horzcat(so3.hat(before[:3, 3]), eye, ca.SX(3, 3))
    return _base_correction("velocity", form, state, given, innovation, rows, given[3] * eye)


def _base_correction(
    name: str, form: ErrorForm, state: tuple[Any, Any, Any], given: Any, innovation: Any, rows: Any, noise: Any
) -> ca.Function:
    """Return the update with ``innovation = rows d + noise``: ``d`` (9,) are the base's plain differences.

    The error is ``(B d_rotation, A d_rotation + C d_columns)`` with the orthogonal blocks ``B`` and ``C`` of
    :meth:`ErrorForm.from_differences`, solved for ``d``.
    """
    pose, bias, covariance = state
    before = _assume_group(pose)
    change = form.from_differences(_pack(before[:3, :3], before[:3, 3:5]))
    matrix = rows[:, 3:] @ change[3:, 3:].T
    matrix = ca.horzcat((rows[:, :3] - matrix @ change[3:, :3]) @ change[:3, :3].T, matrix)
    gain = covariance[:, :9] @ matrix.T
    factor = _cholesky(matrix @ gain[:9, :] + noise)
    surprise = _solve_lower(factor, innovation)
    square = ca.sumsqr(surprise)
    scaled = (square <= given[-1]) * _solve_lower(factor, gain.T).T
    return ca.Function(
        f"inekf_correct_{name}_{form.name}_{int(pose.shape[0]) - 5}",
        [pose, bias, covariance, given],
        [*_corrected(form, before, bias, scaled @ surprise), _symmetric(covariance - scaled @ scaled.T), square],
        ["pose", "bias", "covariance", "given"],
        [*_CORRECTED, "square"],
    )


def _state(points: int) -> tuple[Any, Any, Any]:
    """Return symbols of pose, bias and covariance."""
    columns, size = 5 + points, 15 + 3 * points
    return ca.SX.sym("pose", columns, columns), ca.SX.sym("bias", 6), ca.SX.sym("covariance", size, size)


def _with_point(pose: Any, point: Any) -> Any:
    """Return the (6, 6) pose of the base alone, with one point."""
    return _pack(pose[:3, :3], ca.horzcat(pose[:3, 3:5], point))


def _corrected(form: ErrorForm, before: Any, bias: Any, error: Any) -> list[Any]:
    """Return pose and bias without the estimated error."""
    after = form.retract(before, error[:-6])
    after[:3, :3] = _orthonormal(after[:3, :3])
    return [after, bias - error[-6:]]


def _motion(before: Any, sample: Any, gravity: Any, duration: Any, rolled: Any) -> Propagation:
    """Return the step of a pose and its points under body rates that are constant over it."""
    variables = ca.SX.sym("sample", 6)
    phi, force = duration * variables[:3], variables[3:]
    velocity, position = duration * so3.left_jacobian(phi) @ force, duration**2 * _second_integral(phi) @ force
    turn = so3.exp(phi)
    jacobian = ca.vertcat(
        ca.horzcat(duration * so3.right_jacobian(phi), ca.SX(3, 3)),
        turn.T @ ca.jacobian(velocity, variables),
        turn.T @ ca.jacobian(position, variables),
    )
    turn, velocity, position, jacobian = ca.substitute([turn, velocity, position, jacobian], [variables], [sample])
    increment = _pack(turn, ca.horzcat(velocity, position, ca.SX(3, int(before.shape[1]) - 5)))
    flown = ca.SX(before)
    flown[:3, 4] += duration * before[:3, 3]
    after = sek3.compose(flown, increment)
    after[:3, 3] += duration * gravity
    after[:3, 4] += 0.5 * duration**2 * gravity
    after[:3, 5:] += rolled
    return Propagation(before, after, rolled, increment, jacobian, gravity, duration)


def _second_integral(phi: Any) -> Any:
    """Return ``Gamma_2 = sum_k Phi^k / (k + 2)!``."""
    t, turn = ca.dot(phi, phi), so3.hat(phi)
    return (
        0.5 * ca.SX.eye(3)
        + coefficients.c.symbolic(t) * turn
        + coefficients.e.symbolic(t) * (phi @ phi.T - t * ca.SX.eye(3))
    )


def _assume_group(pose: Any) -> Any:
    """Return the pose with constants in its constant rows, which simplifies products."""
    return _pack(pose[:3, :3], pose[:3, 3:])


def _pack(rotation: Any, columns: Any) -> Any:
    k = int(columns.shape[1])
    return ca.vertcat(ca.horzcat(rotation, columns), ca.horzcat(ca.SX(k, 3), ca.SX.eye(k)))


def _symmetric(matrix: Any) -> Any:
    """Return the exactly symmetric matrix of the upper triangle."""
    return ca.triu2symm(ca.triu(ca.densify(matrix)))


def _orthonormal(rotation: Any) -> Any:
    """Return a nearly orthonormal matrix with its defect squared, so that rounding errors do not accumulate."""
    return rotation @ (1.5 * ca.SX.eye(3) - 0.5 * rotation.T @ rotation)


def _cholesky(matrix: Any) -> Any:
    count = int(matrix.shape[0])
    factor = ca.SX(count, count)
    for j in range(count):
        pivot = matrix[j, j] - sum((factor[j, k] ** 2 for k in range(j)), ca.SX(0))
        factor[j, j] = ca.sqrt(pivot)
        for i in range(j + 1, count):
            inner = sum((factor[i, k] * factor[j, k] for k in range(j)), ca.SX(0))
            factor[i, j] = (matrix[i, j] - inner) / factor[j, j]
    return factor


def _solve_lower(factor: Any, right: Any) -> Any:
    rows: list[Any] = []
    for i in range(int(factor.shape[0])):
        row = right[i, :] - sum((factor[i, k] * rows[k] for k in range(i)), ca.SX(1, right.shape[1]))
        rows.append(row / factor[i, i])
    return ca.vertcat(*rows)
