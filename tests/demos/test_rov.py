from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos.outcome import Outcome
from lgmpc.demos.rov import run


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run()


def test_every_prediction_is_met(outcome: Outcome) -> None:
    assert [row.quantity for row in outcome.rows if not row.agrees] == []


def test_the_torpedo_turns_broadside_on_and_the_robot_rises(outcome: Outcome) -> None:
    robot, torpedo = outcome.bodies
    assert outcome.times is not None and len(outcome.times) == len(robot.positions) == len(torpedo.positions)
    assert torpedo.rotations[:, 0, 0].min() < 0.1
    assert robot.positions[-1, 2] > 0.3
    assert np.all(np.diff(robot.positions[:, 2]) >= 0.0)
