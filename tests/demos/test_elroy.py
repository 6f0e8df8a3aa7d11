from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos.elroy import run
from lgmpc.demos.outcome import Outcome


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run()


def test_every_prediction_is_met(outcome: Outcome) -> None:
    assert [row.quantity for row in outcome.rows if not row.agrees] == []


def test_the_scene_turns_both_ways(outcome: Outcome) -> None:
    boy, blade = outcome.bodies
    assert outcome.times is not None and len(outcome.times) == len(boy.positions)
    angles = [np.unwrap(np.arctan2(body.rotations[:, 1, 0], body.rotations[:, 0, 0]))[-1] for body in (boy, blade)]
    assert angles[0] == pytest.approx(-2 * np.pi * 0.25 / 1.05, abs=1e-8)
    assert angles[1] - angles[0] == pytest.approx(2 * np.pi, abs=1e-8)
