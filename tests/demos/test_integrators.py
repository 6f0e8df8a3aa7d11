from __future__ import annotations

import dataclasses

import pytest

from lgmpc.demos.integrators import run
from lgmpc.demos.outcome import Outcome


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run()


def test_every_prediction_is_met(outcome: Outcome) -> None:
    assert [row.quantity for row in outcome.rows if not row.agrees] == []
    assert len(outcome.rows) >= 10


def test_the_table_detects_another_body(outcome: Outcome) -> None:
    """RK4's loss belongs to this body and step: a tenth more of it is no agreement."""
    loss = outcome.rows[0]
    assert not dataclasses.replace(loss, measured=1.1 * loss.measured).agrees


def test_the_curves_can_be_drawn_on_logarithmic_axes(outcome: Outcome) -> None:
    for panel in outcome.panels:
        for curve in panel.curves:
            assert len(curve.x) == len(curve.y) <= 400
            assert curve.x.min() > 0 and curve.y.min() > 0
