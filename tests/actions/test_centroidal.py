from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from samples import centroidal_parameters
from scipy.integrate import solve_ivp

from lgmpc.actions import CentroidalAction
from lgmpc.errors import InputError

FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.01], [-0.2, 0.15, -0.02], [-0.2, -0.15, 0.03]])


def parameters(action: CentroidalAction, rng: np.random.Generator, **given_values: object) -> np.ndarray:
    feet = FEET[: action.contacts] + 0.01 * rng.standard_normal((action.contacts, 3))
    return centroidal_parameters(action, rng, feet, **given_values)


@pytest.fixture(scope="module")
def action() -> CentroidalAction:
    return CentroidalAction(4, 8)


def in_world(action: CentroidalAction, p: np.ndarray, given_forces: np.ndarray) -> np.ndarray:
    """Control of forces whose third parts are along the normals and whose first parts are above the world's x axis."""
    normals, forces = action.parameters.split(p)["contact_normals"].reshape(-1, 3), []
    for normal, (along, across, out) in zip(normals, given_forces.reshape(-1, 3), strict=True):
        first = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
        first /= np.linalg.norm(first)
        forces.append(along * first + across * np.cross(normal, first) + out * normal)
    return np.concatenate(forces)


def ode(action: CentroidalAction, u: np.ndarray, p: np.ndarray):
    s = action.parameters.split(p)
    points = s["contact_points"].reshape(-1, 3)
    forces = u.reshape(-1, 3) * s["contact_flags"][:, None]

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        force = s["mass"] * s["gravity"] + forces.sum(0) + s["external_wrench"][:3]
        moment = np.cross(points - x[:3], forces).sum(0) + s["external_wrench"][3:]
        return np.concatenate([x[3:6] / s["mass"], force, moment])

    return rate


@pytest.mark.parametrize("seed", range(4))
def test_step_is_the_exact_integral_of_the_dynamics(action: CentroidalAction, seed: int) -> None:
    rng = np.random.default_rng(seed)
    flags = rng.integers(0, 2, 4).astype(float)
    p = parameters(action, rng, duration=0.3, contact_flags=flags)
    x, u = rng.standard_normal(9), 10.0 * rng.standard_normal(12)
    exact = solve_ivp(ode(action, u, p), (0.0, 0.3), x, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    np.testing.assert_allclose(action.evaluate(x, u, p).x_next, exact, rtol=0, atol=1e-11)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.5), st.floats(0.05, 0.95))
def test_two_part_intervals_make_the_whole(seed: int, duration: float, share: float) -> None:
    action = CentroidalAction(2, 4)
    rng = np.random.default_rng(seed)
    whole = parameters(action, rng, duration=duration)
    x, u = rng.standard_normal(9), 10.0 * rng.standard_normal(6)
    parts = [whole.copy(), whole.copy()]
    parts[0][action.parameters["duration"]] = share * duration
    parts[1][action.parameters["duration"]] = (1.0 - share) * duration
    y = x
    for p in parts:
        y = action.evaluate(y, u, p).x_next
    np.testing.assert_allclose(y, action.evaluate(x, u, whole).x_next, rtol=0, atol=1e-12)


def test_momenta_are_conserved_in_free_flight_without_gravity(action: CentroidalAction) -> None:
    rng = np.random.default_rng(0)
    p = parameters(action, rng, gravity=0.0, contact_flags=0.0, external_wrench=0.0)
    x = rng.standard_normal(9)
    after = action.evaluate(x, rng.standard_normal(12), p).x_next
    np.testing.assert_array_equal(after[3:], x[3:])
    np.testing.assert_allclose(after[:3], x[:3] + 0.05 * x[3:6] / 2.5, rtol=1e-15)


def test_expansion_agrees_with_central_differences(action: CentroidalAction) -> None:
    rng = np.random.default_rng(1)
    p = parameters(action, rng, contact_flags=[1.0, 0.0, 1.0, 1.0])
    x, u, x_next = rng.standard_normal(9), 5.0 * rng.standard_normal(12), rng.standard_normal(9)
    names = action.quadratic_function.name_out()
    q = {n: np.asarray(v.full()) for n, v in zip(names, action.quadratic_function(x, u, x_next, p), strict=True)}
    here = action.evaluate(x, u, p)
    h = 1e-4

    def difference(read, wrt: str) -> np.ndarray:
        columns = []
        for i in range(9 if wrt == "x" else 12):
            step = np.zeros(9 if wrt == "x" else 12)
            step[i] = h
            plus = action.evaluate(x + step, u, p) if wrt == "x" else action.evaluate(x, u + step, p)
            minus = action.evaluate(x - step, u, p) if wrt == "x" else action.evaluate(x, u - step, p)
            columns.append((read(plus) - read(minus)) / (2 * h))
        return np.array(columns).T

    close = {"rtol": 1e-6, "atol": 1e-8}
    np.testing.assert_allclose(q["A"], difference(lambda v: v.x_next, "x"), **close)
    np.testing.assert_allclose(q["B"], difference(lambda v: v.x_next, "u"), **close)
    np.testing.assert_allclose(q["C"], difference(lambda v: v.constraint, "x"), **close)
    np.testing.assert_allclose(q["D"], difference(lambda v: v.constraint, "u"), **close)
    np.testing.assert_allclose(q["q"].ravel(), difference(lambda v: v.cost, "x"), **close)
    np.testing.assert_allclose(q["r"].ravel(), difference(lambda v: v.cost, "u"), **close)
    np.testing.assert_allclose(q["b"].ravel(), here.x_next - x_next, rtol=0, atol=1e-14)
    np.testing.assert_allclose(q["lower"].ravel(), here.lower - here.constraint, rtol=0, atol=1e-14)
    s = action.parameters.split(p)
    # The cost is quadratic, so its Hessian is known.
    np.testing.assert_allclose(q["Q"], np.diag(s["x_weight"]), rtol=1e-15)
    np.testing.assert_allclose(q["R"], np.diag(s["u_weight"]), rtol=1e-15)
    assert not q["S"].any()
    assert q["cost"].item() == pytest.approx(here.cost, rel=1e-15)


def test_terminal_expansion_is_that_of_the_weighted_distance(action: CentroidalAction) -> None:
    rng = np.random.default_rng(2)
    p, x = parameters(action, rng), rng.standard_normal(9)
    s = action.parameters.split(p)
    hessian, gradient, cost = (v.full() for v in action.terminal_quadratic_function(x, p))
    np.testing.assert_allclose(hessian, np.diag(s["x_weight"]), rtol=1e-15)
    np.testing.assert_allclose(gradient.ravel(), s["x_weight"] * (x - s["x_reference"]), rtol=1e-15)
    assert cost.item() == pytest.approx(0.5 * s["x_weight"] @ (x - s["x_reference"]) ** 2)


@pytest.mark.parametrize("facets", [3, 4, 5, 8, 16])
def test_pyramid_is_inscribed_in_the_friction_cone(facets: int) -> None:
    action = CentroidalAction(1, facets)
    p = parameters(action, np.random.default_rng(0), friction=0.7)
    zeros = np.zeros(9)
    for angle in np.linspace(0.0, 2 * math.pi, 97):
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        on_cone = 10.0 * (0.7 * direction + [0.0, 0.0, 1.0])
        beyond = action.evaluate(zeros, in_world(action, p, on_cone + 1e-6 * direction), p)
        assert beyond.violation > 0.0  # nothing outside the cone is allowed
        shrunk = 10.0 * (0.7 * (math.cos(math.pi / facets) - 1e-9) * direction + [0.0, 0.0, 1.0])
        assert action.evaluate(zeros, in_world(action, p, shrunk), p).violation == 0.0  # its inner circle
    edge = math.pi / facets  # between the normals of facets 0 and 1
    on_edge = 10.0 * np.array([0.7 * math.cos(edge), 0.7 * math.sin(edge), 1.0])
    assert action.evaluate(zeros, in_world(action, p, (1 - 1e-9) * on_edge), p).violation < 1e-9  # edges touch the cone


def test_normal_force_stays_between_its_bounds(action: CentroidalAction) -> None:
    p = parameters(action, np.random.default_rng(0))
    u = np.tile([0.0, 0.0, 10.0], 4)
    assert action.evaluate(np.zeros(9), in_world(action, p, u), p).violation == 0.0
    for normal, violation in ((0.4, 0.1), (25.5, 0.5), (-1.0, 1.5)):
        u[5] = normal
        assert action.evaluate(np.zeros(9), in_world(action, p, u), p).violation == pytest.approx(violation)


def test_foot_in_the_air_has_no_force_and_zero_lies_strictly_inside(action: CentroidalAction) -> None:
    rng = np.random.default_rng(3)
    flags = np.array([1.0, 0.0, 1.0, 0.0])
    p = parameters(action, rng, contact_flags=flags)
    x, u = rng.standard_normal(9), np.tile([0.5, -0.5, 10.0], 4)
    grounded = u.reshape(4, 3) * flags[:, None]
    np.testing.assert_array_equal(action.evaluate(x, u, p).x_next, action.evaluate(x, grounded.ravel(), p).x_next)
    value = action.evaluate(x, grounded.ravel(), p)
    rows = np.minimum(value.constraint - value.lower, value.upper - value.constraint).reshape(4, 9)
    assert (rows[flags == 0.0] > 1.0).all()
    gradient = action.quadratic_function(x, grounded.ravel(), x, p)[7].full().reshape(4, 3)
    np.testing.assert_array_equal(gradient[flags == 0.0], 0.0)  # the cost is least at zero force


def test_everything_that_changes_between_solves_is_a_parameter(action: CentroidalAction) -> None:
    rng = np.random.default_rng(4)
    x, u = rng.standard_normal(9), 5.0 * rng.standard_normal(12)
    p = parameters(action, rng)

    def outcome(vector: np.ndarray) -> np.ndarray:
        v = action.evaluate(x, u, vector)
        terminal = action.terminal_value_function(x, vector).full().ravel()
        bounds = np.nan_to_num(np.concatenate([v.lower, v.upper]))
        return np.concatenate([v.x_next, [v.cost], v.constraint, bounds, terminal])

    for i in range(p.size):
        other = p.copy()
        other[i] += 0.125
        assert not np.array_equal(outcome(other), outcome(p)), f"parameter {i} changes nothing"


def test_bad_input_is_named(action: CentroidalAction) -> None:
    with pytest.raises(InputError, match="contacts: got 0"):
        CentroidalAction(0)
    with pytest.raises(InputError, match="facets: got 2"):
        CentroidalAction(4, 2)
    with pytest.raises(InputError, match="Did you mean friction"):
        action.parameters["fricton"]
