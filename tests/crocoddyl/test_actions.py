from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from samples import solo

from lgmpc.actions import Contact, ContactForwardDynamics, ImpulseAction, MultibodyAction
from lgmpc.costs import Activation, CostItem, Quadratic, QuadraticBarrier, Residual
from lgmpc.costs.library import (
    CentroidalMomentum,
    CoMPosition,
    ContactForce,
    Control,
    FramePlacement,
    FrameRotation,
    FrameTranslation,
    FrameVelocity,
    StateError,
)

pytestmark = pytest.mark.crocoddyl

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
USED = (0, 3)
GAINS = np.array([3.0, 5.0])
FORCE = np.array([1.0, 2.0, 3.0])


@pytest.fixture
def crocoddyl() -> Any:
    with warnings.catch_warnings():  # its viewer's dependencies are deprecated, not what is tested
        warnings.simplefilter("ignore")
        return pytest.importorskip("crocoddyl")


def assert_same(ours: MultibodyAction | ImpulseAction, p: np.ndarray, theirs: Any, rng: np.random.Generator) -> None:
    """Next state, cost, all derivatives: equal to rounding at random points."""
    data = theirs.createData()
    for _ in range(3):
        x = ours.state.integrate(solo().x_reference, rng.uniform(-0.4, 0.4, 36))
        u = rng.standard_normal(ours.nu)
        theirs.calc(data, x, u)
        theirs.calcDiff(data, x, u)
        names = ours.quadratic_function.name_out()
        got = dict(zip(names, ours.quadratic_function(x, u, data.xnext, p), strict=True))
        expected = {
            "b": np.zeros(36), "cost": data.cost, "A": data.Fx, "B": data.Fu, "q": data.Lx, "r": data.Lu,
            "Q": data.Lxx, "R": data.Luu, "S": np.asarray(data.Lxu).T,
        }  # fmt: skip
        for name, value in expected.items():
            one = got[name].full()
            other = np.asarray(value, dtype=np.float64).reshape(one.shape)
            scale = max(1.0, float(np.abs(other).max(initial=0.0)))
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * scale, err_msg=name)


def test_contact_forward_dynamics(crocoddyl: Any) -> None:
    """Two of four feet in contact: a subset there, flags here."""
    model, rng = solo().model, np.random.default_rng(0)
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFloatingBase(state)
    points = rng.uniform(-0.2, 0.2, (4, 3))
    contacts = crocoddyl.ContactModelMultiple(state, 12)
    costs = crocoddyl.CostModelSum(state, 12)
    residual = crocoddyl.ResidualModelState(state, solo().x_reference.copy(), 12)
    costs.addCost("state", crocoddyl.CostModelResidual(state, residual), 0.7)
    costs.addCost("control", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, 12)), 1e-2)
    items = [CostItem("control", Control(12), 1e-2)]
    for i in USED:
        frame = solo().frame(FEET[i])
        contact = crocoddyl.ContactModel3D(state, frame, points[i], pin.LOCAL_WORLD_ALIGNED, 12, GAINS)
        contacts.addContact(FEET[i], contact)
        desired = pin.Force(np.r_[FORCE, np.zeros(3)])
        force = crocoddyl.ResidualModelContactForce(state, frame, desired, 3, 12)
        costs.addCost(FEET[i], crocoddyl.CostModelResidual(state, force), 1e-2)
        items.append(CostItem(FEET[i], ContactForce(FEET[i], 3, FORCE), 1e-2))
    forward = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)
    dynamics = ContactForwardDynamics(model, FEET)
    items.append(CostItem("state", StateError(dynamics.state, solo().x_reference), 0.7))
    ours = MultibodyAction("contact", dynamics, items)
    p = ours.parameters.default.copy()
    p[ours.parameters["contact_points"]] = points.ravel()
    p[ours.parameters["contact_gains"]] = np.tile(GAINS, 4)
    p[ours.parameters["contact_flags"]] = [float(i in USED) for i in range(4)]
    p[ours.parameters["duration"]] = 0.02
    assert_same(ours, p, crocoddyl.IntegratedActionModelEuler(forward, 0.02), rng)


def test_contacts_along_one_axis(crocoddyl: Any) -> None:
    """A foot on a level face and one on a slanted one without friction, and a point, each with gains of its own."""
    model, rng = solo().model, np.random.default_rng(5)
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFloatingBase(state)
    contacts, costs = crocoddyl.ContactModelMultiple(state, 12), crocoddyl.CostModelSum(state, 12)
    turns = (np.eye(3), pin.exp3(np.array([0.3, -0.5, 0.2])))
    heights, gains = (0.05, -0.1), rng.uniform(0.5, 6.0, (3, 2))
    for foot, turn, height, pair in zip(FEET, turns, heights, gains, strict=False):
        one = crocoddyl.ContactModel1D(state, solo().frame(foot), height, pin.LOCAL_WORLD_ALIGNED, turn, 12, pair)
        contacts.addContact(foot, one)
    place = rng.uniform(-0.2, 0.2, 3)
    frame = solo().frame(FEET[2])
    contacts.addContact(FEET[2], crocoddyl.ContactModel3D(state, frame, place, pin.LOCAL_WORLD_ALIGNED, 12, gains[2]))
    residual = crocoddyl.ResidualModelState(state, solo().x_reference.copy(), 12)
    costs.addCost("state", crocoddyl.CostModelResidual(state, residual), 0.7)
    force = crocoddyl.ResidualModelContactForce(
        state, solo().frame(FEET[0]), pin.Force(np.r_[0, 0, 2.0, 0, 0, 0]), 1, 12
    )
    costs.addCost("force", crocoddyl.CostModelResidual(state, force), 1e-2)
    forward = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)

    dynamics = ContactForwardDynamics(
        model, [Contact(FEET[0], 1), Contact(FEET[1], 1, axes=(tuple(turns[1][2]),)), FEET[2]]
    )
    items = [
        CostItem("state", StateError(dynamics.state, solo().x_reference), 0.7),
        CostItem("force", ContactForce(FEET[0], 3, [0.0, 0.0, 2.0]), 1e-2),
    ]
    ours = MultibodyAction("sliding", dynamics, items)
    p = ours.parameters.default.copy()
    points = [height * turn[:, 2] for height, turn in zip(heights, turns, strict=True)]
    p[ours.parameters["contact_points"]] = np.concatenate([*points, place])
    p[ours.parameters["contact_gains"]] = gains.ravel()
    p[ours.parameters["duration"]] = 0.02
    assert_same(ours, p, crocoddyl.IntegratedActionModelEuler(forward, 0.02), rng)


def test_impact(crocoddyl: Any) -> None:
    """Without restitution: with it, Crocoddyl 3.2.1's derivative of the next state is not that of its next state."""
    model, rng = solo().model, np.random.default_rng(1)
    state = crocoddyl.StateMultibody(model)
    impulses = crocoddyl.ImpulseModelMultiple(state)
    for i in USED:
        impulses.addImpulse(FEET[i], crocoddyl.ImpulseModel3D(state, solo().frame(FEET[i]), pin.LOCAL_WORLD_ALIGNED))
    costs = crocoddyl.CostModelSum(state, 0)
    residual = crocoddyl.ResidualModelState(state, solo().x_reference.copy(), 0)
    costs.addCost("state", crocoddyl.CostModelResidual(state, residual), 0.3)
    theirs = crocoddyl.ActionModelImpulseFwdDynamics(state, impulses, costs, 0.0, 0.0, True)
    dynamics = ContactForwardDynamics(model, FEET)
    ours = ImpulseAction("impact", model, FEET, [CostItem("s", StateError(dynamics.state, solo().x_reference), 0.3)])
    p = ours.parameters.default.copy()
    p[ours.parameters["contact_flags"]] = [float(i in USED) for i in range(4)]
    assert_same(ours, p, theirs, rng)


def residuals(crocoddyl: Any, state: Any) -> dict[str, tuple[Residual, Any]]:
    """The same residual on both sides."""
    frame, goal = solo().frame(FEET[1]), pin.SE3(pin.exp3(np.array([0.4, -0.2, 0.3])), np.array([0.1, 0.2, 0.3]))
    seven, three, six = pin.SE3ToXYZQUAT(goal), np.array([0.1, -0.2, 0.3]), np.linspace(-1, 1, 6)
    return {
        "com": (CoMPosition(three), crocoddyl.ResidualModelCoMPosition(state, three, 12)),
        "momentum": (CentroidalMomentum(six), crocoddyl.ResidualModelCentroidalMomentum(state, six, 12)),
        "placement": (FramePlacement(FEET[1], seven), crocoddyl.ResidualModelFramePlacement(state, frame, goal, 12)),
        "rotation": (
            FrameRotation(FEET[1], seven[3:]),
            crocoddyl.ResidualModelFrameRotation(state, frame, goal.rotation, 12),
        ),
        "translation": (
            FrameTranslation(FEET[1], three),
            crocoddyl.ResidualModelFrameTranslation(state, frame, three, 12),
        ),
        "velocity": (
            FrameVelocity(FEET[1], pin.LOCAL, six),
            crocoddyl.ResidualModelFrameVelocity(state, frame, pin.Motion(six), pin.LOCAL, 12),
        ),
    }


@pytest.mark.parametrize("name", ["com", "momentum", "placement", "rotation", "translation", "velocity"])
@pytest.mark.parametrize("kind", ["quadratic", "barrier"])
def test_residuals_and_activations(crocoddyl: Any, name: str, kind: str) -> None:
    model, rng = solo().model, np.random.default_rng(2)
    state = crocoddyl.StateMultibody(model)
    residual, there = residuals(crocoddyl, state)[name]
    bound = 0.1 * np.ones(residual.nr)
    activation: Activation
    if kind == "quadratic":
        activation, twin = Quadratic(), crocoddyl.ActivationModelQuad(residual.nr)
    else:
        bounds = crocoddyl.ActivationBounds(-bound, bound)
        activation, twin = QuadraticBarrier(-bound, bound), crocoddyl.ActivationModelQuadraticBarrier(bounds)
    costs = crocoddyl.CostModelSum(state, 12)
    costs.addCost(name, crocoddyl.CostModelResidual(state, twin, there), 0.5)
    actuation, contacts = crocoddyl.ActuationModelFloatingBase(state), crocoddyl.ContactModelMultiple(state, 12)
    forward = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)
    ours = MultibodyAction(name, ContactForwardDynamics(model, FEET), [CostItem("c", residual, 0.5, activation)])
    p = ours.parameters.default.copy()
    p[ours.parameters["contact_flags"]] = 0.0
    assert_same(ours, p, crocoddyl.IntegratedActionModelEuler(forward, 0.01), rng)
