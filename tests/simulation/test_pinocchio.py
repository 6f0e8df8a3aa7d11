"""The contact laws of the Pinocchio plant, checked at every step of a push that slides and lifts feet; and falls."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import SolverError
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.pinocchio import PinocchioPlant

GRAVITY = 9.81
MU = 0.5


def contact_velocities(robot, q, v):
    """World velocity (nc, 3) of the feet's lowest points with the contacts frozen where q has them."""
    data = robot.create_data()
    pin.forwardKinematics(robot.model, data, q, v)
    pin.updateFramePlacements(robot.model, data)
    velocities = []
    for frame in robot.contact_ids:
        twist = pin.getFrameVelocity(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        velocities.append(twist.linear + np.cross(twist.angular, (0, 0, -robot.contact_radius)))
    heights = [data.oMf[frame].translation[2] - robot.contact_radius for frame in robot.contact_ids]
    return np.array(velocities), np.array(heights)


@pytest.fixture(scope="module")
def pushed(solo12):
    """Samples before and after every step of a push hard enough to slide and lift feet, and the applied wrench."""
    plant = PinocchioPlant(solo12, PlantSettings(friction=MU))
    target, steps = solo12.q_reference[7:], []
    for k in range(700):
        wrench = np.array([10.0, 14.0, 6.0, -0.8, 0.0, 0.2]) if 300 <= k < 500 else np.zeros(6)
        plant.set_wrench("base_link", wrench)
        before = plant.sense()
        point = plant.body_point("base_link")
        plant.step(8.0 * (target - before.q[7:]) - 0.2 * before.v[6:])
        steps.append((before, plant.sense(), wrench, point))
    assert plant.unsolved_steps == 0
    return steps


def test_signorini(solo12, pushed):
    """No foot pulls, none sinks in any further, and a foot that leaves has no force."""
    separated = 0
    for before, after, _, _ in pushed:
        velocities, heights = contact_velocities(solo12, before.q, after.v)
        normal = after.contact_forces[:, 2]
        assert normal.min() >= 0
        gap = heights + 1e-3 * velocities[:, 2]
        sunk = np.minimum(heights, 0)
        assert gap.min() > 0.8 * sunk.min() - 1e-9
        loaded = normal > 1e-3
        np.testing.assert_allclose(gap[loaded], 0.8 * sunk[loaded], rtol=0, atol=1e-9)
        separated += int((~loaded).sum())
    assert separated > 0


def test_coulomb(solo12, pushed):
    """Tangential force within the cone; on its surface and against the motion where a foot slides."""
    slides = {True: 0, False: 0}
    for before, after, _, _ in pushed:
        velocities, _ = contact_velocities(solo12, before.q, after.v)
        tangential, normal = after.contact_forces[:, :2], after.contact_forces[:, 2]
        assert (np.linalg.norm(tangential, axis=1) <= MU * normal + 1e-9).all()
        for slip, force, load in zip(velocities[:, :2], tangential, normal, strict=True):
            speed = np.linalg.norm(slip)
            slides[bool(speed > 1e-4)] += 1
            if speed > 1e-4 and load > 0.01:
                np.testing.assert_allclose(force, -MU * load * slip / speed, rtol=0, atol=2e-4)
    assert min(slides.values()) > 100


def test_momentum_balance(solo12, pushed):
    """A_G (v+ - v) / dt + A_G' v is gravity, push and contact forces: linear and angular."""
    model, data = solo12.model, solo12.create_data()
    weight = np.array([0, 0, -solo12.mass * GRAVITY])
    for before, after, wrench, point in pushed[::10]:
        drift = pin.dccrba(model, data, before.q, before.v) @ before.v
        rate = data.Ag @ (after.v - before.v) / 1e-3 + drift
        centre = pin.centerOfMass(model, data, before.q)
        pin.framesForwardKinematics(model, data, before.q)
        feet = np.array([data.oMf[i].translation for i in solo12.contact_ids]) - (0, 0, solo12.contact_radius) - centre
        force = weight + wrench[:3] + after.contact_forces.sum(axis=0)
        moment = np.cross(point - centre, wrench[:3]) + wrench[3:] + np.cross(feet, after.contact_forces).sum(axis=0)
        np.testing.assert_allclose(rate, np.r_[force, moment], rtol=0, atol=1e-8)


def test_free_motion_is_abas(zoo, random_state):
    rng = np.random.default_rng(1)
    plant, data = PinocchioPlant(zoo), zoo.create_data()
    for _ in range(5):
        q, v = random_state(zoo, rng)
        tau = rng.uniform(-1, 1, zoo.nu)
        plant.reset(np.r_[q, v])
        plant.step(tau)
        after = plant.sense()
        expected = pin.aba(zoo.model, data, q, v, np.r_[np.zeros(6), tau])
        np.testing.assert_allclose((after.v - v) / 1e-3, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(after.q, pin.integrate(zoo.model, q, 1e-3 * after.v), rtol=0, atol=1e-14)


def test_rest_stays_at_rest(block):
    plant = PinocchioPlant(block)
    for _ in range(1000):
        plant.step(np.zeros(0))
    sample = plant.sense()
    np.testing.assert_allclose(sample.q, block.q_reference, rtol=0, atol=1e-9)
    np.testing.assert_allclose(sample.contact_forces[:, 2].sum(), block.mass * GRAVITY, rtol=1e-6)


def test_penetration_goes_away_without_a_jump(block):
    plant = PinocchioPlant(block)
    x = block.x_reference.copy()
    x[2] -= 1e-3
    plant.reset(x)
    heights = []
    for _ in range(250):
        plant.step(np.zeros(0))
        heights.append(plant.sense().q[2] - block.q_reference[2])
    assert np.diff(heights).max() < 1e-5 + 1e-9  # 1 cm/s
    assert max(heights) < 1e-5
    assert abs(heights[-1]) < 1e-6


def test_a_dropped_block_does_not_bounce(block):
    plant = PinocchioPlant(block)
    x = block.x_reference.copy()
    x[2] += 0.05
    plant.reset(x)
    for _ in range(200):
        plant.step(np.zeros(0))
    assert plant.sense().q[2] == pytest.approx(block.q_reference[2], abs=1e-9)
    assert np.abs(plant.sense().v).max() < 1e-6


def test_a_limp_fall_only_loses_energy(solo12):
    plant = PinocchioPlant(solo12)
    model, data = solo12.model, solo12.create_data()

    def energy():
        sample = plant.sense()
        return pin.computeMechanicalEnergy(model, data, sample.q, sample.v)

    energies = [energy()]
    for _ in range(1000):
        plant.step(np.zeros(12))
        energies.append(energy())
    # Semi-implicit Euler gains a little in free motion, contacts never.
    assert np.diff(energies).max() < 1e-4
    assert energies[-1] < energies[0] - 3.0


def test_redundant_contacts_are_solved(solo12):
    """A limp robot on trunk, knees and feet has up to twelve contacts, whose forces are not unique."""
    plant = PinocchioPlant(solo12)
    for _ in range(1500):
        plant.step(np.zeros(12))
    assert plant.unsolved_steps <= 15  # one in a hundred
    assert np.abs(plant.sense().v).max() < 1e-3


def test_joint_friction_is_bounded_in_contact_too(solo12, hold):
    """Standing on stuck joints: friction takes over a share of the torque that the drives no longer give."""
    plant = PinocchioPlant(solo12, PlantSettings(joint_friction_nm=0.05))
    hold(plant, solo12, 1500)
    holding = plant.sense().tau
    start = plant.sense().q
    for _ in range(300):
        plant.step(holding * 0.95)
    assert 0.02 < np.abs(0.05 * holding).max() < 0.05  # what friction takes over
    assert np.abs(plant.sense().q[7:] - start[7:]).max() < 1e-3 * 0.3
    assert plant.unsolved_steps == 0


def test_divergence_is_raised(solo12):
    plant = PinocchioPlant(replace(solo12, given_shapes=()))
    x = solo12.x_reference.copy()
    x[-12:] = 1e9
    plant.reset(x)
    with pytest.raises(SolverError, match="timestep"):
        plant.step(np.zeros(12))
