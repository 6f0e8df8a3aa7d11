from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import FreeForwardDynamics, Integrator, MultibodyAction, RungeKutta4, SemiImplicitEuler, Variational
from lgmpc.ocp import check_derivatives


def body(gravity: bool = True) -> pin.Model:
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    inertia = pin.Inertia(1.5, np.array([0.1, 0.05, -0.02]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(root, inertia, pin.SE3.Identity())
    if not gravity:
        model.gravity = pin.Motion.Zero()
    return model


def limbed() -> pin.Model:
    """A free body with a limb of two joints, as heavy as half of it."""
    model = body()
    for name, joint, place in (("hip", pin.JointModelRX(), [0.1, 0.2, 0.0]), ("knee", pin.JointModelRY(), [0, 0.3, 0])):
        child = model.addJoint(model.njoints - 1, joint, pin.SE3(np.eye(3), np.array(place, dtype=float)), name)
        model.appendBodyToJoint(
            child, pin.Inertia(0.4, np.array([0.0, 0.1, -0.1]), 0.01 * np.eye(3)), pin.SE3.Identity()
        )
    return model


ROBOTS = {"body": body, "floating robot": limbed, "arm": pin.buildSampleModelManipulator}


def beginning(model: pin.Model) -> np.ndarray:
    """A moving state away from zero; START of a free body, and joints that turn."""
    free = 7 if model.names[1] == "root" else 0
    joints = model.nv - (6 if free else 0)
    angles, rates = np.linspace(-0.5, 0.5, joints), np.linspace(1.0, -1.0, joints)
    return np.concatenate([START[:free], angles, START[free:] if free else [], rates])


def action(integrator: Integrator, model: pin.Model) -> MultibodyAction:
    return MultibodyAction("body", FreeForwardDynamics(model, np.eye(model.nv)), integrator=integrator)


START = np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.0, 1.0, 0.5, -1.0, 0.3, 1.0, 2.0, -1.5])
WRENCH = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.1])


def end(a: MultibodyAction, start: np.ndarray, u: np.ndarray, steps: int, time: float = 0.4) -> np.ndarray:
    p = a.parameters.default.copy()
    p[a.parameters["duration"]] = time / steps
    x = start
    for _ in range(steps):
        x = a.value_function(x, u, p)[0].full().ravel()
    return x


@lru_cache
def flight(robot: str) -> tuple[pin.Model, np.ndarray, np.ndarray, np.ndarray]:
    """A model, its first state, its controls, and where a fine integration of these ends."""
    model = ROBOTS[robot]()
    start, u = beginning(model), np.zeros(model.nv)
    if robot != "arm":
        u[:6] = WRENCH
    return model, start, u, end(action(RungeKutta4(), model), start, u, 512)


@pytest.mark.parametrize(
    ("integrator", "order"),
    [(SemiImplicitEuler(), 1), (Variational(), 2), (RungeKutta4(), 4)],
    ids=lambda value: type(value).__name__,
)
@pytest.mark.parametrize("robot", ROBOTS)
def test_order_is_the_slope_of_the_error(integrator: Integrator, order: int, robot: str) -> None:
    model, start, u, truth = flight(robot)
    a = action(integrator, model)
    coarse, fine = (np.linalg.norm(a.state.diff(truth, end(a, start, u, n))) for n in (16, 32))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.2)


def test_variational_step_keeps_spatial_momentum_to_rounding_and_energy_without_drift() -> None:
    model = body(gravity=False)
    inertia = model.inertias[1].matrix()

    def momentum(x: np.ndarray) -> np.ndarray:
        placement = pin.XYZQUATToSE3(x[:7])
        return np.array(placement.act(pin.Force(inertia @ x[7:])).vector)

    def energy(x: np.ndarray) -> float:
        return float(x[7:] @ inertia @ x[7:]) / 2

    free = np.zeros(6)
    one = end(action(Variational(), model), START, free, 400, 20.0)
    np.testing.assert_allclose(momentum(one), momentum(START), rtol=0, atol=1e-11)
    assert energy(one) == pytest.approx(energy(START), rel=2e-3)
    euler = end(action(SemiImplicitEuler(), model), START, free, 400, 20.0)
    assert abs(energy(euler) / energy(START) - 1) > 2e-3  # another method fails the same test


@pytest.mark.parametrize(
    "integrator", [SemiImplicitEuler(), Variational(), RungeKutta4()], ids=lambda value: type(value).__name__
)
def test_derivatives(integrator: Integrator) -> None:
    a = action(integrator, body())
    p = a.parameters.default.copy()
    p[a.parameters["duration"]] = 0.1
    report = check_derivatives(a, np.random.default_rng(1), parameters=p, points=2, spread=1.0)
    assert report.passed, str(report)
