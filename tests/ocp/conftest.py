from __future__ import annotations

import numpy as np
import pytest

from lgmpc.actions import CentroidalAction
from lgmpc.ocp import ShootingProblem


@pytest.fixture
def problem() -> ShootingProblem:
    """A standing quadruped with a short horizon and one foot that lifts in the middle of it."""
    problem = ShootingProblem(CentroidalAction(4, 4), 5)
    feet = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
    for name, value in {
        "mass": 2.5,
        "gravity": [0.0, 0.0, -9.81],
        "duration": 0.02,
        "contact_points": feet.ravel(),
        "contact_flags": 1.0,
        "friction": 0.6,
        "normal_force_min": 0.5,
        "normal_force_max": 25.0,
        "x_reference": [0, 0, 0.24, 0, 0, 0, 0, 0, 0],
        "u_reference": np.tile([0.0, 0.0, 6.0], 4),
        "x_weight": [1e3] * 3 + [10.0] * 3 + [1e3] * 3,
        "u_weight": 1e-3,
    }.items():
        problem.set(name, value)
    problem.view("contact_flags")[2:4, 1] = 0.0
    problem.set_initial_state([0.01, 0.0, 0.23, 0.5, -0.2, 0.0, 0.01, 0.0, 0.02])
    return problem
