"""Landmarks of known and of unknown position: Jacobians, both invariant forms, consistency, observability."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from samples import error_between, jacobian, retracted
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
M = len(LANDMARKS)
SIZE = 15 + 3 * (4 + M)
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
    return InvariantEkf(4, NOISE, landmarks=M, slip=SLIP, contact_offset=OFFSET, form=form)


def make(form: ErrorForm) -> InvariantEkf:
    """A filter with correlations, two feet in contact, landmarks 0 and 2 mapped."""
    rng, ekf = np.random.default_rng(0), blank(form)
    ekf.reset(sek3.exp(rng.normal(size=9)), rng.uniform(0.02, 0.1, 15), 0.1 * rng.normal(size=3), rng.normal(size=3))
    for index in (0, 2):
        ekf.predict(rng.normal(size=3), 5.0 * rng.normal(size=3), 0.02)
        ekf.begin_contact(index, rng.normal(size=3), 1e-4 * np.eye(3))
        ekf.add_landmark(index, rng.normal(size=3), SPREAD)
    return ekf


def relative(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point of the world as the base sees it."""
    return pose[:3, :3].T @ (point - pose[:3, 4])


@pytest.mark.parametrize("known", [False, True], ids=["mapped", "known"])
def test_a_correction_is_the_kalman_update_with_a_finite_difference_jacobian(form: ErrorForm, known: bool) -> None:
    ekf = make(form)
    pose, biases, before = ekf.pose.copy(), ekf._bias.copy(), ekf.covariance.copy()
    place = pose[:3, 4] + pose[:3, :3] @ SEEN + [0.02, -0.01, 0.03]

    def measure(truth: np.ndarray) -> np.ndarray:
        return relative(truth, place if known else truth[:3, 5 + 4 + 2])

    slope = jacobian(lambda e: measure(retracted(form, pose, e)), SIZE - 6)
    matrix = np.hstack([slope, np.zeros((3, 6))])
    measured = measure(pose) + [0.01, -0.02, 0.01]
    gain = before @ matrix.T @ np.linalg.inv(matrix @ before @ matrix.T + SPREAD)
    if known:
        ekf.correct_known_landmark(place, measured, SPREAD)
    else:
        ekf.correct_landmark(2, measured, SPREAD)
    error = gain @ (measured - measure(pose))
    assert np.abs(error).max() > 1e-3
    np.testing.assert_allclose(ekf.pose, retracted(form, pose, error[:-6]), atol=1e-9)
    np.testing.assert_allclose(ekf._bias, biases - error[-6:], atol=1e-9)
    np.testing.assert_allclose(ekf.covariance, before - gain @ matrix @ before, atol=1e-9)
    np.testing.assert_array_equal(ekf.covariance, ekf.covariance.T)
    assert not ekf.landmark_positions[:, 1].any() and not ekf.covariance[24:27].any()  # not mapped, and stays so


def test_a_new_landmark_has_the_covariance_of_finite_differences(form: ErrorForm) -> None:
    ekf = make(form)
    pose, before = ekf.pose.copy(), ekf.covariance.copy()

    def placed(start: np.ndarray, measured: np.ndarray) -> np.ndarray:
        result = start.copy()
        result[:3, 5 + 4 + 1] = start[:3, :3] @ measured + start[:3, 4]
        return result

    def error(before: np.ndarray, noise: np.ndarray) -> np.ndarray:
        truth = placed(retracted(form, pose, before), SEEN - noise)
        return error_between(form, placed(pose, SEEN), truth)

    ekf.add_landmark(1, SEEN, SPREAD)
    np.testing.assert_allclose(ekf.pose, placed(pose, SEEN), atol=1e-14)
    change, entering = np.eye(SIZE), np.zeros((SIZE, 3))
    change[:-6, :-6] = jacobian(lambda e: error(e, np.zeros(3)), SIZE - 6)
    entering[:-6] = jacobian(lambda n: error(np.zeros(SIZE - 6), n), 3)
    np.testing.assert_allclose(ekf.covariance, change @ before @ change.T + entering @ SPREAD @ entering.T, atol=1e-8)
    assert ekf.mapped.tolist() == [True, True, True]


def test_left_and_right_are_one_filter_up_to_the_adjoint() -> None:
    left, right = blank(LEFT), blank(RIGHT)
    start = sek3.exp(np.random.default_rng(1).normal(size=9))
    for ekf in (left, right):
        ekf.reset(start, np.repeat([0.05, 0.1, 0.1, 0.01, 0.1], 3))
        ekf.begin_contact(1, np.array([0.2, 0.1, -0.3]), 1e-4 * np.eye(3))
    place = start[:3, 4] + start[:3, :3] @ SEEN + [0.02, -0.01, 0.03]
    for action in (
        lambda ekf: ekf.add_landmark(1, SEEN, SPREAD),
        lambda ekf: ekf.predict(np.array([1.0, 2.0, -1.0]), np.array([3.0, 1.0, 9.0]), 0.05),
        lambda ekf: ekf.correct_landmark(1, relative(ekf.pose, ekf.landmark_positions[:, 1]) + 0.02, SPREAD),
    ):
        for ekf in (left, right):
            prior = ekf.pose.copy()
            action(ekf)
        np.testing.assert_allclose(left.pose, right.pose, atol=1e-9)
    change = np.eye(SIZE)
    change[:-6, :-6] = sek3.adjoint(prior)  # a correction's covariance is about the prior estimate
    unused = np.repeat([False] * 3 + [*~left.touching, *~left.mapped] + [False] * 2, 3)
    change[unused] = 0.0
    np.testing.assert_allclose(right.covariance, change @ left.covariance @ change.T, atol=1e-9)
    # From covariances that are the same up to the adjoint of the present estimate, a known landmark corrects alike.
    change[:-6, :-6] = sek3.adjoint(right.pose)
    change[unused] = 0.0
    right._covariance[:] = change @ left.covariance @ change.T
    for ekf in (left, right):
        ekf.correct_known_landmark(place, SEEN, SPREAD)
    np.testing.assert_allclose(left.pose, right.pose, atol=1e-9)
    np.testing.assert_allclose(left._bias, right._bias, atol=1e-9)


def test_a_removed_landmark_is_marginalised_and_its_place_taken_again() -> None:
    ekf = make(RIGHT)
    before = ekf.covariance.copy()
    ekf.remove_landmark(2)
    keep = np.setdiff1d(np.arange(SIZE), np.arange(27, 30))
    np.testing.assert_array_equal(ekf.covariance[np.ix_(keep, keep)], before[np.ix_(keep, keep)])
    assert not ekf.covariance[27:30].any() and not ekf.landmark_positions[:, 2].any()
    assert ekf.mapped.tolist() == [True, False, False] and ekf.touching.tolist() == [True, False, True, False]
    ekf.add_landmark(2, SEEN, SPREAD)
    np.testing.assert_allclose(relative(ekf.pose, ekf.landmark_positions[:, 2]), SEEN, atol=1e-14)
    ekf.reset(np.eye(5), np.ones(15))
    assert not ekf.mapped.any()


def test_landmarks_rest_while_the_base_moves() -> None:
    ekf = make(RIGHT)
    before = ekf.landmark_positions.copy()
    ekf.reset(ekf.pose[:5, :5], np.zeros(15))
    for index, position in zip((0, 2), before.T[[0, 2]], strict=True):
        ekf.add_landmark(index, relative(ekf.pose, position), SPREAD)
    spread = ekf.covariance[21:30, 21:30].copy()
    for _ in range(50):
        ekf.predict(np.array([0.3, -0.2, 0.5]), np.array([0.0, 1.0, 9.8]), 0.01, np.ones((4, 3)))
    np.testing.assert_array_equal(ekf.landmark_positions, before * [1.0, 0.0, 1.0])
    assert np.abs(ekf.covariance[21:30, 21:30] - spread).max() > 0.0  # world axes: attitude and point are correlated


def run(ekf: InvariantEkf, walk: SimulatedTrot, rng: np.random.Generator, known: tuple[int, ...]) -> list[int]:
    """Run a filter on a trot with sightings of all landmarks at 20 Hz; returns the instants of these."""
    spread, instants = SIGHT**2 * np.eye(3), []
    for k in walk.run(ekf):
        if k % 10 == 0:
            for i, place in enumerate(LANDMARKS):
                measured = relative(walk.poses[k], place) + SIGHT * rng.normal(size=3)
                if i in known:
                    ekf.correct_known_landmark(place, measured, spread)
                elif ekf.mapped[i]:
                    ekf.correct_landmark(i, measured, spread)
                else:
                    ekf.add_landmark(i, measured, spread)
            instants.append(k)
    return instants


def disturbed(walk: SimulatedTrot, drawn: np.ndarray) -> np.ndarray:
    start = walk.poses[0].copy()
    start[:3, :3] = so3.exp(drawn[:3]) @ start[:3, :3]
    start[:3, 3:] += drawn[3:9].reshape(2, 3).T
    return start


@pytest.mark.parametrize(
    "known",
    [
        pytest.param((), id="unknown", marks=pytest.mark.slow),
        pytest.param((0, 1, 2), id="known", marks=pytest.mark.slow),
        pytest.param((1,), id="mixed"),
    ],
)
def test_the_filter_is_consistent(known: tuple[int, ...]) -> None:
    """NEES of feet, landmarks, base and biases after half a second of trotting and sightings, 20 runs."""
    ekf = InvariantEkf(4, NOISE, landmarks=M, slip=SLIP)
    squares, freedoms = 0.0, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walk = simulate_trot(rng, NOISE, duration=0.5, slip=SLIP)
        ekf.reset(disturbed(walk, DEVIATIONS[:9] * rng.normal(size=9)), DEVIATIONS)
        last = run(ekf, walk, rng, known)[-1]
        square, freedom = walk.normalised_error(ekf, last, LANDMARKS)
        squares, freedoms = squares + square, freedoms + freedom
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], freedoms)
    assert low < squares < high, (squares / freedoms, low / freedoms, high / freedoms)


def test_known_landmarks_make_yaw_and_position_converge_and_mapped_ones_do_not() -> None:
    """From 17 degrees of yaw and 0.7 m.

    The first velocity is left open: from one that is known in world axes, the measured one in body axes fixes the yaw.
    """
    deviations = np.concatenate([[0.1, 0.1, 0.3], [3.0] * 3, [0.5] * 3, DEVIATIONS[9:]])
    errors = {}
    for known in ((), (0, 1, 2)):
        rng = np.random.default_rng(5)
        walk = simulate_trot(rng, NOISE, duration=1.0, slip=SLIP)
        ekf = InvariantEkf(4, NOISE, landmarks=M, slip=SLIP)
        ekf.reset(disturbed(walk, np.array([0.05, -0.05, 0.3, 0.1, 0.1, -0.1, 0.5, -0.4, 0.3])), deviations)
        run(ekf, walk, rng, known)
        turn = so3.log(ekf.rotation @ walk.poses[-1][:3, :3].T)
        errors[known] = abs(turn[2]), float(np.linalg.norm(ekf.position - walk.poses[-1][:3, 4]))
        assert np.linalg.norm(turn[:2]) < 0.02  # roll and pitch are observable either way
        if not known:  # the map is right but for the start's yaw and position
            seen = ekf.rotation.T @ (ekf.landmark_positions - ekf.position[:, None])
            true = walk.poses[-1][:3, :3].T @ (LANDMARKS.T - walk.poses[-1][:3, 4:])
            assert np.abs(seen - true).max() < 0.03
    assert errors[(0, 1, 2)][0] < 0.01 and errors[(0, 1, 2)][1] < 0.02
    assert errors[()][0] > 0.28 and errors[()][1] > 0.6


def test_landmarks_of_unknown_position_give_no_information_about_yaw_and_position() -> None:
    """A turn about gravity and a shift of the world change no measurement: exactly so in right-invariant errors."""
    rng = np.random.default_rng(9)
    ekf = InvariantEkf(4, ImuNoise(**dict.fromkeys(ImuNoise.model_fields, 0.0)), landmarks=M, slip=0.0)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.full(15, 0.3))
    for i in range(4):
        ekf.begin_contact(i, rng.normal(size=3), 1e-4 * np.eye(3))
    for i in range(M):
        ekf.add_landmark(i, rng.normal(size=3), SPREAD)
    shift = np.zeros((SIZE, 4))
    shift[2, 0] = 1.0
    shift[6:-6, 1:] = np.tile(np.eye(3), (1 + 4 + M, 1))
    information = np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))
    for k in range(100):
        ekf.predict(rng.normal(size=3), rng.normal(size=3) + [0.0, 0.0, 9.81], 0.01)
        i = k % M
        seen = relative(ekf.pose, ekf.landmark_positions[:, i]) + 0.05 * rng.normal(size=3)
        ekf.correct_landmark(i, seen, SPREAD)
    after = np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))
    assert (after <= information * (1.0 + 1e-6)).all()
    ekf.correct_known_landmark(np.array([1.0, 2.0, 3.0]), SEEN, SPREAD)
    with_known = np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))
    assert (with_known[1:] > 2.0 * after[1:]).all()  # unlike one whose position is known


def test_the_left_form_gains_false_information_about_yaw_and_position() -> None:
    """The same shifts and turns of the world, in the left-invariant error of the present estimate."""
    rng = np.random.default_rng(9)
    ekf = InvariantEkf(4, ImuNoise(**dict.fromkeys(ImuNoise.model_fields, 0.0)), landmarks=M, slip=0.0, form=LEFT)
    ekf.reset(sek3.exp(rng.normal(size=9)), np.full(15, 0.3))
    for i in range(4):
        ekf.begin_contact(i, rng.normal(size=3), 1e-4 * np.eye(3))
    for i in range(M):
        ekf.add_landmark(i, rng.normal(size=3), SPREAD)

    def information() -> np.ndarray:
        shift = np.zeros((SIZE, 4))
        shift[2, 0] = 1.0
        shift[6:-6, 1:] = np.tile(np.eye(3), (1 + 4 + M, 1))
        shift[:-6] = sek3.adjoint(sek3.inverse(ekf.pose)) @ shift[:-6]
        return np.diag(shift.T @ np.linalg.solve(ekf.covariance, shift))

    before = information()
    for k in range(100):
        ekf.predict(rng.normal(size=3), rng.normal(size=3) + [0.0, 0.0, 9.81], 0.01)
        i = k % M
        seen = relative(ekf.pose, ekf.landmark_positions[:, i]) + 0.05 * rng.normal(size=3)
        ekf.correct_landmark(i, seen, SPREAD)
    assert (information() > 1.05 * before).any()


@pytest.mark.parametrize(
    ("argument", "call"),
    [
        ("landmark", lambda ekf: ekf.add_landmark(3, SEEN, SPREAD)),
        ("landmark", lambda ekf: ekf.remove_landmark(-1)),
        ("landmark", lambda ekf: ekf.correct_landmark(3, SEEN, SPREAD)),
        ("landmark", lambda ekf: ekf.correct_landmark(1, SEEN, SPREAD)),  # not mapped
        ("measured", lambda ekf: ekf.add_landmark(1, np.full(3, np.nan), SPREAD)),
        ("covariance", lambda ekf: ekf.correct_landmark(0, SEEN, np.eye(2))),
        ("position", lambda ekf: ekf.correct_known_landmark(np.zeros(2), SEEN, SPREAD)),
        ("measured", lambda ekf: ekf.correct_known_landmark(SEEN, np.zeros((1, 3)), SPREAD)),
        ("landmarks", lambda ekf: InvariantEkf(1, landmarks=-1)),
        ("landmark", lambda ekf: InvariantEkf(1).add_landmark(0, SEEN, SPREAD)),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(argument: str, call) -> None:
    ekf = make(RIGHT)
    before = ekf._state.copy()
    with pytest.raises(InputError, match=f"^{argument}: got"):
        call(ekf)
    np.testing.assert_array_equal(ekf._state, before)
    assert ekf.mapped.tolist() == [True, False, True]
