"""MuJoCo's side of the conventions, against Pinocchio's own algorithms."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import ModelError, SolverError
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings


@pytest.fixture(params=["solo12", "zoo"])
def robot(request):
    return request.getfixturevalue(request.param)


def to_pinocchio(qacc, q, v):
    """MuJoCo's acceleration of a free-flying robot in Pinocchio's axes: d/dt (R^T v_world) = R^T a - omega x v."""
    a = qacc.copy()
    a[:3] = pin.Quaternion(q[3:7]).matrix().T @ a[:3] - np.cross(v[3:6], v[:3])
    return a


def force_on_base(model, data, wrench):
    """The joint-frame forces of a world-frame wrench at the base's centre of mass; needs the placements in data."""
    rotation, lever = data.oMi[1].rotation, model.inertias[1].lever
    local = rotation.T @ wrench[:3]
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    forces[1] = pin.Force(local, rotation.T @ wrench[3:] + np.cross(lever, local))
    return forces


def test_acceleration_of_free_states_is_pinocchios(robot, random_state):
    rng = np.random.default_rng(1)
    plant, model, data = MujocoPlant(robot), robot.model, robot.create_data()
    body = robot.body_names[0]
    assert model.armature[6:].min() > 0
    for _ in range(25):
        q, v = random_state(robot, rng)
        tau, wrench = rng.uniform(-1, 1, robot.nu) * robot.effort_limit, rng.uniform(-20, 20, 6)
        pin.forwardKinematics(model, data, q)
        expected = pin.aba(model, data, q, v, np.r_[np.zeros(6), tau], force_on_base(model, data, wrench))
        plant.reset(np.r_[q, v])
        plant.set_wrench(body, wrench)
        plant.step(tau)
        found = to_pinocchio(plant.data.qacc, q, v)
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_mass_matrix_is_pinocchios(robot, random_state):
    rng = np.random.default_rng(2)
    plant, model, data = MujocoPlant(robot), robot.model, robot.create_data()
    for _ in range(5):
        q, v = random_state(robot, rng)
        plant.reset(np.r_[q, v])
        mujoco.mj_forward(plant.model, plant.data)
        found = np.zeros((robot.nv, robot.nv))
        for row, unit in zip(found, np.eye(robot.nv), strict=True):  # mj_fullM has another signature before MuJoCo 4
            mujoco.mj_mulM(plant.model, plant.data, row, unit)
        turn = np.eye(robot.nv)
        turn[:3, :3] = pin.Quaternion(q[3:7]).matrix()
        expected = pin.crba(model, data, q)
        expected = np.triu(expected) + np.triu(expected, 1).T
        np.testing.assert_allclose(turn.T @ found @ turn, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_bodies_are_where_pinocchio_has_them(robot, random_state):
    q, v = random_state(robot, np.random.default_rng(3))
    plant, model, data = MujocoPlant(robot), robot.model, robot.create_data()
    plant.reset(np.r_[q, v])
    pin.forwardKinematics(model, data, q)
    for name in robot.body_names:
        joint = model.frames[robot.body_frame(name)].parentJoint
        centre = data.oMi[joint].act(model.inertias[joint].lever)
        np.testing.assert_allclose(plant.body_point(name), centre, rtol=0, atol=1e-13)
        np.testing.assert_allclose(plant.data.xmat[joint].reshape(3, 3), data.oMi[joint].rotation, rtol=0, atol=1e-13)


def test_state_comes_back_as_it_was_given(robot, random_state):
    q, v = random_state(robot, np.random.default_rng(4))
    plant = MujocoPlant(robot)
    plant.reset(np.r_[q, v])
    sample = plant.sense()
    np.testing.assert_allclose(sample.q, q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(sample.v, v, rtol=0, atol=1e-14)


def test_velocity_is_the_derivative_of_the_configuration(robot, random_state):
    q, v = random_state(robot, np.random.default_rng(5))
    dt = 1e-6
    plant = MujocoPlant(robot, PlantSettings(rate_hz=1.0 / dt))
    plant.reset(np.r_[q, v])
    plant.step(np.zeros(robot.nu))
    after = plant.sense()
    np.testing.assert_allclose(pin.difference(robot.model, q, after.q) / dt, after.v, rtol=0, atol=1e-4)


def test_a_joint_that_mujoco_lacks_is_refused_by_name(make_robot):
    model = pin.Model()
    model.name = "screw"
    joint = model.addJoint(0, pin.JointModelHZ(0.1), pin.SE3.Identity(), "lead_screw")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(ModelError, match="lead_screw"):
        MujocoPlant(make_robot(model, pin.neutral(model)))


def test_an_inertia_that_no_body_can_have_is_refused(make_robot):
    model = pin.Model()
    model.name = "impossible"
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 9.0])), pin.SE3.Identity())
    with pytest.raises(ModelError, match="impossible.*(?s:.*)inertia"):
        MujocoPlant(make_robot(model, pin.neutral(model)))


def test_divergence_is_raised_and_leaves_no_file(solo12, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    plant = MujocoPlant(solo12)
    x = solo12.x_reference.copy()
    x[-12:] = 1e9
    plant.reset(x)
    with pytest.raises(SolverError, match="timestep"):
        plant.step(np.zeros(12))
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_a_foot_that_touches_without_pressing_feels_no_force(solo12) -> None:
    """At a distance of exactly 0 MuJoCo lists a contact but gives it no rows: forces must not move to other feet."""
    plant = MujocoPlant(solo12, PlantSettings())
    q = solo12.q_reference.copy()
    found = 0
    for _ in range(200):
        plant.reset(np.concatenate([q, np.zeros(solo12.nv)]))
        plant.step(np.zeros(solo12.nu))
        touching = plant.data.contact.exclude != 0
        forces = plant.sense().contact_forces
        if touching.any():
            found += 1
            names = [plant.model.geom(geom).name for geom in plant.data.contact.geom[:, 1]]
            feet = np.array([solo12.contact_frames.index(name.removeprefix("foot ")) for name in names])
            assert not forces[feet[touching]].any()
            assert (forces[feet[~touching], 2] > 0.0).all()
        q[2] = np.nextafter(q[2], 1.0)
    assert found


def test_forces_on_the_feet_are_those_of_mujocos_contacts(solo12) -> None:
    """The sum of :func:`mujoco.mj_contactForce` over the contacts of each foot, turned to world axes."""
    plant = MujocoPlant(solo12, PlantSettings())
    plant.set_wrench(solo12.body_names[0], np.array([4.0, 3.0, 0.0, 0.0, 0.0, 0.3]))
    x = solo12.x_reference.copy()
    x[2] += 0.01  # falls, lands on all feet at different times, slides
    x[solo12.nq : solo12.nq + 3] = 0.3, -0.2, 0.0
    plant.reset(x)
    loaded = set()
    for _ in range(150):
        plant.step(np.zeros(solo12.nu))
        expected = np.zeros((solo12.nc, 3))
        for k, contact in enumerate(plant.data.contact):
            name = plant.model.geom(contact.geom[1]).name.removeprefix("foot ")
            if name in solo12.contact_frames:
                local = np.zeros(6)
                mujoco.mj_contactForce(plant.model, plant.data, k, local)
                expected[solo12.contact_frames.index(name)] += contact.frame.reshape(3, 3).T @ local[:3]
        np.testing.assert_allclose(plant.sense().contact_forces, expected, atol=1e-12)
        loaded.add(tuple((expected[:, 2] > 0.0).tolist()))
    assert len(loaded) > 2
