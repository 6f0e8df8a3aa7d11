"""Spikes of single sensors in closed loop, and what joints and a trunk can do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from lgmpc.config.build import build_robot, prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.interface import Measurement
from lgmpc.estimation import MeasurementMonitor
from lgmpc.estimation.plausibility import QUANTITIES
from lgmpc.robot import Robot
from lgmpc.runs import Metrics, RunLog
from lgmpc.runs.events import find_events
from lgmpc.runs.log import SENSOR_FAULTS
from lgmpc.simulation.plant import PlantSample

Spoil = Callable[[np.ndarray], Any]
ONE = np.arange(12) == 4
SPIKES: dict[str, tuple[str, Spoil]] = {
    "all speeds": ("speeds", lambda x: x + 30.0),
    "accelerometer ahead": ("accelerometer", lambda x: x + [160.0, 0.0, 0.0]),
    "accelerometer upward": ("accelerometer", lambda x: x + [0.0, 0.0, 160.0]),
    "accelerometer 1e9": ("accelerometer", lambda x: x + 1e9),
    "gyro": ("gyro", lambda x: x + [35.0, 0.0, 0.0]),
    "a speed of 1e200": ("speeds", lambda x: np.where(ONE, 1e200, x)),
    "an angle": ("joints", lambda x: x - 0.3 * ONE),
    "torques": ("torques", lambda x: 1e6 * x),
    "gyro not a number": ("gyro", lambda x: np.nan * x),
    "infinite speeds": ("speeds", lambda x: np.full_like(x, np.inf)),
}


def run(
    spikes: list[tuple[str, Spoil]], *overrides: str, config: str = "solo12_balance_inekf"
) -> tuple[Metrics, RunLog]:
    """Return metrics and log of 0.8 s, with spikes of the given quantities at 0.5 s for one tick."""
    common = ["duration_s=0.8", "gate={}", "pushes=[]", "log.rate_hz=250"]
    session = prepare(load_config(config, [*common, *overrides]))
    assert isinstance(session, ClosedLoopSession) and session.sensing is not None
    sensors = session.sensing.sensors  # type: ignore[union-attr]
    read = sensors.read

    def spoiled(sample: PlantSample) -> Measurement:
        m = read(sample)
        for name, spoil in spikes if abs(sample.time - 0.5) < 1e-9 else []:
            m = m._replace(**{name: spoil(getattr(m, name))})
        return m

    sensors.read = spoiled  # type: ignore[method-assign]
    result = session.run(lambda progress: None)
    assert result.metrics is not None
    return result.metrics, result.log


@pytest.mark.parametrize("name", SPIKES)
def test_a_spike_of_one_tick_is_replaced_counted_and_named(name: str, caplog: pytest.LogCaptureFixture) -> None:
    quantity, spoil = SPIKES[name]
    metrics, log = run([(quantity, spoil)])
    assert not metrics.fell and metrics.max_tilt_deg < 0.2
    assert metrics.estimator is not None and metrics.estimator.max_position_m < 5e-4
    assert metrics.sensor_faults is not None
    assert asdict(metrics.sensor_faults) == {each: int(each == quantity) for each in QUANTITIES}
    words = [each.message for each in caplog.records if "cannot be true" in each.message]
    assert words == [f"a reading of {quantity} at 0.500 s cannot be true: it is replaced"]
    assert log.sensor_faults is not None and np.count_nonzero(log.sensor_faults) == 1  # also in the kept ticks
    (event,) = [each for each in find_events(log, ()) if each.name == "sensors"]
    assert event.words == f"readings of {quantity} that cannot be true, replaced in 1 ticks"


@pytest.mark.parametrize("name", ["all speeds", "accelerometer ahead", "gyro"])
def test_without_the_monitor_a_spike_tilts_the_robot_or_the_estimate(name: str) -> None:
    metrics, log = run([SPIKES[name]], "estimator.replace_implausible=false")
    assert metrics.sensor_faults is None and log.sensor_faults is None and metrics.estimator is not None
    off = metrics.estimator
    assert metrics.max_tilt_deg > 10.0 or off.max_position_m > 0.03 or off.max_tilt_deg > 1.5


def test_a_fault_of_the_whole_imu_is_replaced() -> None:
    metrics, _ = run([SPIKES["gyro"], SPIKES["accelerometer upward"]])
    assert metrics.sensor_faults is not None and not metrics.fell and metrics.max_tilt_deg < 0.2
    assert (metrics.sensor_faults.gyro, metrics.sensor_faults.accelerometer) == (1, 1)


def test_spikes_of_a_walking_robot() -> None:
    trot = "commands=[{at_s: 0.1, velocity_m_s: [0.3, 0.0, 0.0], gait: trot}]"
    metrics, _ = run([SPIKES["all speeds"], SPIKES["accelerometer ahead"]], trot, config="solo12_velocity_inekf")
    assert metrics.max_tilt_deg < 2.0 and metrics.estimator is not None and metrics.estimator.max_position_m < 0.005
    assert metrics.sensor_faults is not None
    assert (metrics.sensor_faults.speeds, metrics.sensor_faults.accelerometer) == (1, 1)


@pytest.mark.parametrize(
    ("config", "overrides"),
    [
        ("solo12_velocity_inekf", ("wbc.rate_hz=250", "mpc.rate_hz=125")),
        ("solo12_velocity_inekf", ("plant.link={measurement_latency_s: 0.002, measurement_jitter_s: 0.002}",)),
        ("solo12_fall", ("estimator.kind=inekf", "duration_s=1.5", "after_fall_s=null")),
        pytest.param("solo12_trot_push", ("estimator.kind=inekf", "duration_s=6.0"), marks=pytest.mark.slow),
        pytest.param("anymal_velocity", ("estimator.kind=inekf", "duration_s=3.0"), marks=pytest.mark.slow),
    ],
)
def test_nothing_is_replaced_where_all_is_true(config: str, overrides: tuple[str, ...]) -> None:
    """Steps, slow and jittering links, and a fall onto the trunk: the log is bit for bit that without the monitor."""
    own = (*overrides, "log.rate_hz=250")
    logs = []
    for monitored in ("true", "false"):
        changes = ["duration_s=1.2", "gate={}", *own, f"estimator.replace_implausible={monitored}"]
        logs.append(prepare(load_config(config, changes)).run(lambda progress: None).log.arrays())
    assert not logs[0].pop("sensor_faults").any()
    for name in logs[1].keys() - {"wbc_ms", "mpc_ms", "estimate_ms"}:
        np.testing.assert_array_equal(logs[0][name], logs[1][name], err_msg=name)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(load_config("solo12_stand"))


def reading(robot: Robot, tick: int, **changes: Any) -> Measurement:
    """Joints that move at 2 rad/s."""
    joints = robot.q_reference[7:] + 0.002 * tick
    still = Measurement(0.001 * tick, np.zeros(3), -robot.gravity, joints, np.full(12, 2.0), np.zeros(12))
    return still._replace(**changes)


def test_angles_and_speeds_replace_each_other(robot: Robot) -> None:
    monitor = MeasurementMonitor(robot, 0.001)
    monitor.check(reading(robot, 0))
    good = reading(robot, 1)
    assert monitor.check(good) is good
    speeds = monitor.check(reading(robot, 2, speeds=np.where(ONE, 40.0, 2.0)))
    np.testing.assert_allclose(speeds.speeds, 2.0, rtol=1e-9)
    angles = monitor.check(reading(robot, 3, joints=good.joints + 1.0))
    np.testing.assert_allclose(angles.joints, reading(robot, 3).joints, rtol=1e-12)
    both = monitor.check(reading(robot, 4, joints=good.joints + 1.0, speeds=np.full(12, -40.0)))
    np.testing.assert_allclose(both.joints, reading(robot, 4).joints, rtol=1e-12)
    np.testing.assert_array_equal(both.speeds, 2.0)
    assert monitor.counts == dict.fromkeys(QUANTITIES, 0) | {"joints": 2, "speeds": 2}


def test_a_blow_that_moves_the_joints_or_turns_the_base_is_believed(robot: Robot) -> None:
    """A change of velocity of 0.2 m/s within a tick."""
    blow = np.array([0.0, 0.0, 200.0])
    for evidence in ({"speeds": np.full(12, 2.6)}, {"gyro": np.array([0.0, 0.8, 0.0])}):
        monitor = MeasurementMonitor(robot, 0.001)
        monitor.check(reading(robot, 0))
        struck = reading(robot, 1, accelerometer=blow, **evidence)
        assert monitor.check(struck) is struck and not monitor.faults
    monitor = MeasurementMonitor(robot, 0.001)
    monitor.check(reading(robot, 0))
    np.testing.assert_array_equal(monitor.check(reading(robot, 1, accelerometer=blow)).accelerometer, -robot.gravity)
    assert monitor.faults == 1 << SENSOR_FAULTS.index("accelerometer") and SENSOR_FAULTS == QUANTITIES


def test_a_value_that_persists_is_believed_and_one_that_is_not_finite_left_to_the_estimator(robot: Robot) -> None:
    monitor = MeasurementMonitor(robot, 0.001)
    monitor.check(reading(robot, 0))
    turns = np.array([10.0, 0.0, 0.0])
    believed = [monitor.check(reading(robot, k, gyro=turns)).gyro[0] for k in range(1, 8)]
    assert believed == [0.0] * 5 + [10.0] * 2
    left = [monitor.check(reading(robot, k, gyro=turns, torques=np.full(12, np.nan))).torques[0] for k in range(8, 15)]
    assert left[:5] == [0.0] * 5 and np.isnan(left[5:]).all()
    again = reading(robot, 15, gyro=turns)
    assert monitor.check(again) is again


def test_spikes_that_recur_are_replaced_each_time(robot: Robot) -> None:
    monitor = MeasurementMonitor(robot, 0.001)
    for tick in range(40):
        spike = tick % 3 == 2
        checked = monitor.check(reading(robot, tick, gyro=np.array([35.0 if spike else 0.0, 0.0, 0.0])))
        assert not checked.gyro.any() and bool(monitor.faults) is spike
    assert monitor.counts["gyro"] == 13


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
def test_whatever_is_read_raises_nothing(robot: Robot, value: float) -> None:
    monitor = MeasurementMonitor(robot, 0.001)
    for name in QUANTITIES:
        for tick in range(20):
            full = np.full_like(getattr(reading(robot, 0), name), value)
            monitor.check(reading(robot, tick, **({name: full} if tick != 3 else {})))
        monitor.reset()
        assert not any(monitor.counts.values())
