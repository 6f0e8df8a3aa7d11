"""Landmarks of known position: Jacobians, both invariant forms, consistency, observability."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from samples import jacobian, retracted
from scipy.stats import chi2

from lgmpc.demos.simulated_trot import SimulatedTrot, simulate_trot
from lgmpc.errors import InputError
from lgmpc.estimation import InvariantEkf
from lgmpc.estimation.inertial import ImuNoise
from lgmpc.estimation.invariant_ekf import FORMS, LEFT, RIGHT, ErrorForm
from lgmpc.lie import sek3, so3

pytestmark = pytest.mark.usefixtures("interpreted")
NOISE = ImuNoise(
    gyro_noise_rad_s_rt_hz=2e-3,
    gyro_bias_walk_rad_s2_rt_hz=1e-3,
    accelerometer_noise_m_s2_rt_hz=2e-2,
    accelerometer_bias_walk_m_s3_rt_hz=1e-2,
)
SLIP, SIGHT = 0.005, 0.01
OFFSET = (0.0, 0.0, 0.02)
LANDMARKS = np.array([[2.0, 1.0, 0.5], [1.0, -2.0, 1.0], [-2.0, 0.5, 0.2]])
SIZE = 15 + 3 * 4
SEEN = np.array([0.8, -0.5, 0.3])
SPREAD = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]]) * 1e-3
DEVIATIONS = np.repeat([0.1, 0.2, 0.1, 0.005, 0.05], 3)


@pytest.fixture(params=FORMS.values(), ids=FORMS.keys())
def form(request: pytest.FixtureRequest) -> ErrorForm:
    """Every form."""
    found: ErrorForm = request.param
    return found


@functools.cache
def blank(form: ErrorForm) -> InvariantEkf:
    """One filter for all tests: making one costs more than using it."""
    return InvariantEkf(4, NOISE, slip=SLIP, contact_offset=OFFSET, form=form)


def make(form: ErrorForm) -> InvariantEkf:
    """A filter with correlations, two feet in contact."""
    rng, ekf = np.random.default_rng(0), blank(form)
    ekf.reset(sek3.exp(rng.normal(size=9)), rng.uniform(0.02, 0.1, 15), 0.1 * rng.normal(size=3), rng.normal(size=3))
    for index in (0, 2):
        ekf.predict(rng.normal(size=3), 5.0 * rng.normal(size=3), 0.02)
        ekf.begin_contact(index, rng.normal(size=3), 1e-4 * np.eye(3))
    return ekf


def relative(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point of the world as the base sees it."""
    return pose[:3, :3].T @ (point - pose[:3, 4])


def test_a_correction_is_the_kalman_update_with_a_finite_difference_jacobian(form: ErrorForm) -> None:
    ekf = make(form)
    pose, biases, before = ekf.pose.copy(), ekf._bias.copy(), ekf.covariance.copy()
    place = pose[:3, 4] + pose[:3, :3] @ SEEN + [0.02, -0.01, 0.03]
    slope = jacobian(lambda e: relative(retracted(form, pose, e), place), SIZE - 6)
    matrix = np.hstack([slope, np.zeros((3, 6))])
    measured = relative(pose, place) + [0.01, -0.02, 0.01]
    gain = before @ matrix.T @ np.linalg.inv(matrix @ before @ matrix.T + SPREAD)
    ekf.correct_known_landmark(place, measured, SPREAD)
    error = gain @ (measured - relative(pose, place))
    assert np.abs(error).max() > 1e-3
    np.testing.assert_allclose(ekf.pose, retracted(form, pose, error[:-6]), atol=1e-9)
    np.testing.assert_allclose(ekf._bias, biases - error[-6:], atol=1e-9)
    np.testing.assert_allclose(ekf.covariance, before - gain @ matrix @ before, atol=1e-9)
    np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)
    assert not ekf.points[:, 1].any() and not ekf.covariance[12:15].any()  # an open contact, which stays so


def test_left_and_right_are_one_filter_up_to_the_adjoint() -> None:
    left, right = blank(LEFT), blank(RIGHT)
    start = sek3.exp(np.random.default_rng(1).normal(size=9))
    for ekf in (left, right):
        ekf.reset(start, np.repeat([0.05, 0.1, 0.1, 0.01, 0.1], 3))
        ekf.begin_contact(1, np.array([0.2, 0.1, -0.3]), 1e-4 * np.eye(3))
        ekf.predict(np.array([1.0, 2.0, -1.0]), np.array([3.0, 1.0, 9.0]), 0.05)
    prior = right.pose.copy()
    np.testing.assert_allclose(left.pose, prior, atol=1e-9)
    change = np.eye(SIZE)
    change[:-6, :-6] = sek3.adjoint(prior)
    change[np.repeat([False] * 3 + [*~right.touching] + [False] * 2, 3)] = 0.0
    np.testing.assert_allclose(right.covariance, change @ left.covariance @ change.T, atol=1e-9)
    place = start[:3, 4] + start[:3, :3] @ SEEN + [0.02, -0.01, 0.03]
    for ekf in (left, right):
        ekf.correct_known_landmark(place, SEEN, SPREAD)
    assert np.abs(right.pose - prior).max() > 1e-3
    np.testing.assert_allclose(left.pose, right.pose, atol=1e-9)
    np.testing.assert_allclose(left._bias, right._bias, atol=1e-9)
    np.testing.assert_allclose(right.covariance, change @ left.covariance @ change.T, atol=1e-9)  # about the prior


def run(ekf: InvariantEkf, walk: SimulatedTrot, rng: np.random.Generator, seen: tuple[int, ...]) -> int:
    """Run a filter on a trot with sightings of these landmarks at 20 Hz; return the instant of the last ones."""
    spread, last = SIGHT**2 * np.eye(3), 0
    for k in walk.run(ekf):
        if k % 10 == 0:
            for place in LANDMARKS[list(seen)]:
                measured = relative(walk.poses[k], place) + SIGHT * rng.normal(size=3)
                ekf.correct_known_landmark(place, measured, spread)
            last = k
    return last


def disturbed(walk: SimulatedTrot, drawn: np.ndarray) -> np.ndarray:
    start = walk.poses[0].copy()
    start[:3, :3] = so3.exp(drawn[:3]) @ start[:3, :3]
    start[:3, 3:] += drawn[3:9].reshape(2, 3).T
    return start


@pytest.mark.parametrize("seen", [pytest.param((0, 1, 2), marks=pytest.mark.slow), (1,)], ids=["all", "one"])
def test_the_filter_is_consistent(seen: tuple[int, ...]) -> None:
    """NEES of feet, base and biases after half a second of trotting and sightings, 20 runs."""
    ekf = InvariantEkf(4, NOISE, slip=SLIP)
    squares, freedoms = 0.0, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walk = simulate_trot(rng, NOISE, duration=0.5, slip=SLIP)
        ekf.reset(disturbed(walk, DEVIATIONS[:9] * rng.normal(size=9)), DEVIATIONS)
        last = run(ekf, walk, rng, seen)
        square, freedom = walk.normalised_error(ekf, last)
        squares, freedoms = squares + square, freedoms + freedom
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], freedoms)
    assert low < squares < high, (squares / freedoms, low / freedoms, high / freedoms)


def test_known_landmarks_make_yaw_and_position_converge() -> None:
    """From 17 degrees of yaw and 0.7 m.

    The first velocity is left open: from one that is known in world axes, the measured one in body axes fixes the yaw.
    """
    deviations = np.concatenate([[0.1, 0.1, 0.3], [3.0] * 3, [0.5] * 3, DEVIATIONS[9:]])
    errors = {}
    for seen in ((), (0, 1, 2)):
        rng = np.random.default_rng(5)
        walk = simulate_trot(rng, NOISE, duration=1.0, slip=SLIP)
        ekf = InvariantEkf(4, NOISE, slip=SLIP)
        ekf.reset(disturbed(walk, np.array([0.05, -0.05, 0.3, 0.1, 0.1, -0.1, 0.5, -0.4, 0.3])), deviations)
        run(ekf, walk, rng, seen)
        turn = so3.log(ekf.rotation @ walk.poses[-1][:3, :3].T)
        errors[seen] = abs(turn[2]), float(np.linalg.norm(ekf.position - walk.poses[-1][:3, 4]))
        assert np.linalg.norm(turn[:2]) < 0.02  # roll and pitch are observable either way
    assert errors[(0, 1, 2)][0] < 0.01 and errors[(0, 1, 2)][1] < 0.02
    assert errors[()][0] > 0.28 and errors[()][1] > 0.6


@functools.cache
def _information(form: ErrorForm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information about yaw and position: at first, after corrections by the feet, and after a known landmark."""
    rng = np.random.default_rng(9)
    ekf = InvariantEkf(4, ImuNoise(**dict.fromkeys(ImuNoise.model_fields, 0.0)), slip=0.0, form=form)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.full(15, 0.3))
    for i in range(4):
        ekf.begin_contact(i, rng.normal(size=3), 1e-4 * np.eye(3))

    def information() -> np.ndarray:
        shift = np.zeros((SIZE, 4))  # a turn about gravity and a shift of the world, as right-invariant errors
        shift[2, 0] = 1.0
        shift[6:-6, 1:] = np.tile(np.eye(3), (5, 1))
        if form is LEFT:
            shift[:-6] = sek3.adjoint(sek3.inverse(ekf.pose)) @ shift[:-6]
        return np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))

    before = information()
    for _ in range(100):
        ekf.predict(rng.normal(size=3), rng.normal(size=3) + [0.0, 0.0, 9.81], 0.01)
        seen = np.array([relative(ekf.pose, point) for point in ekf.points.T]) + 0.05 * rng.normal(size=(4, 3))
        ekf.correct(seen, np.tile(SPREAD, (4, 1, 1)))
    after = information()
    ekf.correct_known_landmark(np.array([1.0, 2.0, 3.0]), SEEN, SPREAD)
    return before, after, information()


def test_feet_give_no_information_about_yaw_and_position() -> None:
    """A turn about gravity and a shift of the world change no measurement: exactly so in right-invariant errors."""
    before, after, with_landmark = _information(RIGHT)
    assert (after <= before * (1.0 + 1e-6)).all()
    assert (with_landmark[1:] > 2.0 * after[1:]).all()


def test_the_left_form_gains_false_information_about_yaw_and_position() -> None:
    """The same shifts and turns of the world, in the left-invariant error of the present estimate."""
    before, after, _ = _information(LEFT)
    assert (after > 1.05 * before).any()


@pytest.mark.parametrize(
    ("argument", "call"),
    [
        ("measured", lambda ekf: ekf.correct_known_landmark(SEEN, np.full(3, np.nan), SPREAD)),
        ("covariance", lambda ekf: ekf.correct_known_landmark(SEEN, SEEN, np.eye(2))),
        ("position", lambda ekf: ekf.correct_known_landmark(np.zeros(2), SEEN, SPREAD)),
        ("measured", lambda ekf: ekf.correct_known_landmark(SEEN, np.zeros((1, 3)), SPREAD)),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(argument: str, call) -> None:
    ekf = make(RIGHT)
    before = ekf._state.copy()
    with pytest.raises(InputError, match=f"^{argument}: got"):
        call(ekf)
    np.testing.assert_array_equal(ekf._state, before)
