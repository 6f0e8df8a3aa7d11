from __future__ import annotations

import numpy as np
import pytest
from samples import standing_quadruped

from lgmpc.ocp import ShootingProblem


@pytest.fixture
def problem() -> ShootingProblem:
    """A standing quadruped with a short horizon and one foot that lifts in the middle of it."""
    problem = standing_quadruped(5, 4)
    problem.set("u_reference", np.tile([0.0, 0.0, 6.0], 4))
    problem.view("contact_flags")[2:4, 1] = 0.0
    problem.set_initial_state([0.01, 0.0, 0.23, 0.5, -0.2, 0.0, 0.01, 0.0, 0.02])
    return problem
