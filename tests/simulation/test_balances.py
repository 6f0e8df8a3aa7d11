"""Momentum and energy of the simulated robot."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config import load_config
from lgmpc.config.robots import build_robot
from lgmpc.robot import Robot
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.parameters import PlantSettings, momentum_and_energy, simulated_model


def test_they_are_those_of_the_simulated_masses(solo12: Robot) -> None:
    settings = PlantSettings(mass_scale=1.2, base_added_mass_kg=0.5, base_com_offset_m=(0.02, 0.0, 0.01))
    model = simulated_model(solo12, settings)
    data = model.createData()
    rng = np.random.default_rng(4)
    v = rng.normal(size=(3, solo12.nv))
    q = np.array([pin.integrate(model, solo12.q_reference, 0.5 * rng.normal(size=solo12.nv)) for _ in range(3)])
    momentum, energy, weight = momentum_and_energy(solo12, settings, q, v)
    assert weight == pytest.approx([0.0, 0.0, -9.81 * (1.2 * solo12.mass + 0.5)])
    for i in range(3):
        pin.centerOfMass(model, data, q[i], v[i])
        mass = pin.computeTotalMass(model)
        assert momentum[i] == pytest.approx(mass * data.vcom[0])
        potential = mass * 9.81 * data.com[0][2]
        inertia = np.triu(pin.crba(model, data, q[i]))
        inertia += np.triu(inertia, 1).T
        assert inertia[6, 6] > solo12.armature[0]
        assert energy[i] == pytest.approx(potential + 0.5 * v[i] @ inertia @ v[i])


def test_a_robot_in_flight_keeps_its_energy_and_gains_momentum_by_its_weight(solo12: Robot) -> None:
    plant = MujocoPlant(solo12)
    x = solo12.x_reference.copy()
    x[2] += 2.0
    plant.reset(x)
    q, v = [], []
    for _ in range(200):
        sample = plant.sense()
        q.append(sample.q)
        v.append(sample.v)
        plant.step(np.zeros(12))
    momentum, energy, _ = momentum_and_energy(solo12, PlantSettings(), np.array(q), np.array(v))
    weight = solo12.mass * 9.81
    assert momentum[-1] == pytest.approx([0.0, 0.0, -weight * 199 * plant.dt], abs=1e-6 * weight)
    assert np.ptp(energy) < 2e-3 * weight  # the explicit step of 1 ms: g dt / 2 times the weight and the way


def test_the_energy_is_that_of_mujocos_own_mass_matrix() -> None:
    """ANYmal's rotors are large, and Pinocchio's own kinetic energy leaves out some of them."""
    config = load_config("anymal_velocity")
    robot = build_robot(config)
    plant = MujocoPlant(robot, config.plant)
    rng = np.random.default_rng(2)
    momentum = np.zeros(robot.nv)
    for _ in range(3):
        v = rng.normal(size=robot.nv)
        q = pin.integrate(robot.model, robot.q_reference, 0.3 * rng.normal(size=robot.nv))
        plant.reset(np.concatenate((q, v)))
        mujoco.mj_forward(plant.model, plant.data)
        velocity = plant.data.qvel
        mujoco.mj_mulM(plant.model, plant.data, momentum, velocity)
        potential = robot.mass * 9.81 * pin.centerOfMass(robot.model, robot.create_data(), q)[2]
        _, energy, _ = momentum_and_energy(robot, config.plant, q[None], v[None])
        assert energy[0] == pytest.approx(potential + 0.5 * velocity @ momentum, rel=1e-12)
