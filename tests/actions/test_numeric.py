from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from samples import solo

from lgmpc.actions import (
    Contact,
    ContactForwardDynamics,
    ContactInverseDynamics,
    ExternalWrench,
    MultibodyAction,
    NumericContactAction,
    RungeKutta4,
)
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import ContactForce, Control, FrictionCone, JointAcceleration, StateError
from lgmpc.errors import InputError

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


CONTACTS = {
    "points": FEET,
    "surface": (Contact(FEET[0], 6), FEET[3]),
    "axes": (
        Contact(FEET[0], 1),
        Contact(FEET[1], 2, axes=((1.0, 0.0, 0.5),), frame_axes=((0.0, 1.0, 0.2),)),
        Contact(FEET[2], 2, frame_axes=((0.0, 0.6, 0.8), (1.0, 0.0, 0.0))),
        FEET[3],
    ),
}


@lru_cache
def action(kind: str) -> MultibodyAction:
    contacts = CONTACTS[kind]
    dynamics = ContactForwardDynamics(solo().model, contacts)
    costs = [
        CostItem("x", StateError(dynamics.state, solo().x_reference)),
        CostItem("u", Control(12), weight=1e-2),
        CostItem("a", JointAcceleration(12), weight=1e-3),
        CostItem("cone", FrictionCone(FEET[3], 6), 0.1, QuadraticBarrier(0.0, np.inf)),
    ]
    bounds = [ConstraintItem("force", ContactForce(FEET[3]), [-1, -1, 0], [1, 1, 9])]
    return MultibodyAction(kind, dynamics, costs, bounds)


@pytest.mark.parametrize("kind", CONTACTS)
def test_compiled_and_numeric_expansions_are_the_same(kind: str) -> None:
    compiled = action(kind)
    numeric = NumericContactAction(compiled)
    rng = np.random.default_rng(0)
    for flags in ([1, 1, 1, 1], [0, 1, 0, 1]):
        x = compiled.state.integrate(solo().x_reference, rng.uniform(-0.5, 0.5, 36))
        x_next = compiled.state.integrate(x, rng.uniform(-0.1, 0.1, 36))
        u, p = rng.standard_normal(12), compiled.parameters.default.copy()
        for name in ("contact_points", "contact_gains"):
            p[compiled.parameters[name]] = rng.uniform(0.1, 2.0, p[compiled.parameters[name]].size)
        p[compiled.parameters["contact_flags"]] = flags[: len(CONTACTS[kind])]
        p[compiled.parameters["contact_damping"]] = 1e-3
        here, there = compiled.evaluate(x, u, p), numeric.evaluate(x, u, p)
        for field in ("x_next", "cost", "constraint", "lower", "upper"):
            one, other = getattr(here, field), getattr(there, field)
            np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(one).max()), err_msg=field)
        names = compiled.quadratic_function.name_out()
        expected = dict(zip(names, compiled.quadratic_function(x, u, x_next, p), strict=True))
        got = numeric.quadratics(x[None], u[None], x_next[None], p[None])
        for name in names:
            one, other = expected[name].full(), np.asarray(getattr(got, name))
            scale = max(1.0, float(np.abs(one).max()))
            np.testing.assert_allclose(other.reshape(one.shape), one, rtol=0, atol=1e-9 * scale, err_msg=name)


@pytest.mark.parametrize("kind", ["surface", "axes"])
def test_expansions_of_several_stages_are_the_central_differences_of_their_values(kind: str) -> None:
    """Three stages at once, with flags, gains and durations of their own, errors of orientation up to 1 rad."""
    numeric, contacts = NumericContactAction(action(kind)), len(CONTACTS[kind])
    state, layout, rng = numeric.state, numeric.parameters, np.random.default_rng(2)
    xs = np.array([state.integrate(solo().x_reference, rng.uniform(-0.5, 0.5, 36)) for _ in range(3)])
    us, ps = rng.standard_normal((3, 12)), np.tile(layout.default, (3, 1))
    ps[:, layout["contact_gains"]] = rng.uniform(1.0, 9.0, (3, 2 * contacts))
    ps[:, layout["contact_flags"]] = np.array([[1, 1, 1, 1], [0, 1, 0, 1], [1, 0, 1, 1]])[:, :contacts]
    ps[:, layout["duration"]] = [[0.01], [0.02], [0.03]]
    xs_next = np.array([numeric.evaluate(x, u, p).x_next for x, u, p in zip(xs, us, ps, strict=True)])
    found = numeric.quadratics(xs, us, xs_next, ps)
    eps = 1e-6
    for k, (x, u, p) in enumerate(zip(xs, us, ps, strict=True)):

        def values(dx: np.ndarray, du: np.ndarray, x: np.ndarray = x, u: np.ndarray = u, p: np.ndarray = p, k: int = k):
            at = numeric.evaluate(state.integrate(x, dx), u + du, p)
            return np.concatenate([state.diff(xs_next[k], at.x_next), [at.cost], at.constraint])

        for size, blocks in ((36, ("A", "q", "C")), (12, ("B", "r", "D"))):
            moves = [(e, np.zeros(12)) if size == 36 else (np.zeros(36), e) for e in eps * np.eye(size)]
            slopes = np.array([(values(dx, du) - values(-dx, -du)) / (2 * eps) for dx, du in moves]).T
            got = np.vstack([np.atleast_2d(getattr(found, name)[k]) for name in blocks])
            np.testing.assert_allclose(got, slopes, rtol=0, atol=1e-7 * max(1.0, np.abs(slopes).max()))


def test_a_stage_without_a_solution_leaves_the_others_alone() -> None:
    numeric = NumericContactAction(action("points"))
    xs, us, ps = np.tile(solo().x_reference, (2, 1)), np.zeros((2, 12)), np.tile(numeric.parameters.default, (2, 1))
    expected = numeric.quadratics(xs, us, xs, ps)
    ps[0, numeric.parameters["contact_damping"]] = np.nan
    found = numeric.quadratics(xs, us, xs, ps)
    for name in ("A", "B", "b", "Q", "R", "q", "cost"):
        np.testing.assert_array_equal(getattr(found, name)[1], getattr(expected, name)[1], err_msg=name)
    assert np.isnan(found.A[0]).any() and np.isnan(found.b[0]).any()


def test_expansions_are_the_same_where_the_base_turns_by_a_small_angle_in_a_step() -> None:
    """From 1.2e-4 rad on ``pin.dIntegrate`` is off by up to 2e-5 of the distance that the base moves in a step."""
    compiled = action("points")
    numeric = NumericContactAction(compiled)
    rng, p = np.random.default_rng(1), compiled.parameters.default.copy()
    p[compiled.parameters["contact_flags"]] = 0.0
    h = float(p[compiled.parameters["duration"]][0])
    for angle in (1e-6, 1e-4, 2e-4, 1e-3):
        x = solo().x_reference.copy()
        x[19:25] = np.concatenate([rng.standard_normal(3), angle / h * np.array([2.0, -1.0, 2.0]) / 3.0])
        x_next = compiled.evaluate(x, np.zeros(12), p).x_next
        expected = compiled.quadratic_function(x, np.zeros(12), x_next, p)[0].full()
        np.testing.assert_allclose(
            numeric.quadratics(x[None], np.zeros((1, 12)), x_next[None], p[None]).A[0], expected, rtol=0, atol=1e-11
        )


def test_other_dynamics_and_integrators_are_refused() -> None:
    model = solo().model
    with pytest.raises(InputError, match="action: got ContactInverseDynamics"):
        NumericContactAction(MultibodyAction("inverse", ContactInverseDynamics(model, FEET)))
    with pytest.raises(InputError, match="action: got RungeKutta4"):
        NumericContactAction(MultibodyAction("rk", ContactForwardDynamics(model, FEET), integrator=RungeKutta4()))
    with pytest.raises(InputError, match="action: got dynamics with 1 loads"):
        loaded = ContactForwardDynamics(model, FEET, [ExternalWrench(model)])
        NumericContactAction(MultibodyAction("loaded", loaded))
    with pytest.raises(InputError, match="actuation: got another matrix"):
        one_motor = ContactForwardDynamics(model, FEET, actuation=np.eye(18)[:, 6:7])
        NumericContactAction(MultibodyAction("one_motor", one_motor))
