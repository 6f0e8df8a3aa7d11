"""The link between robot and controller, the drives, and the time of computing."""

import math

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.config.build import prepare
from lgmpc.control.interface import Command
from lgmpc.errors import InputError
from lgmpc.simulation.drives import ActuatorSettings, Computing, DelayLine, Drives, LinkSettings, Spent, TimingSettings

RNG = np.random.default_rng


def test_a_delay_line_delivers_late_and_in_order() -> None:
    line: DelayLine[int] = DelayLine(0.003, 0.0, RNG(0))
    received = []
    for k in range(8):
        line.send(k, 1e-3 * k)
        received.append(line.receive(1e-3 * k))
    assert received == [0, 0, 0, 0, 1, 2, 3, 4]  # the first at once, then three ticks late


def test_jitter_lets_no_older_value_replace_a_newer_one() -> None:
    line: DelayLine[int] = DelayLine(0.001, 0.004, RNG(1))
    received = []
    for k in range(2000):
        line.send(k, 1e-3 * k)
        received.append(line.receive(1e-3 * k))
    ages = np.arange(2000) - np.array(received)
    assert np.all(np.diff(received) >= 0)
    assert ages[10:].min() >= 1 and ages.max() <= 5
    assert len(set(ages[10:].tolist())) > 2


def command(tau: float) -> Command:
    return Command.feed_forward(np.array([tau]), np.zeros(1))


def drives(link: LinkSettings | None = None, actuators: ActuatorSettings | None = None) -> Drives:
    return Drives(link or LinkSettings(), actuators or ActuatorSettings(), 1e-3, RNG(0))


def test_a_lost_command_leaves_the_last_one_in_force() -> None:
    link = drives(LinkSettings(dropped_commands=0.5))
    got = []
    for k in range(1000):
        link.send(command(float(k)), 1e-3 * k)
        got.append(float(link.torque(1e-3 * k, np.zeros(1), np.zeros(1))[0]))
    fresh = np.array(got) == np.arange(1000)
    assert 440 < fresh.sum() < 560  # four deviations of 1000 fair draws
    assert all(got[k] == (k if fresh[k] else got[k - 1]) for k in range(1, 1000))


def test_the_torque_lags_as_a_first_order_filter() -> None:
    slow = drives(actuators=ActuatorSettings(bandwidth_hz=20.0))
    slow.send(command(0.0), 0.0)
    assert slow.torque(0.0, np.zeros(1), np.zeros(1))[0] == 0.0
    slow.send(command(1.0), 1e-3)
    response = [float(slow.torque(1e-3 * k, np.zeros(1), np.zeros(1))[0]) for k in range(1, 41)]
    expected = [1.0 - math.exp(-2.0 * math.pi * 20.0 * 1e-3 * k) for k in range(1, 41)]
    assert response == pytest.approx(expected, abs=1e-12)


def test_the_supply_limits_what_drives_and_not_what_brakes() -> None:
    motor = drives(actuators=ActuatorSettings(stall_torque_nm=2.0, no_load_speed_rad_s=40.0))
    motor.send(command(1.8), 0.0)

    def torque(speed: float) -> float:
        return float(motor.torque(0.0, np.zeros(1), np.array([speed]))[0])

    assert [torque(speed) for speed in (0.0, 2.0, 20.0, 40.0, 50.0)] == pytest.approx([1.8, 1.8, 1.0, 0.0, 0.0])
    assert torque(-30.0) == 1.8
    motor.send(command(-1.8), 1.0)
    assert motor.torque(1.0, np.zeros(1), np.array([-20.0]))[0] == pytest.approx(-1.0)


def test_computing_times_follow_their_quantiles() -> None:
    settings = TimingSettings(computing="modelled", tick_ms=(0.1, 0.2, 0.6), plan_ms=(1.0, 3.0), forecast_ms=(0.5, 1.5))
    computing = Computing(settings, RNG(0))
    ticks = 1e3 * np.array([computing.spent(lambda: Spent(9.0, False, False)) for _ in range(4000)])
    assert 0.1 <= ticks.min() and ticks.max() <= 0.6
    assert np.median(ticks) == pytest.approx(0.2, abs=0.02)
    plans = 1e3 * np.array([computing.spent(lambda: Spent(9.0, True, False)) for _ in range(4000)])
    assert plans.mean() - ticks.mean() == pytest.approx(2.0, abs=0.05)
    forecasts = 1e3 * np.array([computing.spent(lambda: Spent(9.0, False, True)) for _ in range(4000)])
    assert forecasts.mean() - ticks.mean() == pytest.approx(1.0, abs=0.03)
    assert Computing(TimingSettings(computing="measured"), RNG(0)).spent(lambda: Spent(0.004, True, False)) == 0.004
    assert Computing(TimingSettings(), RNG(0)).spent(lambda: Spent(0.004, True, False)) == 0.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ActuatorSettings(stall_torque_nm=1.0), "no_load_speed_rad_s: got nothing"),
        (lambda: TimingSettings(tick_ms=(0.2, 0.1)), "tick_ms: .*do not decrease"),
        (lambda: TimingSettings(plan_ms=(0.2,)), "plan_ms: .*at least 2"),
        (lambda: LinkSettings(command_latency_s=0.2), "command_latency_s: .*not above 0.1"),
    ],
)
def test_what_no_hardware_has_is_refused(make, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words):
        make()


SHORT = ["duration_s=0.12", "mpc.enabled=false", "log.rate_hz=1000"]


def log(*changes: str):  # type: ignore[no-untyped-def]
    return prepare(load_config("solo12_stand", [*SHORT, *changes])).run(lambda progress: None).log


def test_what_is_drawn_is_drawn_from_the_seed() -> None:
    changes = (
        "plant.link={command_jitter_s: 0.002, measurement_jitter_s: 0.002, dropped_commands: 0.1,"
        " joint_velocity_noise_rad_s: 0.05}",
        "timing={computing: modelled, tick_ms: [0.1, 2.5]}",
    )
    first, again, other = log(*changes), log(*changes), log(*changes, "seed=1")
    assert np.array_equal(first.time, again.time) and np.array_equal(first.q, again.q)
    assert first.q.shape != other.q.shape or not np.array_equal(first.q, other.q)


def test_a_late_command_acts_late_and_a_weak_drive_is_weak() -> None:
    plain, late = (
        log("plant.initial_velocity_m_s=[0.2, 0, 0]"),
        log("plant.initial_velocity_m_s=[0.2, 0, 0]", "plant.link.command_latency_s=0.005"),
    )
    assert plain.v[0, 0] == 0.2
    assert np.allclose(plain.v[:, :3][0], [0.2, 0.0, 0.0])
    # tau is that of the step before: the first command acts at once, the second five steps after its tick.
    assert np.array_equal(late.tau[1:6], np.repeat(plain.tau[1:2], 5, axis=0))
    assert not np.array_equal(late.tau[7], late.tau[6])
    weak = log("plant.actuators.torque_limit_nm=0.4")
    assert np.abs(weak.tau).max() == 0.4
    assert np.all(weak.effort_limit == 0.4)


def test_ticks_during_a_long_computation_are_missed_and_the_robot_stands() -> None:
    found = log("timing={computing: modelled, tick_ms: [2.3, 2.4]}")
    assert np.diff(found.time) == pytest.approx(np.full(len(found.time) - 1, 0.003))
    assert found.q[:, 2].min() > 0.95 * found.q[0, 2]
