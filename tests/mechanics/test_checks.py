"""Arguments of other types are named by one error."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import lgmpc.mechanics as mechanics
from lgmpc.errors import InputError

INERTIA, RATE = np.diag([1.0, 2.0, 2.5]), np.array([0.1, 0.2, 0.3])
TOP, SYSTEM = mechanics.LagrangeTop(2.0, 1.0, 1.0), mechanics.torque_free_body(INERTIA)


@pytest.mark.parametrize("bad", [None, "text", math.nan, np.zeros((2, 2)), [], {}], ids=lambda bad: type(bad).__name__)
@pytest.mark.parametrize(
    ("function", "name"),
    [
        (lambda bad: TOP.steady_precession(bad, 5.0), "tilt"),
        (lambda bad: TOP.steady_precession(0.4, bad), "spin"),
        (lambda bad: TOP.start(bad, 5.0), "tilt"),
        (TOP.sleeping_growth, "spin"),
        (TOP.fall, "spin"),
        (lambda bad: mechanics.spheroid_added_mass(bad, 0.2), "length"),
        (mechanics.free_body, "inertia"),
        (lambda bad: mechanics.body_momentum(bad, np.eye(3), RATE), "group"),
        (lambda bad: mechanics.spatial_momentum(bad, np.eye(3), RATE), "group"),
        (mechanics.conserved_dimension, "momenta"),
        (lambda bad: SYSTEM.simulate(np.eye(3), RATE, step=bad, steps=2), "step"),
        (lambda bad: SYSTEM.simulate(np.eye(3), RATE, step=0.1, steps=bad), "steps"),
    ],
)
def test_arguments_of_other_types_are_named(function: Callable[[object], object], name: str, bad: object) -> None:
    with pytest.raises(InputError, match=f"^{name}: got "):
        function(bad)
