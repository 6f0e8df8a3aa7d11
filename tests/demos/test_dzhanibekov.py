"""The T-handle flips as elliptic functions predict; a handle of another inertia does not."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.demos import dzhanibekov
from lgmpc.mechanics import EulerTop, Motion


def test_it_turns_over_when_predicted() -> None:
    outcome = dzhanibekov.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    flips = next(row for row in outcome.rows if row.quantity == "flips")
    assert flips.measured == 3
    stem = outcome.panels[1].curves[0].y
    assert stem.min() < -0.99 and stem.max() > 0.99, "the stem should point both ways"
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)


def test_another_inertia_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    simulate = dzhanibekov._simulate

    def heavier(top: EulerTop, end: float) -> Motion:
        return simulate(EulerTop(top.inertia + np.diag([1e-7, 0.0, 0.0]), top.velocity, top.rotation), end)

    monkeypatch.setattr(dzhanibekov, "_simulate", heavier)
    wrong = [row.quantity for row in dzhanibekov.run().rows if not row.agrees]
    assert {"flip 1 at", "time between flips", "rate at which a small tilt grows"} <= set(wrong)


def test_inertia_of_the_handle_is_that_of_its_cylinders() -> None:
    """By Monte Carlo integration over the two cylinders."""
    inertia, tip = dzhanibekov._handle()
    rng = np.random.default_rng(0)
    count = 200_000
    points, masses = [], []
    for (mass, radius, length), axis, center in (
        (dzhanibekov._BAR, 1, tip[0] - dzhanibekov._STEM[2]),
        (dzhanibekov._STEM, 0, tip[0] - dzhanibekov._STEM[2] / 2),
    ):
        angle, distance = rng.uniform(0, 2 * np.pi, count), radius * np.sqrt(rng.uniform(0, 1, count))
        cloud = np.empty((count, 3))
        cloud[:, axis] = length * rng.uniform(-0.5, 0.5, count)
        cloud[:, (axis + 1) % 3], cloud[:, (axis + 2) % 3] = distance * np.cos(angle), distance * np.sin(angle)
        cloud[:, 0] += center
        points.append(cloud)
        masses.append(np.full(count, mass / count))
    x, m = np.vstack(points), np.concatenate(masses)
    np.testing.assert_allclose(m @ x, 0.0, atol=1e-4)
    second = np.einsum("n,ni,nj->ij", m, x, x)
    np.testing.assert_allclose(inertia, np.trace(second) * np.eye(3) - second, atol=0.01 * inertia.max())
