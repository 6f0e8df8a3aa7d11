"""The whole-body QP under a displacement of robot, ground and gravity: the same torques, displaced forces."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Robot
from lgmpc.status import Status
from lgmpc.wbc import WholeBodyController, WholeBodySettings
from tests.support.displaced import Displacement

# No facet is active: their places around the normal are not displaced.
GRIP = WholeBodySettings(friction=3.0, tolerance=1e-10)
ROWS = ("com", "base_orientation", "posture", "angular_momentum", "swing")


def solved(robot: Robot, q: np.ndarray, v: np.ndarray, move: Displacement) -> WholeBodyController:
    """Torques of a robot on three feet, with targets beside the sensed state, all displaced."""
    wbc = WholeBodyController(robot, GRIP)
    wbc.contacts.normals[...] = move.vectors(np.array([0.0, 0.0, 1.0]))
    wbc.contacts.stance[1] = False
    wbc.sense(q, v)
    wbc.stand()
    target = {name: wbc.tasks[name].target for name in ROWS}
    target["com"].position[:] = wbc.terms.com + move.vectors(np.array([0.01, -0.02, 0.005]))
    target["com"].acceleration[:] = move.vectors(np.array([0.3, 0.2, 0.5]))
    target["base_orientation"].rotation[:] = move.rotation @ np.eye(3)
    target["posture"].position[:] = q[7:] + 0.05
    target["angular_momentum"].rate[:] = move.vectors(np.array([0.02, -0.01, 0.03]))
    target["swing"].position[:] = wbc.terms.contact_points + move.vectors(np.array([0.0, 0.01, 0.02]))
    wbc.contacts.target_forces[:] = move.vectors(np.array([0.5, -0.3, 8.0]))
    wbc.external_wrench[:] = move.vectors(np.array([1.0, 0.5, -0.2, 0.01, 0.02, 0.0]))
    assert wbc.solve() is Status.CONVERGED
    return wbc


@pytest.mark.usefixtures("interpreted")
def test_torques_do_not_depend_on_where_down_is(solo12: Robot, displacement: Displacement) -> None:
    rng = np.random.default_rng(5)
    q = pin.integrate(solo12.model, solo12.q_reference, rng.normal(0.0, 0.03, solo12.nv))
    v = rng.normal(0.0, 0.05, solo12.nv)
    level = Displacement.of((0.0, 0.0, 0.0))
    here = solved(solo12, q, v, level)
    there = solved(displacement.robot(solo12), displacement.poses(q), v, displacement)
    np.testing.assert_allclose(there.terms.contact_points, displacement.points(here.terms.contact_points), atol=1e-12)
    np.testing.assert_allclose(there.tau, here.tau, atol=1e-8)
    np.testing.assert_allclose(there.forces, displacement.vectors(here.forces), atol=1e-7)
    assert here.forces[[0, 2, 3], 2].min() > 1.0 and np.abs(here.forces[1]).max() < 1e-9
