"""The filter's errors agree with its covariance; a filter that assumes too little noise fails the test."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos import inekf


@pytest.mark.slow
def test_it_is_log_linear_consistent_and_converges() -> None:
    outcome = inekf.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)
    tilts = next(panel for panel in outcome.panels if panel.title.startswith("Tilt")).curves
    invariant, quaternion = tilts[0].y, tilts[2].y
    assert (tilts[0].label, tilts[2].label) == ("right-invariant, median", "quaternion, median")
    assert invariant[0] == quaternion[0] == pytest.approx(45.0)
    assert invariant[100] < 1.0 < 5.0 < quaternion[100]  # 0.5 s on


def test_noise_beyond_what_the_filter_assumes_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")  # short runs: less than compiling takes
    monkeypatch.setattr(inekf, "RUNS", 4)
    monkeypatch.setattr(inekf, "DURATION", 0.6)
    simulate = inekf.simulate_trot

    def noisy(rng: np.random.Generator, noise, **keywords):
        return simulate(rng, noise.replace({"gyro_noise_rad_s_rt_hz": 10.0 * noise.gyro_noise_rad_s_rt_hz}), **keywords)

    monkeypatch.setattr(inekf, "simulate_trot", noisy)
    wrong = {row.quantity for row in inekf.run().rows if not row.agrees}
    assert "right form: NEES / freedom" in wrong
