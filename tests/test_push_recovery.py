"""The benchmark of pushes: what it asks of the loop, and how it judges where the feet are."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import push_recovery
import pytest

from lgmpc import load_config
from lgmpc.config.schema import Config
from lgmpc.robot import load_robot


@pytest.mark.parametrize(("warm_up", "stands"), [(0.0, 0.0), (3.0, 4.0)])
def test_feet_are_judged_from_where_the_robot_stands_after_the_warm_up(
    monkeypatch: pytest.MonkeyPatch, warm_up: float, stands: float
) -> None:
    """The way of the warm-up does not count, what the feet move by afterwards does, and no height."""
    asked: list[Config] = []

    def prepare(config: Config, slip: float) -> Any:
        asked.append(config)
        time = np.arange(0.0, config.duration_s, 0.01)
        points = np.zeros((len(time), 4, 3))
        points[:, 2, 0] = 0.9 * np.minimum(time, stands) + np.where(time > stands + 1.0, slip, 0.0)
        points[:, 1, 2] = 0.5 * time
        log = SimpleNamespace(time=time, contact_points=points)
        return SimpleNamespace(run=lambda _: SimpleNamespace(log=log, metrics=SimpleNamespace(fell=False)))

    for slip, expected in ((0.019, True), (0.021, False)):
        monkeypatch.setattr(push_recovery, "prepare", partial(prepare, slip=slip))
        assert push_recovery.stays(push_recovery.CONFIGS / "solo12_balance.yaml", [], warm_up, 0.0, 3.0) is expected
    config = asked[0]
    assert config.pushes[0].time_s == stands + push_recovery.START_S
    assert config.duration_s == stands + push_recovery.DURATION_S
    assert [command.at_s for command in config.commands] == ([0.0, warm_up] if warm_up else [])


def test_a_pendulum_pushed_by_its_bound_ends_at_the_edge_of_its_soles() -> None:
    config = load_config("g1_stand")
    robot = load_robot(config.robot)
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    com = pin.centerOfMass(robot.model, data, robot.q_reference)
    points = np.array([data.oMf[i].translation for i in robot.contact_ids]) - com
    base = data.oMi[1].act(robot.model.inertias[1].lever)[2]
    edges = points[:, 0].max(), -points[:, 0].min()  # ahead and behind
    for edge, impulse in zip(edges, push_recovery.pendulum_bound(robot, "pelvis", np.array([0.0, np.pi])), strict=True):
        step, at, velocity = 1e-5, 0.0, 0.0
        for _ in range(round(0.2 / step)):
            force = impulse / 0.2
            pressure = edge - force * (base - com[2]) / (robot.mass * 9.81)  # so that nothing turns
            velocity += step * (9.81 / com[2] * (at - pressure) + force / robot.mass)
            at += step * velocity
        assert at + velocity / np.sqrt(9.81 / com[2]) == pytest.approx(edge, rel=1e-3)
