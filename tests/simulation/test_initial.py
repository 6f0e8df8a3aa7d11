"""The state that a simulated robot begins in."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.robot.lying import lowest_point, lying_posture
from lgmpc.robot.posture import contact_heights
from lgmpc.simulation.initial import initial_state
from lgmpc.simulation.parameters import PlantSettings


def test_without_a_posture_it_is_the_reference(solo12) -> None:
    np.testing.assert_array_equal(initial_state(solo12, PlantSettings()), solo12.x_reference)


def test_a_lying_robot_lies(solo12) -> None:
    state = initial_state(solo12, PlantSettings(initial_posture="lying"))
    np.testing.assert_array_equal(state[: solo12.nq], lying_posture(solo12))
    np.testing.assert_array_equal(state[solo12.nq :], 0.0)


def test_named_joints_are_displaced_and_the_lowest_point_is_on_the_floor(solo12) -> None:
    state = initial_state(solo12, PlantSettings(initial_posture={"FL_HFE": 1.2, "FL_KFE": -2.2}))
    q = state[: solo12.nq]
    changed = np.flatnonzero(q[7:] != solo12.q_reference[7:])
    np.testing.assert_array_equal(changed, [1, 2])
    np.testing.assert_array_equal(q[[8, 9]], [1.2, -2.2])
    heights = contact_heights(solo12.model, q, solo12.contact_ids, solo12.contact_radius)
    assert heights.min() == pytest.approx(0.0, abs=1e-9) and heights[0] > 0.02
    assert lowest_point(solo12, q) > 0.0


def test_a_posture_on_the_knees_has_the_knees_on_the_floor(solo12) -> None:
    state = initial_state(solo12, PlantSettings(initial_posture={"F?_HFE": 1.4, "H?_HFE": -1.4, "*_KFE": 0.0}))
    assert lowest_point(solo12, state[: solo12.nq]) >= -1e-9


def test_an_unknown_joint_is_named_with_the_nearest(solo12) -> None:
    with pytest.raises(InputError, match=r"plant.initial_posture: got FL_HFF; .* Did you mean FL_HFE"):
        initial_state(solo12, PlantSettings(initial_posture={"FL_HFF": 1.0}))
