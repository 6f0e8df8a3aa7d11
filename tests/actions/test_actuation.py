"""Actuation maps together with contacts, and controls that are saturated."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import ContactForwardDynamics, MultibodyAction, thrusters
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, check_derivatives


def walker() -> pin.Model:
    """A free base with two legs of two joints."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(base, pin.Inertia(3.0, np.array([0.02, 0.0, 0.01]), 0.05 * np.eye(3)), pin.SE3.Identity())
    for side, y in (("left", 0.1), ("right", -0.1)):
        hip = model.addJoint(base, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, y, 0.0])), f"{side}_hip")
        knee = model.addJoint(hip, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.3])), f"{side}_knee")
        for joint in (hip, knee):
            lever = np.array([0.0, 0.0, -0.15])
            model.appendBodyToJoint(joint, pin.Inertia(0.4, lever, 0.01 * np.eye(3)), pin.SE3.Identity())
        foot = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.3]))
        model.addFrame(pin.Frame(f"{side}_foot", knee, 0, foot, pin.FrameType.OP_FRAME))
    return model


def test_passive_joints_and_thrusters_act_with_contacts_as_pinocchio_computes() -> None:
    model, rng = walker(), np.random.default_rng(2)
    matrix = np.zeros((int(model.nv), 3))  # a thruster along the base's z axis; the right knee and the hips
    matrix[2, 0], matrix[6, 1], matrix[9, 2] = 1.0, 1.0, 1.0
    dynamics = ContactForwardDynamics(model, ["left_foot", "right_foot"], actuation=matrix)
    action = MultibodyAction("actuated", dynamics, [CostItem("effort", Control(3))])
    q, v, u = pin.randomConfiguration(model, -np.ones(11), np.ones(11)), rng.standard_normal(10), rng.standard_normal(3)
    q[3:7] /= np.linalg.norm(q[3:7])
    p = action.parameters.default.copy()
    p[action.parameters["contact_flags"]], h = [1.0, 0.0], 1e-3
    p[action.parameters["duration"]] = h
    found = (action.evaluate(np.concatenate([q, v]), u, p).x_next[11:] - v) / h
    data = model.createData()
    pin.computeAllTerms(model, data, q, v)
    pin.forwardKinematics(model, data, q, v, np.zeros(10))
    foot = model.getFrameId("left_foot")
    pin.updateFramePlacements(model, data)
    rows = pin.getFrameJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)[:3]
    drift = pin.getFrameClassicalAcceleration(model, data, foot, pin.LOCAL_WORLD_ALIGNED).linear
    system = np.block([[data.M, -rows.T], [rows, np.zeros((3, 3))]])
    expected = np.linalg.solve(system, np.concatenate([matrix @ u - data.nle, -drift]))[:10]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    problem = ShootingProblem(action, 2)
    problem.set_initial_state(np.concatenate([q, v]))
    assert check_derivatives(problem).passed


def test_matrices_that_do_not_fit_are_named() -> None:
    model = walker()
    for matrix in (np.eye(3), np.full((10, 2), np.nan)):
        with pytest.raises(InputError, match="actuation: got shape"):
            ContactForwardDynamics(model, ["left_foot"], actuation=matrix)
    with pytest.raises(InputError, match="model: got .*, whose base is fixed"):
        thrusters(pin.buildSampleModelManipulator(), [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
