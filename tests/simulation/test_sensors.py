"""Sensors: exact increments without noise, the statistics of noise, and repeatability."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from lgmpc.control.interface import Command, Measurement, RobotState
from lgmpc.errors import InputError
from lgmpc.estimation.inertial import exponential_increment, propagate
from lgmpc.lie import quaternion
from lgmpc.simulation.disturbances import PushSchedule
from lgmpc.simulation.loop import Loop, Sensing, Tick
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.plant import PlantSample
from lgmpc.simulation.sensors import SensorNoise, Sensors
from lgmpc.timegrid import TimeGrid

SILENT = SensorNoise(**dict.fromkeys(SensorNoise.model_fields, 0.0))
GRAVITY = np.array([0.0, 0.0, -9.81])


def at_rest(robot) -> PlantSample:
    x = robot.x_reference
    return PlantSample(0.0, x[: robot.nq], x[robot.nq :], np.zeros(robot.nu), np.zeros((robot.nc, 3)))


@pytest.mark.parametrize("substeps", [1, 5])
def test_without_noise_the_imu_leads_from_state_to_state(plant_type, solo12, random_state, substeps: int) -> None:
    """Dropped, tumbling, with legs flailing: mean body rates reproduce attitude and velocity, contacts or not."""
    plant = plant_type(solo12)
    q, v = random_state(solo12, np.random.default_rng(3))
    q[2] = 0.25  # it hits the floor at once
    plant.reset(np.concatenate([q, v]))
    period = substeps * plant.dt
    sensors = Sensors(solo12, SILENT, period, np.random.default_rng(0))
    sample = plant.sense()
    sensors.read(sample)
    pose = np.eye(5)
    pose[:3, :3] = quaternion.to_matrix(sample.q[3:7])
    pose[:3, 3] = pose[:3, :3] @ sample.v[:3]
    for _ in range(40):
        for _ in range(substeps):
            plant.step(np.full(12, 0.3))
        sample = plant.sense()
        reading = sensors.read(sample)
        pose = propagate(pose, exponential_increment(reading.gyro, reading.accelerometer, period), GRAVITY, period)
        rotation = quaternion.to_matrix(sample.q[3:7])
        np.testing.assert_allclose(pose[:3, :3], rotation, atol=1e-11)
        np.testing.assert_allclose(pose[:3, 3], rotation @ sample.v[:3], atol=1e-10)
        np.testing.assert_array_equal(reading.joints, sample.q[7:])
        np.testing.assert_array_equal(reading.speeds, sample.v[6:])
        np.testing.assert_array_equal(reading.torques, sample.tau)


def test_the_imu_agrees_with_mujocos_accelerometer(solo12, random_state) -> None:
    """At the first order of the step: MuJoCo reports the acceleration at its start, the IMU the mean over it."""
    plant, differences = MujocoPlant(solo12, PlantSettings(rate_hz=1e4)), []
    for seed in range(5):
        plant.reset(np.concatenate(random_state(solo12, np.random.default_rng(seed))))
        sensors = Sensors(solo12, SILENT, plant.dt, np.random.default_rng(0))
        sensors.read(plant.sense())
        plant.step(np.linspace(-1.8, 1.8, 12))
        reading = sensors.read(plant.sense())
        theirs = np.zeros(6)  # angular, linear, gravity felt, at the state before the step
        mujoco.mj_rnePostConstraint(plant.model, plant.data)
        mujoco.mj_objectAcceleration(plant.model, plant.data, mujoco.mjtObj.mjOBJ_XBODY, 1, theirs, 1)
        assert np.linalg.norm(theirs[3:]) > 5.0
        differences.append(reading.accelerometer - theirs[3:])
    assert np.abs(differences).max() < 0.05


def test_at_rest_the_accelerometer_feels_the_floor_not_gravity(solo12) -> None:
    sensors = Sensors(solo12, SILENT, 1e-3, np.random.default_rng(0))
    for _ in range(2):
        reading = sensors.read(at_rest(solo12))
        np.testing.assert_allclose(reading.accelerometer, -GRAVITY, atol=1e-12)
        np.testing.assert_allclose(reading.gyro, 0.0, atol=1e-12)


def test_noise_has_the_given_densities(solo12) -> None:
    noise = SensorNoise(
        gyro_noise_rad_s_rt_hz=1e-3,
        accelerometer_noise_m_s2_rt_hz=2e-2,
        gyro_bias_rad_s=0.0,
        accelerometer_bias_m_s2=0.0,
        encoder_step_rad=0.0,
    )
    noise = SensorNoise(
        **{**vars(noise), "gyro_bias_walk_rad_s2_rt_hz": 0.0, "accelerometer_bias_walk_m_s3_rt_hz": 0.0}
    )
    sensors, sample, n = Sensors(solo12, noise, 0.01, np.random.default_rng(0)), at_rest(solo12), 4000
    readings = [sensors.read(sample) for _ in range(n)]

    def spread(name: str, centre: np.ndarray) -> float:
        return float(np.std(np.array([getattr(r, name) for r in readings]) - centre))

    assert spread("gyro", np.zeros(3)) == pytest.approx(1e-3 / np.sqrt(0.01), rel=0.03)
    assert spread("accelerometer", -GRAVITY) == pytest.approx(2e-2 / np.sqrt(0.01), rel=0.03)
    assert spread("joints", sample.q[7:]) == pytest.approx(noise.encoder_noise_rad, rel=0.02)
    assert spread("speeds", sample.v[6:]) == pytest.approx(noise.joint_velocity_noise_rad_s, rel=0.02)
    assert spread("torques", sample.tau) == pytest.approx(noise.torque_noise_nm, rel=0.02)


def test_biases_begin_and_walk_as_given(solo12) -> None:
    noise = SensorNoise(
        gyro_bias_rad_s=0.01,
        accelerometer_bias_m_s2=0.5,
        gyro_bias_walk_rad_s2_rt_hz=0.02,
        accelerometer_bias_walk_m_s3_rt_hz=0.3,
    )
    starts, walked = [], []
    for seed in range(300):
        sensors = Sensors(solo12, noise, 0.5, np.random.default_rng(seed))
        first = np.concatenate([sensors.gyro_bias, sensors.accelerometer_bias])
        for _ in range(4):
            sensors.read(at_rest(solo12))
        starts.append(first)
        walked.append(np.concatenate([sensors.gyro_bias, sensors.accelerometer_bias]) - first)
    for found, expected in ((starts, (0.01, 0.5)), (walked, (0.02 * np.sqrt(2.0), 0.3 * np.sqrt(2.0)))):
        spread = np.std(np.array(found).reshape(-1, 2, 3), axis=(0, 2))
        np.testing.assert_allclose(spread, expected, rtol=0.1)


def test_encoders_count_steps(solo12) -> None:
    noise = SensorNoise(encoder_noise_rad=0.0, encoder_step_rad=0.03)
    joints = Sensors(solo12, noise, 1e-3, np.random.default_rng(0)).read(at_rest(solo12)).joints
    np.testing.assert_allclose(joints / 0.03, np.round(joints / 0.03), atol=1e-9)
    assert 0.0 < np.abs(joints - solo12.q_reference[7:]).max() <= 0.015


def test_one_seed_gives_one_sequence_of_bits(solo12) -> None:
    first, second, other = (
        [Sensors(solo12, SensorNoise(), 1e-3, np.random.default_rng(seed)).read(at_rest(solo12)).gyro]
        for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_the_controller_receives_the_estimate_and_not_the_true_state(plant_type, solo12) -> None:
    received, rates_estimate = [], np.full(solo12.nv, 0.25)

    class WrongEstimator:
        def update(self, measurement: Measurement) -> RobotState:
            return RobotState(
                measurement.time, np.concatenate([np.zeros(6), [1.0], measurement.joints]), rates_estimate
            )

    class Damping:
        def update(self, state: RobotState) -> Command:
            received.append(state)
            return Command.damping(np.zeros(12), state.q[7:], 0.1)

    plant, ticks = plant_type(solo12), []
    plant.reset(solo12.x_reference)

    def on_tick(tick: Tick) -> bool:
        ticks.append(tick)
        return True

    sensors = Sensors(solo12, SILENT, plant.dt, np.random.default_rng(0))
    pushes, grid = PushSchedule([], plant.dt, plant.bodies), TimeGrid(plant.dt, 3)
    Loop(plant, Damping(), pushes, grid, Sensing(sensors, WrongEstimator())).run(on_tick)
    for state, tick in zip(received, ticks, strict=True):
        assert tick.state is state and state.v is rates_estimate
        assert state.time == tick.sample.time
        assert state.q[2] == 0.0 < tick.sample.q[2]
        np.testing.assert_array_equal(state.q[7:], tick.sample.q[7:])


def test_impossible_sensors_are_refused(solo12, zoo) -> None:
    with pytest.raises(InputError, match="^gyro_noise_rad_s_rt_hz: got -1"):
        SensorNoise(gyro_noise_rad_s_rt_hz=-1.0)
    with pytest.raises(InputError, match="^period: got 0"):
        Sensors(solo12, SILENT, 0.0, np.random.default_rng(0))
    with pytest.raises(InputError, match="^robot: got zoo"):
        Sensors(zoo, SILENT, 1e-3, np.random.default_rng(0))
