"""Geometric control: every prediction is met, and a wrong gain in the prediction is detected."""

from __future__ import annotations

import dataclasses

import pytest

from lgmpc.demos import lee


@pytest.mark.slow
def test_every_prediction_is_met() -> None:
    outcome = lee.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    assert len(outcome.bodies) == 2 and len(outcome.times) == len(outcome.bodies[0].positions)


def test_a_prediction_from_another_gain_is_not_met(monkeypatch: pytest.MonkeyPatch) -> None:
    flights = lee._turning()
    assert lee._growth(*flights[:2]).agrees
    assert all(row.agrees for row in lee._lyapunov(*flights))
    monkeypatch.setattr(lee, "_GAINS", dataclasses.replace(lee._GAINS, rotation=1.02 * lee._GAINS.rotation))
    assert not lee._growth(*flights[:2]).agrees
