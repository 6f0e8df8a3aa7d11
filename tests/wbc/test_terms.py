"""The compiled terms against Pinocchio, at random states of several robots."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.wbc import WholeBodyTerms
from lgmpc.wbc.terms import _terms

NAMES = ("com", "momentum", "momentum_matrix", "momentum_drift", "locked_inertia", "rotation", "contact_points")


def expected_terms(robot, q, v):
    model, data = robot.model, robot.create_data()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    momentum_matrix = pin.ccrba(model, robot.create_data(), q, v)
    down = np.array([0.0, 0.0, -robot.contact_radius])
    twists = [pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in robot.contact_ids]
    return {
        "com": pin.centerOfMass(model, robot.create_data(), q),
        "momentum": pin.computeCentroidalMomentum(model, robot.create_data(), q, v).np,
        "momentum_matrix": momentum_matrix,
        "momentum_drift": pin.dccrba(model, robot.create_data(), q, v) @ v,
        "locked_inertia": momentum_matrix[3:, 3:6],
        "rotation": pin.Quaternion(q[3:7]).matrix(),
        "contact_points": np.array([data.oMf[frame].translation for frame in robot.contact_ids]) + down,
        "contact_velocities": np.array([m.linear + np.cross(m.angular, down) for m in twists]),
    }


def test_every_term_is_pinocchios_after_every_update(robot, random_state):
    """The attributes are views of memory that the compiled function writes to; taken once, they follow every update."""
    terms, rng = WholeBodyTerms(robot), np.random.default_rng(4)
    views = {name: getattr(terms, name) for name in (*NAMES, "contact_velocities")}
    for _ in range(10):
        q, v = random_state(rng, robot)
        terms.update(q, v)
        for name, expected in expected_terms(robot, q, v).items():
            scale = 1.0 + np.abs(expected).max()
            np.testing.assert_allclose(views[name], expected, atol=1e-13 * scale, rtol=1e-12, err_msg=name)
        np.testing.assert_array_equal(terms.q, q)
        np.testing.assert_array_equal(terms.v, v)


def test_momentum_rate_is_the_derivative_of_the_momentum(robot, random_state):
    terms, rng, h = WholeBodyTerms(robot), np.random.default_rng(5), 1e-5
    for _ in range(5):
        q, v = random_state(rng, robot)
        a = rng.normal(0, 5, robot.nv)
        terms.update(q, v)
        rate = terms.momentum_rate(a)
        ahead, behind = (
            pin.computeCentroidalMomentum(
                robot.model, robot.create_data(), pin.integrate(robot.model, q, t * v), v + t * a
            ).np
            for t in (h, -h)
        )
        np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), atol=1e-7 * robot.mass)


def test_interpreted_terms_are_the_compiled_ones(solo12, random_state, monkeypatch):
    q, v = random_state(np.random.default_rng(6), solo12)
    compiled = WholeBodyTerms(solo12)
    monkeypatch.setenv("LGMPC_JIT", "0")
    interpreted = WholeBodyTerms(solo12)
    assert not StageKernel(_terms(solo12)).compiled
    for terms in (compiled, interpreted):
        terms.update(q, v)
    for name in NAMES:
        np.testing.assert_allclose(getattr(interpreted, name), getattr(compiled, name), rtol=1e-12, atol=1e-14)


def test_robots_that_cannot_stand_are_refused(solo12):
    with pytest.raises(InputError, match="without contact frames.*expected a robot with contact frames"):
        WholeBodyTerms(dataclasses.replace(solo12, contact_frames=(), contact_ids=()))
    with pytest.raises(InputError, match="fixed base"):
        WholeBodyTerms(load_robot(RobotSpec(model="panda")))
