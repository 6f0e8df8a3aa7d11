"""Preintegration agrees with its predictions; another increment in its place does not."""

from __future__ import annotations

import pytest

from lgmpc.demos import preintegration
from lgmpc.estimation.inertial import ImuNoise, zero_order_hold_increment


@pytest.fixture(autouse=True)
def few_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preintegration, "RUNS", 100)


def test_predictions_are_met() -> None:
    outcome = preintegration.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)


def test_the_zero_order_hold_in_place_of_the_exact_form_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preintegration, "exponential_increment", zero_order_hold_increment)
    wrong = {row.quantity for row in preintegration.run().rows if not row.agrees}
    assert "exact form less DOP853" in wrong


def test_noise_beyond_what_is_assumed_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    class Overconfident(preintegration.Preintegration):
        def __init__(self, noise, *arguments) -> None:
            super().__init__(
                ImuNoise(
                    gyro_noise_rad_s_rt_hz=0.5 * noise.gyro_noise_rad_s_rt_hz,
                    accelerometer_noise_m_s2_rt_hz=0.5 * noise.accelerometer_noise_m_s2_rt_hz,
                ),
                *arguments,
            )

    monkeypatch.setattr(preintegration, "Preintegration", Overconfident)
    wrong = {row.quantity for row in preintegration.run().rows if not row.agrees}
    assert wrong == {"noise: NEES / freedom", "noise: deviation of height"}
