from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from samples import JointEffort, solo

from lgmpc.actions import Contact, KinodynamicAction, StateMomentum
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import (
    CentroidalMomentum,
    CoMPosition,
    ContactForce,
    Control,
    FrameVelocity,
    StateError,
)
from lgmpc.errors import InputError
from lgmpc.ocp import check_derivatives

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
WRENCH = np.array([3.0, -2.0, 1.0, 0.2, 0.5, -0.3])
CONTACTS = (Contact(FEET[0], 6), *FEET[1:])


@lru_cache
def action() -> KinodynamicAction:
    costs = [
        CostItem("x", StateError(StateMomentum(solo().model))),
        CostItem("u", Control(27), weight=1e-2),
        CostItem("com", CoMPosition()),
        CostItem("momentum", CentroidalMomentum()),
        CostItem("foot", FrameVelocity(FEET[2], pin.LOCAL)),
    ]
    return KinodynamicAction(
        "solo", solo().model, CONTACTS, costs, [ConstraintItem("force", ContactForce(FEET[1]), -1.0, 1.0)]
    )


def point(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a = action()
    x = a.state.integrate(np.r_[solo().q_reference, np.zeros(6)], rng.uniform(-0.5, 0.5, 24))
    p = a.parameters.default.copy()
    p[a.parameters["contact_points"]] = rng.uniform(-0.1, 0.1, 12)
    p[a.parameters["contact_stiffness"]] = 2.0
    p[a.parameters["contact_flags"]] = [1, 0, 1, 1]
    p[a.parameters["external_wrench"]] = WRENCH
    return x, rng.standard_normal(27), p


def test_velocity_has_the_states_momentum_and_forces_change_it() -> None:
    a, model, data = action(), solo().model, solo().create_data()
    x, u, p = point(np.random.default_rng(0))
    h = 1e-3
    p[a.parameters["duration"]] = h
    value = a.evaluate(x, u, p)
    wrench, points = u[:6], u[6:15].reshape(3, 3) * [[0], [1], [1]]
    q, before, after = x[:19], x[19:], value.x_next[19:]
    pin.framesForwardKinematics(model, data, q)
    center = pin.centerOfMass(model, data, q)
    arms = [data.oMf[solo().frame(foot)].translation - center for foot in FEET]
    force = wrench[:3] + points.sum(axis=0) + solo().mass * np.array([0, 0, -9.81])
    moment = (
        np.cross(arms[0], wrench[:3]) + wrench[3:] + sum(np.cross(r, f) for r, f in zip(arms[1:], points, strict=True))
    )
    np.testing.assert_allclose(after, before + h * (np.r_[force, moment] + WRENCH), rtol=0, atol=1e-13)
    # The configuration moves with the mean momentum of the interval, and with the joint velocities of the control.
    mean = pin.difference(model, q, value.x_next[:19]) / h
    np.testing.assert_allclose(mean[6:], u[15:], rtol=0, atol=1e-11)
    got = pin.computeCentroidalMomentum(model, data, q, mean).vector
    np.testing.assert_allclose(got, (before + after) / 2, rtol=0, atol=1e-11)


def test_contacts_hold_or_have_no_force() -> None:
    a, model, data = action(), solo().model, solo().create_data()
    x, u, p = point(np.random.default_rng(1))
    q = x[:19]
    momentum = pin.computeCentroidalMap(model, data, q)
    v = np.r_[np.linalg.solve(momentum[:, :6], x[19:] - momentum[:, 6:] @ u[15:]), u[15:]]
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    rows = []
    for i, (foot, flag) in enumerate(zip(FEET, [1, 0, 1, 1], strict=True)):
        frame = solo().frame(foot)
        rate = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector[: 6 if i == 0 else 3].copy()
        held = p[a.parameters["contact_points"]][3 * i : 3 * i + 3]
        rate[:3] += 2.0 * (data.oMf[frame].translation - held)
        rows.append(rate if flag else u[6:9])
    value = a.evaluate(x, u, p)
    np.testing.assert_allclose(value.constraint[:15], np.concatenate(rows), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(value.lower[:15], 0.0)
    np.testing.assert_array_equal(value.constraint[15:], 0.0)  # the force of the foot in the air


def test_derivatives() -> None:
    x, _, p = point(np.random.default_rng(2))
    report = check_derivatives(action(), np.random.default_rng(3), parameters=p, points=2)
    assert report.passed, str(report)
    assert "terminal q" in {check.quantity for check in report.checks}


def test_momentum_state_is_a_state() -> None:
    state, rng = StateMomentum(solo().model), np.random.default_rng(4)
    x = state.integrate(state.neutral(), rng.uniform(-1, 1, 24))
    dx = rng.uniform(-1, 1, 24)
    y = state.integrate(x, dx)
    np.testing.assert_allclose(state.diff(x, y), dx, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.integrate_symbolic(x, dx).full().ravel(), y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(state.diff_symbolic(x, y).full().ravel(), dx, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.integrate(np.tile(x, (2, 1)), np.tile(dx, (2, 1)))[1], y, rtol=0, atol=1e-14)
    by_x, by_dx = state.Jintegrate(x, dx)
    by_0, by_1 = state.Jdiff(x, y)
    h = 1e-6
    for k, step in enumerate(h * np.eye(24)):
        slopes = [
            (state.diff(y, state.integrate(state.integrate(x, s * step), dx)) for s in (1, -1)),
            (state.diff(y, state.integrate(x, dx + s * step)) for s in (1, -1)),
            (state.diff(state.integrate(x, s * step), y) for s in (1, -1)),
            (state.diff(x, state.integrate(y, s * step)) for s in (1, -1)),
        ]
        for jacobian, (plus, minus) in zip((by_x, by_dx, by_0, by_1), slopes, strict=True):
            np.testing.assert_allclose(jacobian[:, k], (plus - minus) / (2 * h), rtol=0, atol=1e-8)
    with pytest.raises(InputError, match="dx: got shape"):
        state.integrate(x, dx[:5])


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="whose base is fixed"):
        KinodynamicAction("arm", pin.buildSampleModelManipulator(), ["tool"])
    with pytest.raises(InputError, match="^tau: got a node without it"):
        KinodynamicAction("e", solo().model, FEET, [CostItem("tau", JointEffort(12))]).value_function  # noqa: B018
