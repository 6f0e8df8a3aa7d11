from __future__ import annotations

import numpy as np
import pytest
from samples import centroidal_parameters

from lgmpc.actions import CentroidalAction, CentroidalFootholdAction

FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.01], [-0.2, 0.15, -0.02], [-0.2, -0.15, 0.03]])
FLAGS = np.array([1.0, 0.0, 1.0, 0.0])
UNIT = np.array([1e-3, 2e-3, 1e-3, 0.0])


def filled(action: CentroidalAction, rng: np.random.Generator) -> np.ndarray:
    p = centroidal_parameters(action, rng, FEET, contact_flags=FLAGS)
    if isinstance(action, CentroidalFootholdAction):
        p[action.parameters["foothold_unit"]] = UNIT
        p[action.parameters["foothold_margin"]] = rng.uniform(10.0, 50.0, 4 * action.facets)
    return p


@pytest.fixture(scope="module")
def action() -> CentroidalFootholdAction:
    return CentroidalFootholdAction(4, 8)


def test_it_is_the_centroidal_step_at_the_shifted_points(action: CentroidalFootholdAction) -> None:
    rng = np.random.default_rng(0)
    p = filled(action, np.random.default_rng(1))
    x, u = rng.standard_normal(17), 10.0 * rng.standard_normal(12)
    plain = CentroidalAction(4, 8)
    q = filled(plain, np.random.default_rng(1))
    shifted = FEET.copy()
    shifted[:, :2] += x[9:].reshape(4, 2)
    q[plain.parameters["contact_points"]] = shifted.ravel()
    after = action.evaluate(x, u, p).x_next
    np.testing.assert_allclose(after[:9], plain.evaluate(x[:9], u, q).x_next, rtol=1e-12, atol=1e-12)
    forces, shifts = u.reshape(4, 3), after[9:].reshape(4, 2)
    np.testing.assert_array_equal(shifts[[0, 2]], x[9:].reshape(4, 2)[[0, 2]])  # feet that stand stay
    np.testing.assert_allclose(shifts[1], 2e-3 * forces[1, :2])  # one in the air goes where its control says
    np.testing.assert_array_equal(shifts[3], 0.0)  # one without a unit goes to its nominal foothold


def test_its_derivatives_are_those_of_central_differences(action: CentroidalFootholdAction) -> None:
    rng = np.random.default_rng(2)
    p = filled(action, rng)
    x, u = rng.standard_normal(17), 10.0 * rng.standard_normal(12)
    x_next = action.evaluate(x, u, p).x_next
    blocks = dict(
        zip(
            ["A", "B", "b", "Q", "S", "R", "q", "r", "C", "D"],
            [value.full() for value in action.quadratic_function(x, u, x_next, p)],
            strict=False,
        )
    )
    np.testing.assert_allclose(blocks["b"], 0.0, atol=1e-12)
    for names, point in (("ACq", x), ("BDr", u)):
        for i in range(point.size):
            step = np.zeros(point.size)
            step[i] = 1e-5
            ends = [action.evaluate(*((x + s * step, u) if point is x else (x, u + s * step)), p) for s in (1.0, -1.0)]
            dynamics, path, cost = (
                (getattr(ends[0], name) - getattr(ends[1], name)) / 2e-5 for name in ("x_next", "constraint", "cost")
            )
            # Polynomials of degree two: what is left is rounding, 1e-16 of values up to 1e3 over 1e-5.
            np.testing.assert_allclose(blocks[names[0]][:, i], dynamics, atol=1e-7)
            np.testing.assert_allclose(blocks[names[1]][:, i], path, atol=1e-7)
            np.testing.assert_allclose(blocks[names[2]][i, 0], cost, atol=1e-6)


def test_shifts_are_bounded_by_their_margins_and_forces_by_friction(action: CentroidalFootholdAction) -> None:
    p = filled(action, np.random.default_rng(3))
    margins = p[action.parameters["foothold_margin"]].reshape(4, 8)
    u = np.zeros((4, 3))
    u[[0, 2], 2] = 5.0
    u[1, 0] = margins[1, 0] - 1e-6
    assert action.evaluate(np.zeros(17), u.ravel(), p).violation == 0.0
    u[1, 0] = margins[1, 0] + 1e-3
    assert action.evaluate(np.zeros(17), u.ravel(), p).violation == pytest.approx(1e-3)
    u[1, 0], u[1, 2] = margins[1, 0] + 1e-3, 20.0  # the unused control does not widen the margins
    assert action.evaluate(np.zeros(17), u.ravel(), p).violation > 0.9e-3
    u[1], u[0, 0] = 0.0, 5.0
    assert action.evaluate(np.zeros(17), u.ravel(), p).violation > 1.0  # friction
