"""The friction pyramid: inscribed, of numbers and of CasADi expressions alike."""

import casadi as ca
import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.robot.friction import check_facets, friction_margins, friction_pyramid, pyramid_half_width


@pytest.mark.parametrize("facets", [3, 4, 5, 8, 16])
@pytest.mark.parametrize("friction", [0.2, 0.6, 1.3])
def test_the_pyramid_is_inscribed_in_the_cone(facets, friction):
    rows = friction_pyramid(friction, facets)
    assert rows.shape == (facets, 3)
    for first, second in zip(rows, np.roll(rows, -1, axis=0), strict=True):  # edges lie on the cone
        tangential = np.linalg.solve([first[:2], second[:2]], [-first[2], -second[2]])
        assert np.linalg.norm(tangential) == pytest.approx(friction, rel=1e-12)
    rng = np.random.default_rng(0)
    angle, radius = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(0, 1.5 * friction, 2000)
    forces = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(2000)])
    allowed = (forces @ rows.T <= 0).all(axis=1)
    assert radius[allowed].max() <= friction  # nothing beyond the cone
    assert allowed[radius <= friction * np.cos(np.pi / facets)].all()  # and all of the cone within the pyramid's sides
    assert 0 < allowed.sum() < 2000


def test_a_side_of_the_pyramid_faces_each_axis_for_multiples_of_four():
    for facets in (4, 8, 16):
        half_width = 0.5 * np.cos(np.pi / facets)
        for axis in ([1, 0], [-1, 0], [0, 1], [0, -1]):
            force = np.array([*(half_width * np.array(axis)), 1.0])
            assert (friction_pyramid(0.5, facets) @ force).max() == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("facets", [3, 4, 8, 12])
def test_margins_are_the_rows_for_symbolic_forces_and_friction(facets):
    force, friction = ca.SX.sym("f", 3), ca.SX.sym("mu")
    margins = ca.vertcat(*friction_margins(force, pyramid_half_width(friction, facets), facets))
    values = ca.Function("margins", [force, friction], [margins])([3.0, -1.0, 10.0], 0.7).full()[:, 0]
    np.testing.assert_allclose(values, -friction_pyramid(0.7, facets) @ [3.0, -1.0, 10.0], rtol=0, atol=1e-14)
    axes = 2 * (1 + (facets % 4 == 0)) if facets % 2 == 0 else 1  # facets that face an axis do not need the other one
    assert ca.jacobian(margins, force).nnz() == 3 * facets - axes


def test_two_facets_make_no_pyramid():
    check_facets(3)
    with pytest.raises(InputError, match="facets: got 2; expected at least 3"):
        check_facets(2)
