"""Construction from sections ``sensors`` and ``estimator``, and refused settings."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.config.build import build_estimator, build_sensors
from lgmpc.config.loading import load_config
from lgmpc.config.robots import build_robot
from lgmpc.config.schema import GroundTruth
from lgmpc.errors import ConfigError
from lgmpc.simulation.plant import PlantSample

from .conftest import ROOT

PLAIN = ROOT / "configs" / "solo12_balance.yaml"
CONFIG = ROOT / "configs" / "solo12_balance_inekf.yaml"


def test_by_default_the_state_is_the_simulators() -> None:
    config = load_config(PLAIN)
    assert config.estimator == GroundTruth()
    assert build_estimator(config, build_robot(config)) is None


@pytest.mark.usefixtures("interpreted")
def test_the_contact_forces_scale_with_the_mass() -> None:
    config = load_config(PLAIN, ["estimator.kind=inekf"])
    robot = build_robot(config)
    estimator = build_estimator(config, robot)
    assert estimator is not None
    thresholds = (estimator._detector._release, estimator._detector._touch)
    assert thresholds == pytest.approx((0.12 * robot.mass, 0.8 * robot.mass))


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
def test_invalid_settings_are_refused_by_key(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(CONFIG, [override])
