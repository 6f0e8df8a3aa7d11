"""From sections ``estimator`` and ``sensors`` of a config to an estimator and the sensors that it reads."""

from __future__ import annotations

import numpy as np

from lgmpc.config.schema import Config, GroundTruth
from lgmpc.config.session import Notify
from lgmpc.estimation import LeggedEstimator
from lgmpc.robot import Robot
from lgmpc.simulation.sensors import Sensors

__all__ = ["build_estimator", "build_sensors"]


def build_sensors(config: Config, robot: Robot) -> Sensors:
    """Return the simulated sensors of section ``sensors``, their noise seeded by ``seed``."""
    return Sensors(robot, config.sensors, 1.0 / config.wbc.rate_hz, np.random.default_rng(config.seed))


def build_estimator(config: Config, robot: Robot, notify: Notify = lambda message: None) -> LeggedEstimator | None:
    """Return the estimator of section ``estimator``; None where the controllers receive the simulator's state."""
    if isinstance(config.estimator, GroundTruth):
        return None
    return LeggedEstimator(robot, 1.0 / config.wbc.rate_hz, config.estimator, progress=notify)
