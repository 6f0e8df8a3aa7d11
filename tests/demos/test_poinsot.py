"""The ellipsoid rolls on its plane; a motion that is not torque-free does not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from lgmpc.demos import poinsot
from lgmpc.mechanics import EulerTop, Motion, torque_free_body


def test_it_rolls_as_predicted() -> None:
    outcome = poinsot.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)
    path, plane = outcome.paths[0].points, outcome.bodies[1]
    assert np.ptp(path[:, 2]) < 1e-9, "the plane should be level"
    half_thickness = plane.shapes[0].size[2] / 2
    assert path[0, 2] == pytest.approx(plane.positions[0, 2] + half_thickness)
    assert plane.positions[0, 2] < 0.0, "the ellipsoid should lie on the plane"


def test_a_small_torque_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    def pushed(top: EulerTop, periods: int = 1, every: int = 1) -> Motion:
        system = torque_free_body(top.inertia, body_force=lambda s: ca.DM([1e-6, 0.0, 0.0]))
        step, steps = top.period / poinsot._STEPS, periods * poinsot._STEPS
        return system.simulate(top.rotation, top.velocity, step=step, steps=steps, every=every)

    monkeypatch.setattr(poinsot, "_simulate", pushed)
    wrong = {row.quantity for row in poinsot.run().rows if not row.agrees}
    assert {"highest point of contact from the centre", "polhode closes after a period"} <= wrong


def test_a_slipping_ellipsoid_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Attitudes slowly turned about the plane's normal keep the contact on the plane, but no longer roll."""
    simulate = poinsot._simulate

    def slipping(top: EulerTop, periods: int = 1, every: int = 1) -> Motion:
        motion = simulate(top, periods, every)
        angles = 1e-3 * motion.times
        turns = np.zeros((len(angles), 3, 3))
        turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
        turns[:, 1, 0], turns[:, 0, 1], turns[:, 2, 2] = np.sin(angles), -np.sin(angles), 1.0
        return Motion(motion.times, turns @ motion.poses, motion.velocities, motion.advected)

    monkeypatch.setattr(poinsot, "_simulate", slipping)
    wrong = {row.quantity for row in poinsot.run().rows if not row.agrees}
    assert wrong == {"path on the plane, as long as the one on the body", "turn about the momentum in a period"}
