"""Two engines, one robot: what MuJoCo's soft and Pinocchio's rigid contacts must agree on."""

import numpy as np
import pytest

from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant


@pytest.fixture(
    params=[{}, {"joint_friction_nm": 0.05, "joint_damping_nms": 0.01, "mass_scale": 1.1}], ids=["plain", "other"]
)
def plants(request, solo12):
    params = PlantSettings(**request.param)
    return MujocoPlant(solo12, params), PinocchioPlant(solo12, params)


def test_free_motion_agrees(zoo, random_state):
    """100 steps of a tumbling tree: joints and orientation by the same rule, the base's path to first order in dt.

    Pinocchio moves the base along a screw, MuJoCo along a straight line.
    """
    q, v = random_state(zoo, np.random.default_rng(6))
    params = PlantSettings(joint_damping_nms=0.1)
    samples = []
    for plant in (MujocoPlant(zoo, params), PinocchioPlant(zoo, params)):
        plant.reset(np.r_[q, v])
        for _ in range(100):
            plant.step(np.full(zoo.nu, 0.1))
        samples.append(plant.sense())
    np.testing.assert_allclose(samples[0].q[3:], samples[1].q[3:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(samples[0].v[3:], samples[1].v[3:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(samples[0].q[:3], samples[1].q[:3], rtol=0, atol=2e-4)
    np.testing.assert_allclose(samples[0].v[:3], samples[1].v[:3], rtol=0, atol=5e-3)


def test_standing_agrees(plants, solo12, hold):
    """Contact forces to 0.3 N (vertical 0.05 N) of 6, base to 0.3 mm after a second under impedance."""
    for plant in plants:
        hold(plant, solo12, 1000)
    soft, rigid = (plant.sense() for plant in plants)
    np.testing.assert_allclose(soft.contact_forces, rigid.contact_forces, rtol=0, atol=0.3)
    np.testing.assert_allclose(soft.contact_forces[:, 2], rigid.contact_forces[:, 2], rtol=0, atol=0.05)
    np.testing.assert_allclose(soft.q[:3], rigid.q[:3], rtol=0, atol=3e-4)


def test_push_response_agrees(plants, solo12, hold):
    """A sideways push of 0.8 N.s: path of the base within 0.5 mm, vertical forces within 0.5 N of 9."""
    paths, forces = [], []
    for plant in plants:
        hold(plant, solo12, 500)
        plant.set_wrench("base_link", np.array([0.0, 4.0, 0, 0, 0, 0]))
        path = []
        for _ in range(20):
            hold(plant, solo12, 10)
            path.append(plant.sense().q[:3])
        paths.append(np.array(path))
        forces.append(plant.sense().contact_forces)
    assert np.ptp(paths[0][:, 1]) > 0.004
    np.testing.assert_allclose(paths[0], paths[1], rtol=0, atol=5e-4)
    np.testing.assert_allclose(forces[0][:, 2], forces[1][:, 2], rtol=0, atol=0.5)
