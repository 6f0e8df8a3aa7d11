from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos.outcome import Outcome
from lgmpc.demos.snake import run


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run()


def test_every_prediction_is_met(outcome: Outcome) -> None:
    assert [row.quantity for row in outcome.rows if not row.agrees] == []


def test_the_scene_hangs_together_and_turns(outcome: Outcome) -> None:
    first, middle, last = outcome.bodies
    assert outcome.times is not None and len(outcome.times) == len(middle.positions)
    for before, after, half in ((first, middle, (0.25, 0.3)), (middle, last, (0.3, 0.25))):
        ends = before.positions + half[0] * before.rotations[:, :, 0]
        starts = after.positions - half[1] * after.rotations[:, :, 0]
        np.testing.assert_allclose(ends, starts, atol=1e-12)
    turn = np.degrees(np.arctan2(middle.rotations[-1, 1, 0], middle.rotations[-1, 0, 0]))
    assert abs(turn) > 20.0
    reported = next(row.measured for row in outcome.rows if row.quantity.startswith("turn after"))
    assert turn == pytest.approx(reported, abs=1e-9)
