"""The filter against its definition: matrix exponentials, finite differences, the textbook's Kalman update."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from samples import error_between, jacobian, retracted
from scipy.linalg import expm

from lgmpc.errors import InputError
from lgmpc.estimation.inertial import ImuNoise, error_dynamics, exponential_increment, propagate
from lgmpc.estimation.invariant_ekf import FORMS, LEFT, RIGHT, ErrorForm, InvariantEkf
from lgmpc.estimation.invariant_ekf.programme import correction, prediction
from lgmpc.lie import sek3, so3

GRAVITY = np.array([0.4, -0.3, -9.7])
OFFSET = np.array([0.1, -0.05, 0.2])
NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    accelerometer_noise_m_s2_rt_hz=3e-2,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_bias_walk_m_s3_rt_hz=2e-2,
)
SILENT = ImuNoise(
    gyro_noise_rad_s_rt_hz=0.0,
    accelerometer_noise_m_s2_rt_hz=0.0,
    gyro_bias_walk_rad_s2_rt_hz=0.0,
    accelerometer_bias_walk_m_s3_rt_hz=0.0,
)
K = 3
SIZE = 15 + 3 * K
FEET = np.array([[0.2, 0.1, -0.3], [-0.2, 0.15, -0.25], [0.1, -0.2, -0.35]])
forms = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


def random_spd(rng: np.random.Generator, size: int, scale: float = 1.0) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return scale * (root @ root.T / size + 0.1 * np.eye(size))


@functools.cache
def blank(form: ErrorForm, rolls: bool = True) -> InvariantEkf:
    """One filter for all tests: making one costs more than using it. The form used most is compiled."""
    offset = OFFSET if rolls else np.zeros(3)
    with pytest.MonkeyPatch.context() as patch:
        if form is not RIGHT:
            patch.setenv("LGMPC_JIT", "0")
        return InvariantEkf(K, NOISE, slip=0.05, gravity=GRAVITY, contact_offset=offset, form=form)


def make(form: ErrorForm, feet: tuple[int, ...] = (0, 1, 2), rolls: bool = True) -> InvariantEkf:
    """A filter after some steps: turned, moving, biased, with correlations."""
    rng = np.random.default_rng(0)
    ekf = blank(form, rolls)
    ekf.reset(sek3.exp(rng.normal(size=9)), rng.uniform(0.02, 0.1, 15), 0.1 * rng.normal(size=3), rng.normal(size=3))
    for foot in feet:
        ekf.predict(rng.normal(size=3), 5.0 * rng.normal(size=3), 0.02)
        ekf.begin_contact(foot, FEET[foot], random_spd(rng, 3, 1e-4))
    return ekf


@pytest.mark.usefixtures("interpreted")
def test_without_noise_and_biases_the_right_invariant_error_is_exactly_log_linear() -> None:
    """xi(t) = expm(A t) xi(0), for half a turn and metres, along a wild motion."""
    rng = np.random.default_rng(1)
    start, xi = sek3.exp(rng.normal(size=9)), rng.normal(size=9)
    xi[:3] *= 2.0 / np.linalg.norm(xi[:3])
    filters = [InvariantEkf(K, SILENT, gravity=GRAVITY) for _ in range(2)]
    for ekf, pose in zip(filters, (start, sek3.exp(xi) @ start), strict=True):
        ekf.reset(pose, np.zeros(15))
        for foot in range(K):
            ekf.begin_contact(foot, FEET[foot], 1e-6 * np.eye(3))
    true, estimate = filters

    def error() -> np.ndarray:
        return estimate.error(true.pose, np.zeros(6))[:-6]

    first, dynamics, dt = error(), error_dynamics(GRAVITY, 2 + K), 0.004
    np.testing.assert_allclose(first[:9], xi, atol=1e-12)
    for k in range(1, 251):
        sample = 3.0 * rng.normal(size=3), 20.0 * rng.normal(size=3)
        for ekf in filters:
            ekf.predict(*sample, dt)
        if k % 50 == 0:
            np.testing.assert_allclose(error(), expm(dynamics * dt * k) @ first, atol=1e-11)


def test_without_noise_and_biases_the_covariance_is_log_linear() -> None:
    """P(t) = expm(A t) P(0) expm(A t)^T, whatever the IMU measures."""
    rng, dt = np.random.default_rng(2), 0.01
    ekf = InvariantEkf(K, SILENT, slip=0.0, gravity=GRAVITY)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.concatenate([rng.uniform(0.1, 1.0, 9), np.zeros(6)]))
    ekf.begin_contact(1, FEET[1], 1e-4 * np.eye(3))
    before, transition = ekf.covariance[:-6, :-6].copy(), expm(error_dynamics(GRAVITY, 2 + K) * dt * 100)
    for _ in range(100):
        ekf.predict(rng.normal(size=3), 9.0 * rng.normal(size=3), dt)
    np.testing.assert_allclose(ekf.covariance[:-6, :-6], transition @ before @ transition.T, atol=1e-11)


@forms
def test_the_mean_is_predicted_as_by_propagation_and_spherical_feet_roll(form: ErrorForm) -> None:
    ekf = make(form, feet=(0, 2))
    pose, gyro, force, dt = ekf.pose.copy(), np.array([0.5, -2.0, 1.0]), np.array([1.0, 2.0, 9.0]), 0.03
    rates = np.arange(9.0).reshape(3, 3)
    true_gyro, true_force = gyro - ekf.gyro_bias, force - ekf.accelerometer_bias
    ekf.predict(gyro, force, dt, rates)
    expected = propagate(pose, exponential_increment(true_gyro, true_force, dt), GRAVITY, dt)
    for foot in (0, 2):
        expected[:3, 5 + foot] += dt * np.cross(pose[:3, :3] @ (true_gyro + rates[foot]), OFFSET)
    np.testing.assert_allclose(ekf.pose, expected, atol=1e-14)


@pytest.mark.parametrize("assumed", [0.1, 0.0])
def test_a_rolling_spherical_foot_moves_the_base(assumed: float) -> None:
    """A rod on a ball of 0.1 m tips by 0.5 rad: the ball rolls 50 mm, which a filter of point feet misses."""
    radius, height, dt, turns = 0.1, 0.5, 0.005, 0.5 * np.sin(np.linspace(0.0, 0.5 * np.pi, 201)) ** 2
    poses = np.tile(np.eye(5), (len(turns), 1, 1))
    poses[:, :3, :3] = so3.exp(np.outer(turns, [0.0, 1.0, 0.0]))
    poses[:, 0, 4] = radius * turns + height * np.sin(turns)
    poses[:, 2, 4] = radius + height * np.cos(turns)
    poses[:, :3, 3] = np.gradient(poses[:, :3, 4], dt, axis=0)
    gravity, foot = np.array([0.0, 0.0, -9.81]), np.array([0.0, 0.0, -height])
    ekf = InvariantEkf(
        K,
        ImuNoise(gyro_noise_rad_s_rt_hz=1e-3, accelerometer_noise_m_s2_rt_hz=1e-1),
        slip=1e-3,
        contact_offset=(0.0, 0.0, assumed),
    )
    ekf.reset(poses[0], np.concatenate([np.full(9, 1e-3), np.zeros(6)]))
    spread = np.tile(1e-8 * np.eye(3), (K, 1, 1))
    ekf.begin_contact(0, foot, spread[0])
    for before, after in zip(poses[:-1], poses[1:], strict=True):
        turn = so3.log(before[:3, :3].T @ after[:3, :3])
        gained = before[:3, :3].T @ (after[:3, 3] - before[:3, 3] - dt * gravity)
        ekf.predict(turn / dt, so3.left_jacobian_inverse(turn) @ gained / dt, dt)
        ekf.correct(np.tile(foot, (K, 1)), spread)
    missed = poses[-1, 0, 4] - ekf.position[0]
    assert missed == pytest.approx(0.0 if assumed else radius * turns[-1], abs=0.002)


@forms
@pytest.mark.parametrize("dt", [0.001, 0.3])
def test_the_covariance_is_predicted_with_the_jacobians_of_finite_differences(form: ErrorForm, dt: float) -> None:
    ekf = make(form, rolls=False)  # how a foot rolls is not part of the error dynamics
    pose, biases, before = ekf.pose.copy(), ekf._bias.copy(), ekf.covariance.copy()
    sample = np.concatenate([ekf.gyro_bias, ekf.accelerometer_bias]) + [0.8, -1.0, 2.0, 1.0, -2.0, 9.0]

    def step(start: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return propagate(start, exponential_increment(rates[:3], rates[3:], dt), GRAVITY, dt)

    estimate = step(pose, sample - biases)

    def later(error: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Error after the step if it was ``error`` before and the IMU made ``noise``."""
        true_bias = biases - error[-6:]
        truth = step(retracted(form, pose, error[:-6]), sample - noise - true_bias)
        return np.concatenate([error_between(form, estimate, truth), error[-6:]])

    transition = jacobian(lambda e: later(e, np.zeros(6)), SIZE)
    entering = jacobian(lambda n: later(np.zeros(SIZE), n), 6)
    white = np.repeat(np.square(NOISE.densities[:2]), 3) / dt
    walks = dt * np.repeat(np.square(NOISE.densities[2:]), 3)
    added = np.concatenate([np.zeros(9), np.full(3 * K, 0.05**2 * dt), walks])
    expected = transition @ before @ transition.T + (entering * white) @ entering.T + np.diag(added)
    ekf.predict(sample[:3], sample[3:], dt)
    np.testing.assert_allclose(ekf.pose, estimate, atol=1e-13)
    np.testing.assert_allclose(ekf.covariance, expected, rtol=1e-7, atol=1e-9)


@forms
def test_a_correction_is_the_kalman_update_of_the_textbook(form: ErrorForm) -> None:
    """All feet in contact at once, dense, with the Jacobian of finite differences of the measurement itself."""
    rng, feet = np.random.default_rng(4), (0, 2)
    ekf = make(form, feet=feet)
    pose, biases, before = ekf.pose.copy(), ekf._bias.copy(), ekf.covariance.copy()
    noises = np.array([random_spd(rng, 3, 1e-4) for _ in range(K)])

    def measure(truth: np.ndarray) -> np.ndarray:
        arms = truth[:3, 5:] + (OFFSET - truth[:3, 4])[:, None]
        return (truth[:3, :3].T @ arms).T[list(feet)].ravel()

    measured = FEET + 0.01 * rng.normal(size=(K, 3))
    surprise = measured[list(feet)].ravel() - measure(pose)
    slope = jacobian(lambda e: measure(retracted(form, pose, e)), SIZE - 6)
    matrix = np.hstack([slope, np.zeros((6, 6))])
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = noises[0], noises[2]
    gain = before @ matrix.T @ np.linalg.inv(matrix @ before @ matrix.T + noise)
    measured[1], noises[1] = 1e3, 1e-9 * np.eye(3)  # a foot in the air must have no effect
    ekf.correct(measured, noises)
    error = gain @ surprise
    np.testing.assert_allclose(ekf.pose, retracted(form, pose, error[:-6]), atol=1e-9)
    np.testing.assert_allclose(ekf._bias, biases - error[-6:], atol=1e-9)
    np.testing.assert_allclose(ekf.covariance, before - gain @ matrix @ before, atol=1e-9)
    np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)


@forms
def test_a_new_contact_has_the_covariance_of_finite_differences(form: ErrorForm) -> None:
    rng = np.random.default_rng(5)
    ekf = make(form, feet=(1,))
    pose, before, noise, foot = ekf.pose.copy(), ekf.covariance.copy(), random_spd(rng, 3, 1e-4), 2

    def placed(start: np.ndarray, relative: np.ndarray) -> np.ndarray:
        result = start.copy()
        result[:3, 5 + foot] = start[:3, :3] @ relative + start[:3, 4] - OFFSET
        return result

    ekf.begin_contact(foot, FEET[foot], noise)
    np.testing.assert_allclose(ekf.pose, placed(pose, FEET[foot]), atol=1e-14)

    def error(before: np.ndarray, n: np.ndarray) -> np.ndarray:
        truth = placed(retracted(form, pose, before), FEET[foot] - n)
        return error_between(form, placed(pose, FEET[foot]), truth)

    none = np.zeros(SIZE - 6)
    change = np.eye(SIZE)
    change[:-6, :-6] = jacobian(lambda e: error(e, np.zeros(3)), SIZE - 6)
    entering = np.zeros((SIZE, 3))
    entering[:-6] = jacobian(lambda n: error(none, n), 3)
    np.testing.assert_allclose(ekf.covariance, change @ before @ change.T + entering @ noise @ entering.T, atol=1e-8)


@forms
def test_a_lost_contact_is_marginalised(form: ErrorForm) -> None:
    ekf = make(form)
    before = ekf.covariance.copy()
    ekf.end_contact(1)
    keep = np.setdiff1d(np.arange(SIZE), np.arange(12, 15))
    np.testing.assert_array_equal(ekf.covariance[np.ix_(keep, keep)], before[np.ix_(keep, keep)])
    assert not ekf.covariance[12:15].any() and not ekf.points[:, 1].any()
    assert ekf.touching.tolist() == [True, False, True]
    ekf.predict(np.ones(3), np.ones(3), 0.01)
    ekf.correct(FEET, np.tile(1e-4 * np.eye(3), (K, 1, 1)))
    assert not ekf.covariance[12:15].any() and not ekf.points[:, 1].any()  # and stays so


def test_left_and_right_are_one_filter_up_to_the_adjoint() -> None:
    """From covariances that the adjoint relates, a contact, a prediction and a correction keep them so."""
    left, right = make(LEFT, feet=(0,)), make(RIGHT, feet=(0,))

    def carried(pose: np.ndarray) -> np.ndarray:
        change = np.eye(SIZE)
        adjoint = sek3.adjoint(pose)
        open_feet = np.repeat(~left.touching, 3)
        adjoint[9:][open_feet] = 0.0  # columns that are not there have no error
        change[:-6, :-6] = adjoint
        return change @ left.covariance @ change.T

    for action in (
        lambda ekf: None,
        lambda ekf: ekf.begin_contact(1, FEET[1], 1e-4 * np.eye(3)),
        lambda ekf: ekf.predict(np.array([1.0, 2.0, -1.0]), np.array([3.0, 1.0, 9.0]), 0.2, np.ones((3, 3))),
    ):
        for ekf in (left, right):
            action(ekf)
        np.testing.assert_allclose(left.pose, right.pose, atol=1e-13)
        np.testing.assert_allclose(right.covariance, carried(right.pose), atol=1e-11)
    prior = right.pose.copy()
    for ekf in (left, right):
        ekf.correct(FEET + 0.02, np.tile(1e-4 * np.eye(3), (K, 1, 1)))
    np.testing.assert_allclose(left.pose, right.pose, atol=1e-10)
    np.testing.assert_allclose(left._bias, right._bias, atol=1e-10)
    assert np.abs(right.pose - prior).max() > 1e-3
    np.testing.assert_allclose(right.covariance, carried(prior), atol=1e-10)  # both are about the prior estimate


def test_yaw_and_position_stay_unobserved() -> None:
    """A global turn about gravity and a global shift change no measurement: the filter gains no information on them."""
    rng = np.random.default_rng(9)
    ekf = InvariantEkf(K, SILENT, slip=0.0)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.full(15, 0.3))
    shift = np.zeros((SIZE, 4))
    shift[2, 0] = 1.0  # in right-invariant coordinates: the same everywhere
    shift[6:9, 1:] = np.eye(3)
    for foot in range(K):
        ekf.begin_contact(foot, FEET[foot], 1e-4 * np.eye(3))
        shift[9 + 3 * foot : 12 + 3 * foot, 1:] = np.eye(3)
    information = shift.T @ np.linalg.solve(ekf.covariance, shift)
    for k in range(200):
        ekf.predict(rng.normal(size=3), GRAVITY + rng.normal(size=3), 0.01)
        if k % 5 == 0:
            ekf.correct(FEET + 0.02 * rng.normal(size=(K, 3)), np.tile(1e-4 * np.eye(3), (K, 1, 1)))
    after = shift.T @ np.linalg.solve(ekf.covariance, shift)
    assert (np.diag(after) <= np.diag(information) * (1.0 + 1e-6)).all()


def test_a_pose_stays_in_the_group_over_many_ticks() -> None:
    ekf = make(RIGHT)
    for _ in range(5000):
        ekf.predict(np.array([3.0, -2.0, 1.0]), np.array([0.1, 0.0, 9.8]), 0.001)
        ekf.correct(FEET, np.tile(1e-4 * np.eye(3), (K, 1, 1)))
    np.testing.assert_allclose(ekf.rotation.T @ ekf.rotation, np.eye(3), atol=1e-14)
    assert np.linalg.eigvalsh(ekf.covariance).min() > 0.0


def test_reset_takes_plain_deviations_in_world_axes() -> None:
    pose, deviations = sek3.exp(np.array([0.3, -0.5, 1.0, 1.0, 2.0, 3.0, -2.0, 1.0, 0.5])), np.arange(1.0, 16.0)
    for form in FORMS.values():
        ekf = blank(form)
        ekf.reset(pose, deviations)

        def plain(error: np.ndarray, form: ErrorForm = form) -> np.ndarray:
            wide = np.concatenate([error, np.zeros(3 * K)])
            truth = retracted(form, np.pad(pose, (0, K)) + np.diag([0.0] * 5 + [1.0] * K), wide)
            turn = so3.log(so3.project(pose[:3, :3] @ truth[:3, :3].T))
            return np.concatenate([turn, (pose[:3, 3:] - truth[:3, 3:5]).T.ravel()])

        change = jacobian(plain, 9)
        np.testing.assert_allclose(
            change @ ekf.covariance[:9, :9] @ change.T, np.diag(deviations[:9] ** 2), atol=2e-8 * 81
        )


@pytest.mark.parametrize(
    ("argument", "call"),
    [
        ("gyro", lambda ekf: ekf.predict(np.array([0.0, np.nan, 0.0]), np.zeros(3), 0.01)),
        ("accelerometer", lambda ekf: ekf.predict(np.zeros(3), np.zeros(2), 0.01)),
        ("duration", lambda ekf: ekf.predict(np.zeros(3), np.zeros(3), 0.0)),
        ("foot_rates", lambda ekf: ekf.predict(np.zeros(3), np.zeros(3), 0.01, np.zeros((2, 3)))),
        ("measured", lambda ekf: ekf.correct(np.zeros((2, 3)), np.zeros((3, 3, 3)))),
        ("covariances", lambda ekf: ekf.correct(np.zeros((3, 3)), np.full((3, 3, 3), np.inf))),
        ("foot", lambda ekf: ekf.begin_contact(3, np.zeros(3), np.eye(3))),
        ("foot", lambda ekf: ekf.end_contact(-1)),
        ("pose", lambda ekf: ekf.reset(2.0 * np.eye(5), np.zeros(15))),
        ("deviations", lambda ekf: ekf.reset(np.eye(5), -np.ones(15))),
        ("contacts", lambda ekf: InvariantEkf(0)),
        ("slip", lambda ekf: InvariantEkf(1, slip=-1.0)),
        ("gravity", lambda ekf: InvariantEkf(1, gravity=(0.0, 0.0))),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(argument: str, call) -> None:
    ekf = make(RIGHT)
    before = ekf._state.copy()
    with pytest.raises(InputError, match=f"^{argument}: got"):
        call(ekf)
    np.testing.assert_array_equal(ekf._state, before)


@forms
def test_a_tick_costs_no_more_operations_than_its_sparsity_needs(form: ErrorForm) -> None:
    """Three contacts, 24 error states; scripts/bench_estimation.py has the times."""
    assert prediction(form, K).n_instructions() < 11_000  # dense products would take 55,000
    assert correction(form, K).n_instructions() < 14_000  # a tenth of them tests each foot alone
