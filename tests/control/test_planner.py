"""The predictive layer: limits of its disturbance observer."""

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_balance.yaml"


def test_the_observed_push_is_at_most_three_times_the_robot_s_weight() -> None:
    config = load_config(CONFIG)
    robot = build_robot(config)
    planner = build_controller(config, robot).planner
    assert planner is not None
    weight = 9.81 * robot.mass
    planner.observer.update(np.zeros(6))
    for size, expected in ((0.5 * weight, 0.5 * weight), (100.0 * weight, 3.0 * weight)):
        planner.observer.reset()
        for tick in range(1, 2000):  # the momentum grows as under a constant force, which no controller commanded
            planner.observer.expect(planner.observer.wrench.copy())
            planner.observer.update(np.array([0.0, size, 0.0, 0.0, 0.0, 0.0]) * tick * 1e-3)
        assert np.linalg.norm(planner.observer.wrench[:3]) == pytest.approx(expected, rel=1e-6)
