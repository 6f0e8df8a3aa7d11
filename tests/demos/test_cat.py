from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos.cat import run
from lgmpc.demos.outcome import Outcome


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run()


def test_every_prediction_is_met(outcome: Outcome) -> None:
    assert [row.quantity for row in outcome.rows if not row.agrees] == []


def test_the_scene_shows_a_fall_from_back_to_feet(outcome: Outcome) -> None:
    front, rear = outcome.bodies
    assert outcome.times is not None and len(outcome.times) == len(front.positions) == len(rear.rotations)
    for body in (front, rear):
        np.testing.assert_allclose(body.rotations[0][:, 0], [0, 0, 1], atol=1e-12)  # feet up
        np.testing.assert_allclose(body.rotations[-1][:, 0], [0, 0, -1], atol=1e-12)  # feet down
        np.testing.assert_allclose(body.rotations[-1][:, 2], body.rotations[0][:, 2], atol=1e-12)  # same heading
    np.testing.assert_allclose(front.positions, -rear.positions, atol=1e-12)  # about the centre of mass
