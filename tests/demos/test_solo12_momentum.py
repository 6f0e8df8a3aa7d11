"""Solo12 in the air: every prediction is met, and an external force left out is detected."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos import solo12_momentum


@pytest.fixture(autouse=True)
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")


def test_momentum_is_as_predicted() -> None:
    outcome = solo12_momentum.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    pulled = [row.measured for row in outcome.rows if row.quantity.startswith("angular momentum at the end")]
    assert np.linalg.norm(pulled) > 0.01, "the pull should turn the robot"
    roll = outcome.panels[2].curves[0].y
    assert np.ptp(roll) > 1.0, "the trunk should turn although momentum is conserved"


def test_a_force_that_is_not_accounted_for_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    fly = solo12_momentum._fly

    def with_a_secret_pull(robot):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(solo12_momentum, "_FORCE", solo12_momentum._FORCE + [0.0, 0.0, 1e-3])
            return fly(robot)

    monkeypatch.setattr(solo12_momentum, "_fly", with_a_secret_pull)
    assert not solo12_momentum.run().agrees
