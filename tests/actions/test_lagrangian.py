"""Exact Hessians of stages against second differences of their values."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import (
    Action,
    Contact,
    ContactForwardDynamics,
    ContactInverseDynamics,
    FreeForwardDynamics,
    ImpulseAction,
    MultibodyAction,
    RungeKutta4,
    Variational,
)
from lgmpc.costs import ConstraintItem, CostItem, Huber
from lgmpc.costs.library import ContactForce, Control, FramePlacement, FrameTranslation, StateError
from lgmpc.ocp.functions import lagrangian_hessian, terminal_hessian
from lgmpc.state import State

KINDS = ["forward", "sliding", "inverse", "impulse", "free", "variational"]
CONTACTS = (Contact("sole"), Contact("heel", 6))


@lru_cache
def robot() -> pin.Model:
    """A free base with a leg of two joints."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    hip = model.addJoint(base, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.1, 0.0, -0.1])), "hip")
    knee = model.addJoint(hip, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, 0.05, -0.2])), "knee")
    for joint, mass in ((base, 2.0), (hip, 0.5), (knee, 0.3)):
        inertia = pin.Inertia(mass, np.array([0.01, -0.02, 0.03]), mass * np.diag([0.02, 0.03, 0.01]))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    for name, place in (("sole", [0.0, 0.0, -0.2]), ("heel", [-0.1, 0.0, -0.2])):
        model.addFrame(pin.Frame(name, knee, 0, pin.SE3(np.eye(3), np.array(place)), pin.FrameType.OP_FRAME))
    model.lowerPositionLimit[7:], model.upperPositionLimit[7:] = -3.0, 3.0
    return model


def costs(state: State, forces: bool) -> list[CostItem]:
    found = [
        CostItem("foot", FramePlacement("sole"), 0.5),
        CostItem("heel", FrameTranslation("heel", np.ones(3)), 0.7, Huber(0.5)),
    ]
    return [*found, CostItem("force", ContactForce("sole"), 1e-2)] if forces else found


@lru_cache
def action(kind: str) -> Action:
    model = robot()
    free = FreeForwardDynamics(model, np.eye(8)[:, 4:])
    high = [ConstraintItem("high", FrameTranslation("sole", np.zeros(3)), -1.0, 1.0)]
    if kind == "impulse":
        return ImpulseAction(kind, model, CONTACTS, costs(free.state, True), high)
    if kind == "sliding":  # one axis of the world, one that turns with the foot
        contact = Contact("sole", 2, axes=((0.0, 0.0, 1.0),), frame_axes=((0.0, 1.0, 0.0),))
        dynamics = ContactForwardDynamics(model, [contact])
        return MultibodyAction(kind, dynamics, costs(dynamics.state, False), high)
    if kind in ("forward", "inverse"):
        dynamics = (ContactForwardDynamics if kind == "forward" else ContactInverseDynamics)(model, CONTACTS)
        return MultibodyAction(kind, dynamics, costs(dynamics.state, True), high)
    integrator = {"free": None, "runge_kutta": RungeKutta4(), "variational": Variational(4)}[kind]
    items = [
        *costs(free.state, False),
        CostItem("x", StateError(free.state, free.state.neutral())),
        CostItem("u", Control(4)),
    ]
    return MultibodyAction(kind, free, items, high, integrator)


def second_differences(value, size: int, eps: float = 2e-4) -> np.ndarray:
    """Of fourth order: those of two widths, extrapolated."""
    here = value(np.zeros(size))

    def plain(h: float) -> np.ndarray:
        e, found = h * np.eye(size), np.zeros((size, size))
        alone = [value(step) + value(-step) - here for step in e]
        for i in range(size):
            for j in range(i + 1):
                both = value(e[i] + e[j]) + value(-e[i] - e[j])
                found[i, j] = (both - alone[i] - alone[j]) / (2 * h * h)
        return np.tril(found) + np.tril(found, -1).T

    return (4.0 * plain(eps) - plain(2.0 * eps)) / 3.0


@pytest.mark.parametrize("kind", [*KINDS, pytest.param("runge_kutta", marks=pytest.mark.slow)])
def test_exact_hessians_are_second_differences_of_the_lagrangian(kind: str) -> None:
    a, rng = action(kind), np.random.default_rng(3)
    state, ndx = a.state, a.state.ndx
    x = state.integrate(state.neutral(), rng.uniform(-0.4, 0.4, ndx))
    u, p = rng.uniform(-1.0, 1.0, a.nu), a.parameters.default.copy()
    for name in ("contact_points", "contact_gains", "contact_orientations"):
        if name in tuple(a.parameters):
            p[a.parameters[name]] = rng.uniform(0.2, 0.6, p[a.parameters[name]].size)
    if "contact_orientations" in tuple(a.parameters):
        p[a.parameters["contact_orientations"]] /= np.linalg.norm(p[a.parameters["contact_orientations"]])
    if "contact_damping" in tuple(a.parameters):  # both contacts are on one body
        p[a.parameters["contact_damping"]] = 0.3
    if "duration" in tuple(a.parameters):
        p[a.parameters["duration"]] = 0.1
    here = a.evaluate(x, u, p)
    x_next = state.integrate(here.x_next, rng.uniform(-0.2, 0.2, ndx))
    costate, multiplier = rng.uniform(-1.0, 1.0, ndx), rng.uniform(-1.0, 1.0, here.constraint.size)

    def lagrangian(d: np.ndarray) -> float:
        value = a.evaluate(state.integrate(x, d[:ndx]), u + d[ndx:], p)
        return value.cost + costate @ state.diff(x_next, value.x_next) + multiplier @ value.constraint

    found = np.asarray(lagrangian_hessian(a)(x, u, x_next, p, costate, multiplier)).reshape(ndx + a.nu, -1, order="F")
    expected = second_differences(lagrangian, ndx + a.nu)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * max(1.0, np.abs(expected).max()))
    assert np.abs(found - found.T).max() < 1e-11 * max(1.0, np.abs(found).max())


def test_terminal_hessians_are_second_differences_of_the_cost() -> None:
    a, rng = action("free"), np.random.default_rng(4)
    x = a.state.integrate(a.state.neutral(), rng.uniform(-0.4, 0.4, a.state.ndx))
    p = a.parameters.default
    expected = second_differences(lambda d: float(a.terminal_value_function(a.state.integrate(x, d), p)), a.state.ndx)
    found = terminal_hessian(a)(x, p).full()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
