import math

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.simulation.parameters import (
    SOLO12_GEOMETRY,
    BodyGeometry,
    PlantParameters,
    body_geometry,
    simulated_model,
)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("friction", 0.0),
        ("friction", -0.1),
        ("friction", math.nan),
        ("friction", "0.6"),
        ("friction", True),
        ("timestep", 0.0),
        ("timestep", math.inf),
        ("mass_scale", 0.0),
        ("mass_scale", -1.0),
        ("base_added_mass", -0.5),
        ("joint_friction", -0.01),
        ("joint_damping", -0.01),
        ("joint_damping", math.nan),
        ("base_com_offset", (0.0, 0.0)),
    ],
)
def test_a_bad_value_is_refused_by_name(name, value):
    with pytest.raises(InputError) as caught:
        PlantParameters(**{name: value})
    assert caught.value.argument == name
    assert repr(value) in str(caught.value)


def test_a_bad_component_is_refused_by_name():
    with pytest.raises(InputError, match=r"base_com_offset\.y"):
        PlantParameters(base_com_offset=(0.0, math.nan, 0.0))
    with pytest.raises(InputError, match=r"box_half_sizes\.z"):
        BodyGeometry(box_half_sizes=(0.1, 0.1, 0.0))
    with pytest.raises(InputError, match="sphere_radius"):
        BodyGeometry("*", 0.0)


def test_geometry_is_the_benchmarks_for_solo12_and_nothing_else_by_default(solo12, zoo):
    assert body_geometry(solo12, PlantParameters()) == SOLO12_GEOMETRY
    assert body_geometry(zoo, PlantParameters()) == BodyGeometry()
    own = BodyGeometry(box_half_sizes=(0.1, 0.1, 0.1))
    assert body_geometry(solo12, PlantParameters(geometry=own)) == own


def test_simulated_masses(solo12):
    params = PlantParameters(mass_scale=1.5, base_added_mass=0.7, base_com_offset=(0.01, 0.02, -0.03))
    before = [inertia.copy() for inertia in solo12.model.inertias]
    model = simulated_model(solo12, params)
    assert pin.computeTotalMass(model) == pytest.approx(1.5 * solo12.mass + 0.7, rel=1e-14)
    np.testing.assert_allclose(model.inertias[1].lever, before[1].lever + (0.01, 0.02, -0.03), atol=1e-16)
    # A point mass at the centre of mass adds nothing to the moments about it.
    np.testing.assert_allclose(model.inertias[1].inertia, 1.5 * before[1].inertia, rtol=1e-14)
    np.testing.assert_allclose(model.inertias[3].matrix(), 1.5 * before[3].matrix(), rtol=1e-12, atol=1e-18)
    # The controller's model is another one, and stays as it was.
    assert all(np.array_equal(a.matrix(), b.matrix()) for a, b in zip(solo12.model.inertias, before, strict=True))
