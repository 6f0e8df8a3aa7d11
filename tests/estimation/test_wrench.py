"""The observer on momenta whose rate is known in closed form."""

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.estimation import SteadyForce, WrenchObserver

PERIOD, TIME_CONSTANT = 1e-3, 0.02
WRENCH = np.array([3.0, -2.0, 1.0, 0.2, -0.1, 0.05])


def run(observer, wrench, ticks, known=lambda k: np.zeros(6)):
    """Momentum integrates what is known and the wrench; the controller expects what is known and the estimate."""
    momentum, estimates = np.zeros(6), []
    for k in range(ticks):
        estimates.append(observer.update(momentum).copy())
        observer.expect(known(k) + observer.wrench)
        momentum = momentum + PERIOD * (known(k) + wrench)
    return np.array(estimates)


@pytest.mark.parametrize("time_constant", [0.005, 0.02, 0.2])
def test_a_constant_wrench_is_reached_exponentially(time_constant):
    estimates = run(WrenchObserver(PERIOD, time_constant), WRENCH, 400)
    t = PERIOD * np.arange(400)
    expected = (1.0 - np.exp(-t / time_constant))[:, None] * WRENCH
    np.testing.assert_allclose(estimates, expected, atol=1e-10)


def test_expected_forces_are_not_estimated_as_a_wrench():
    def known(k):
        return np.sin(0.3 * k + np.arange(6)) * (20.0, 20.0, 30.0, 1.0, 1.0, 1.0)

    np.testing.assert_allclose(run(WrenchObserver(PERIOD, TIME_CONSTANT), np.zeros(6), 200, known), 0.0, atol=1e-9)
    pushed = run(WrenchObserver(PERIOD, TIME_CONSTANT), WRENCH, 400, known)
    np.testing.assert_allclose(pushed[-1], WRENCH, rtol=1e-7)


def test_the_estimate_is_scaled_back_to_its_force_limit():
    observer = WrenchObserver(PERIOD, TIME_CONSTANT, force_limit=2.0)
    estimates = run(observer, WRENCH, 400)
    sizes = np.linalg.norm(estimates[:, :3], axis=1)
    assert sizes.max() == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(estimates[-1] / 2.0, WRENCH / np.linalg.norm(WRENCH[:3]), rtol=1e-9)


def test_nothing_is_estimated_before_something_was_expected():
    observer = WrenchObserver(PERIOD, TIME_CONSTANT)
    for momentum in (np.ones(6), 5.0 * np.ones(6)):
        np.testing.assert_array_equal(observer.update(momentum), 0.0)


def test_reset_forgets():
    observer = WrenchObserver(PERIOD, TIME_CONSTANT)
    run(observer, WRENCH, 100)
    observer.reset()
    np.testing.assert_array_equal(observer.wrench, 0.0)
    np.testing.assert_array_equal(observer.update(np.full(6, 50.0)), 0.0)  # no jump from the momentum before
    observer.reset()
    fresh = WrenchObserver(PERIOD, TIME_CONSTANT)
    np.testing.assert_array_equal(run(observer, WRENCH, 50), run(fresh, WRENCH, 50))


@pytest.mark.parametrize("delay", [1.0, 3.0, 4.25])  # ticks
def test_commands_that_act_with_a_delay_are_not_estimated_as_a_wrench(delay):
    """Between two measurements acts what was commanded so many ticks before, mixed where it is no whole number."""

    def known(k):
        return np.sin(0.3 * k + np.arange(6)) * (20.0, 20.0, 30.0, 1.0, 1.0, 1.0)

    whole, part = divmod(delay, 1.0)

    def acting(k):
        return (1.0 - part) * known(k - whole) + part * known(k - whole - 1)

    def simulated(wrench, believed):
        observer, momentum, estimates = WrenchObserver(PERIOD, TIME_CONSTANT, delay=PERIOD * believed), np.zeros(6), []
        for k in range(400):
            estimates.append(observer.update(momentum).copy())
            observer.expect(known(k) + observer.wrench)
            momentum = momentum + PERIOD * (acting(k) + wrench)
        return np.array(estimates)

    np.testing.assert_allclose(simulated(np.zeros(6), delay), 0.0, atol=1e-9)
    np.testing.assert_allclose(simulated(WRENCH, delay)[-1], WRENCH, rtol=1e-6)
    assert np.abs(simulated(np.zeros(6), 0.0)).max() > 1.0


def test_a_missed_tick_keeps_commands_and_measurements_aligned():
    """Every tenth tick is missed: its command is the one before, for twice as long."""
    observer, momentum, flying = (
        WrenchObserver(PERIOD, TIME_CONSTANT, delay=2.0 * PERIOD),
        np.zeros(6),
        [np.zeros(6)] * 2,
    )
    for k in range(600):
        if k % 10 != 9:
            if k % 10 == 0 and k:
                observer.miss(1)
            observer.update(momentum)
            rate = np.sin(0.3 * k + np.arange(6))
            observer.expect(rate + observer.wrench)
        flying.append(rate)
        momentum = momentum + PERIOD * (flying[-3] + WRENCH)
    np.testing.assert_allclose(observer.wrench, WRENCH, rtol=1e-6)


@pytest.mark.parametrize("deviation", [0.02, 0.075])  # N.s: 0.075 is 0.03 m/s of Solo12
def test_noise_of_the_momentum_makes_the_observer_as_slow_as_needed(deviation):
    """White noise of a standard deviation s leaves s / T in the estimate: T settles where that is what is allowed."""
    allowed, rng = 0.8, np.random.default_rng(3)
    observer = WrenchObserver(PERIOD, 0.01, noise_force=allowed)
    momentum, forces, times = np.zeros(6), [], []
    for _ in range(6000):
        observer.update(momentum + np.concatenate([deviation * rng.normal(size=3), np.zeros(3)]))
        observer.expect(observer.wrench)
        momentum = momentum + PERIOD * WRENCH
        forces.append(observer.wrench[:3].copy())
        times.append(observer.time_constant)
    assert np.mean(times[1000:]) == pytest.approx(deviation / allowed, rel=0.1)
    deviations = np.array(forces[1000:]) - WRENCH[:3]
    assert np.sqrt(np.mean(deviations**2)) == pytest.approx(allowed, rel=0.2)
    assert np.abs(deviations.mean(axis=0)).max() < 0.2


def test_without_noise_the_time_constant_stays_whatever_the_wrench_does():
    observer, momentum = WrenchObserver(PERIOD, 0.01, noise_force=0.8), np.zeros(6)
    for k in range(1000):
        observer.update(momentum)
        observer.expect(observer.wrench)
        momentum = momentum + PERIOD * WRENCH * (20.0 if k % 200 < 100 else 1.0)
        assert observer.time_constant == 0.01


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_poison_leaves_the_estimate_as_it_was(poison):
    observer = WrenchObserver(PERIOD, TIME_CONSTANT)
    run(observer, WRENCH, 100)
    before = observer.wrench.copy()
    observer.update(np.full(6, poison))  # a bad measurement spoils this difference and the next
    observer.expect(before)
    np.testing.assert_array_equal(observer.update(np.zeros(6)), before)
    observer.expect(np.full(6, poison))
    np.testing.assert_array_equal(observer.update(np.zeros(6)), before)
    observer.expect(before)
    observer.update(PERIOD * WRENCH)
    assert np.isfinite(observer.wrench).all() and not np.array_equal(observer.wrench, before)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("period", 0.0),
        ("period", np.inf),
        ("time_constant", -1.0),
        ("force_limit", 0.0),
        ("force_limit", np.nan),
        ("delay", -1e-3),
        ("noise_force", 0.0),
    ],
)
def test_impossible_settings_are_refused(argument, value):
    with pytest.raises(InputError, match=f"^{argument}: got"):
        WrenchObserver(**({"period": PERIOD} | {argument: value}))


def test_the_force_that_lasts_is_the_median_of_the_window() -> None:
    rng = np.random.default_rng(4)
    forces = np.round(rng.normal(0.0, 3.0, (300, 3)), 1)  # with repetitions
    for count in (1, 7, 20):
        steady = SteadyForce(0.01, 0.5, 0.01 * count)
        padded = np.vstack([np.zeros((count, 3)), forces])
        for k, force in enumerate(forces, start=1):
            median = np.median(padded[k : k + count, :2], axis=0)
            expected = np.sign(median) * np.maximum(np.abs(median) - 0.5, 0.0)
            np.testing.assert_allclose(steady.update(force), expected, rtol=0.0, atol=1e-12)
    steady.reset()
    assert steady.force == (0.0, 0.0) and steady.update(forces[0]) == (0.0, 0.0)


def test_a_wrench_that_the_commands_leave_out_does_not_wind_up():
    observer, momentum = WrenchObserver(PERIOD, TIME_CONSTANT), np.zeros(6)
    for _ in range(400):  # as on soles, where the whole-body QP stands as if nothing pushed
        observer.update(momentum)
        observer.expect(np.zeros(6), wrench=np.zeros(6))
        momentum = momentum + PERIOD * WRENCH
    np.testing.assert_allclose(observer.wrench, WRENCH, rtol=1e-7)
