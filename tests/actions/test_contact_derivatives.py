"""Next states of contact actions and their derivatives, against Pinocchio's analytic ones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from pinocchio_contacts import PinocchioContactDynamics
from samples import solo

from lgmpc.actions import Contact, ContactForwardDynamics, MultibodyAction
from lgmpc.costs import CostItem
from lgmpc.costs.library import ContactForce, JointAcceleration

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
CONTACTS = {
    "points": FEET,
    "surface": (Contact(FEET[0], 6), FEET[3]),
    "skate": (Contact(FEET[0], 1, frame_axes=((0.0, 1.0, 0.0),)), FEET[3]),
    "axes": (
        Contact(FEET[0], 1),
        Contact(FEET[1], 2, axes=((1.0, 0.0, 0.5),), frame_axes=((0.0, 1.0, 0.2),)),
        Contact(FEET[2], 2, frame_axes=((0.0, 0.6, 0.8), (1.0, 0.0, 0.0))),
        FEET[3],
    ),
}


@lru_cache
def action(kind: str) -> MultibodyAction:
    costs = [CostItem("a", JointAcceleration(12), weight=1e-3), CostItem("force", ContactForce(FEET[3]), 1e-2)]
    return MultibodyAction(kind, ContactForwardDynamics(solo().model, CONTACTS[kind]), costs)


@pytest.mark.parametrize("kind", CONTACTS)
@pytest.mark.parametrize("flags", [[1, 1, 1, 1], [0, 1, 0, 1]])
def test_expansion_is_that_of_pinocchio(kind: str, flags: list[int]) -> None:
    subject, rng = action(kind), np.random.default_rng(0)
    assert isinstance(subject.dynamics, ContactForwardDynamics)
    state, layout, nv = subject.state, subject.parameters, 18
    x = state.integrate(solo().x_reference, rng.uniform(-0.5, 0.5, 36))
    u, p = rng.standard_normal(12), layout.default.copy()
    for name in ("contact_points", "contact_gains"):
        p[layout[name]] = rng.uniform(0.1, 2.0, p[layout[name]].size)
    p[layout["contact_flags"]] = flags[: len(CONTACTS[kind])]
    p[layout["contact_damping"]] = 1e-3

    oracle = PinocchioContactDynamics(solo().model, subject.dynamics.contacts)
    values = {name: layout.view(p[None], name) for name in layout}
    solution = oracle.solve(x[None], u[None], values)
    slopes, h, a = oracle.slopes(x[None], solution, values)[0], values["duration"][0, 0], solution.z[0, :nv]
    step = h * np.concatenate([x[19:] + h * a, a])
    x_next = state.integrate(x, step)
    rates = h * slopes[:nv]
    rates[:, nv : 2 * nv] += np.eye(nv)  # of the next velocity, by x and u
    moved = np.vstack([h * rates, h * slopes[:nv]])
    by_x, by_step = state.Jintegrate(x, step)
    expected = by_step @ moved
    expected[:, : 2 * nv] += by_x

    np.testing.assert_allclose(subject.evaluate(x, u, p).x_next, x_next, rtol=1e-9, atol=1e-9)
    found = subject.quadratic_function(x=x, u=u, x_next=x_next, p=p)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(np.hstack([found["A"].full(), found["B"].full()]), expected, rtol=0, atol=1e-9 * scale)
    # The gradient by controls of costs of accelerations and forces alone is that through both.
    joints, force = solution.z[0, 6:nv], solution.z[0, -3:]
    gradient = h * (1e-3 * joints @ slopes[6:nv, 2 * nv :] + 1e-2 * force @ slopes[-3:, 2 * nv :])
    np.testing.assert_allclose(found["r"].full()[:, 0], gradient, rtol=0, atol=1e-9 * max(1.0, np.abs(gradient).max()))
