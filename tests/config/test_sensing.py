"""Sections ``sensors`` and ``estimator``: what they build, and that their defaults are the library's."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.config.loading import load_config
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import GroundTruth, InvariantEkfSection
from lgmpc.config.sensing import build_estimator, build_sensors
from lgmpc.errors import ConfigError
from lgmpc.estimation import LeggedEstimatorSettings
from lgmpc.simulation.plant import PlantSample
from lgmpc.simulation.sensors import SensorNoise

from .conftest import ROOT

PLAIN = ROOT / "configs" / "solo12_balance.yaml"
CONFIG = ROOT / "configs" / "solo12_balance_inekf.yaml"


def test_by_default_the_simulator_tells() -> None:
    config = load_config(PLAIN)
    assert config.estimator == GroundTruth()
    assert build_estimator(config, build_robot(config)) is None


def test_the_defaults_are_those_of_the_library() -> None:
    config = load_config(PLAIN, ["estimator.kind=inekf"])
    robot = build_robot(config)
    sensors, estimator = build_sensors(config, robot), build_estimator(config, robot)
    assert sensors.noise == SensorNoise()
    assert estimator is not None
    built, usual = vars(estimator.settings), vars(LeggedEstimatorSettings())
    forces = ("touch_force", "release_force")
    assert {k: v for k, v in built.items() if k not in forces} == {k: v for k, v in usual.items() if k not in forces}
    assert (built["release_force"], built["touch_force"]) == pytest.approx((0.12 * robot.mass, 0.4 * robot.mass))


def test_every_key_arrives() -> None:
    keys = [key for key in InvariantEkfSection.model_fields if key not in ("kind", "form", "contact_force_n")]
    numbers = {key: 0.001 * (i + 1) for i, key in enumerate(keys)}
    changes = ["estimator.kind=inekf", "estimator.form=left", "estimator.contact_force_n=[0.5, 2.5]"]
    config = load_config(PLAIN, [*changes, *(f"estimator.{k}={v}" for k, v in numbers.items())])
    estimator = build_estimator(config, build_robot(config))
    assert estimator is not None
    settings = estimator.settings
    assert (settings.form, settings.release_force, settings.touch_force) == ("left", 0.5, 2.5)
    told = {*vars(settings.imu).values(), *(v for v in vars(settings).values() if isinstance(v, float))}
    assert set(numbers.values()) <= told


def test_the_seed_is_that_of_the_sensors() -> None:
    def reading(*overrides: str) -> np.ndarray:
        config = load_config(CONFIG, overrides)
        robot = build_robot(config)
        x = robot.x_reference
        sample = PlantSample(0.0, x[: robot.nq], x[robot.nq :], np.zeros(robot.nu), np.zeros((robot.nc, 3)))
        return build_sensors(config, robot).read(sample).accelerometer

    np.testing.assert_array_equal(reading(), reading())
    assert not np.array_equal(reading(), reading("seed=1"))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("estimator.kind=ekf", "expected one of ground_truth, inekf"),
        ("estimator.form=rigth", "Did you mean right"),
        ("estimator.contact_force_n=[2.0, 1.0]", "lowest below highest"),
        ("estimator.foot_noise_m=0.0", "greater than 0"),
        ("sensors.gyro_bias_rad_s=-1.0", "not below 0"),
        ("sensors.gyro_bias=0.1", "Did you mean"),
    ],
)
def test_what_cannot_be_is_refused_by_key(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(CONFIG, [override])
