"""The top moves as Lagrange's formulas predict; a top of slightly different weight does not."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos import heavy_top
from lgmpc.mechanics import UP, LagrangeTop, Motion


@pytest.fixture(autouse=True)
def few_points_on_the_curve(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce the figure's last panel, which takes most of the time and is not part of the table."""
    monkeypatch.setattr(heavy_top, "_bifurcation", lambda: ())


def test_precession_nutation_sleeping_and_falling_are_as_predicted() -> None:
    outcome = heavy_top.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)


def test_another_weight_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    heavier = LagrangeTop(heavy_top._TOP.transverse, heavy_top._TOP.axial, 1.00001 * heavy_top._TOP.weight)

    def simulate(rotation: np.ndarray, velocity: np.ndarray, end: float, step: float = heavy_top._STEP) -> Motion:
        steps = 10 * int(np.ceil(end / step / 10.0))
        return heavier.system.simulate(rotation, velocity, rotation.T @ UP, step=step, steps=steps, every=10)

    monkeypatch.setattr(heavy_top, "_simulate", simulate)
    wrong = {row.quantity for row in heavy_top.run().rows if not row.agrees}
    assert {"slow precession", "nutation: period", "tilt off its elliptic function"} <= wrong
