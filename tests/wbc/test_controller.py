import logging

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.wbc import (
    QpStatus,
    WholeBodyController,
    WholeBodyLimits,
    WholeBodyReference,
    WholeBodySettings,
    standing_tasks,
)


@pytest.fixture
def controller(solo12):
    return WholeBodyController(solo12, WholeBodySettings())


def at_rest(controller):
    robot = controller.robot
    return controller.sense(robot.q_reference, np.zeros(robot.nv))


def test_standing_torques_are_those_of_statics(solo12, standing):
    """At rest: the forces nearest to the reference ones that carry the weight, and the torques that transmit them."""
    controller = WholeBodyController(solo12, WholeBodySettings(tolerance=1e-9))
    at_rest(controller)
    standing.contact_forces[:, 2] *= (1.2, 0.9, 0.7, 1.1)  # not in equilibrium
    standing.contact_forces[:, 0] = 0.3, -0.1, 0.2, 0.1
    assert controller.solve(standing) is QpStatus.SOLVED
    model, data = solo12.model, solo12.create_data()
    gravity = pin.computeGeneralizedGravity(model, data, solo12.q_reference)
    jacobians = []
    for frame in solo12.contact_ids:
        j = pin.computeFrameJacobian(model, data, solo12.q_reference, frame, pin.LOCAL_WORLD_ALIGNED)
        jacobians.append(j[:3] - pin.skew(np.array([0, 0, -solo12.contact_radius])) @ j[3:])
    jacobian = np.vstack(jacobians)
    wished = standing.contact_forces.ravel()
    missing = gravity[:6] - jacobian[:, :6].T @ wished
    forces = wished + np.linalg.pinv(jacobian[:, :6].T) @ missing
    np.testing.assert_allclose(controller.forces.ravel(), forces, atol=1e-4)
    np.testing.assert_allclose(controller.tau, gravity[6:] - jacobian[:, 6:].T @ forces, atol=1e-5)
    np.testing.assert_allclose(controller.acceleration, 0.0, atol=1e-3)
    np.testing.assert_allclose(controller.forces.sum(axis=0), [0, 0, 9.81 * solo12.mass], atol=1e-4)


def test_an_external_wrench_is_carried_by_the_feet(solo12, controller, standing):
    at_rest(controller)
    standing.external_wrench[:] = 2.0, -3.0, 1.0, 0.1, 0.2, -0.1
    assert controller.solve(standing) is QpStatus.SOLVED
    lever = controller.terms.contact_points - controller.terms.com
    weight = [0, 0, 9.81 * solo12.mass]
    np.testing.assert_allclose(controller.forces.sum(axis=0), weight - standing.external_wrench[:3], atol=0.02)
    moment = np.cross(lever, controller.forces).sum(axis=0)
    np.testing.assert_allclose(moment, -standing.external_wrench[3:], atol=0.02)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf, 1e200])
def test_poisoned_states_keep_the_last_torques_until_it_passes(solo12, controller, standing, poison, caplog):
    at_rest(controller)
    controller.solve(standing)
    good = (controller.tau.copy(), controller.forces.copy(), controller.acceleration.copy())
    ticks = 0
    with caplog.at_level(logging.WARNING):
        for where in (0, 3, 8, solo12.nq + 1, solo12.nq + 9):
            x = solo12.x_reference.copy()
            x[where] = poison
            controller.sense(x[: solo12.nq], x[solo12.nq :])
            assert controller.solve(standing) is QpStatus.NOT_FINITE
            ticks += 1
            assert controller.failures == ticks
            assert controller.damping == 0.1
            for kept, now in zip(good, (controller.tau, controller.forces, controller.acceleration), strict=True):
                np.testing.assert_array_equal(now, kept)
    assert [record.getMessage() for record in caplog.records] == [
        "whole-body QP NOT_FINITE: last torques with joint damping until it solves again"
    ]
    at_rest(controller)
    assert controller.solve(standing) is QpStatus.SOLVED
    assert controller.damping == 0.0 and controller.failures == ticks
    np.testing.assert_allclose(controller.tau, good[0], atol=1e-4)


def test_every_burst_of_failures_is_told_once(controller, standing, caplog):
    at_rest(controller)
    with caplog.at_level(logging.WARNING):
        for bad in (True, True, False, True, True, True, False):
            standing.com[0] = np.nan if bad else controller.terms.com[0]
            controller.solve(standing)
    assert len(caplog.records) == 2 and controller.failures == 5


def test_a_nan_in_the_reference_is_a_failed_tick(controller, standing):
    at_rest(controller)
    for name in ("com", "com_acceleration", "base_rotation", "joint_velocity", "contact_forces", "external_wrench"):
        target = getattr(standing, name)
        kept = target.copy()
        target.flat[0] = np.nan
        assert controller.solve(standing) is QpStatus.NOT_FINITE, name
        target[...] = kept
        assert controller.solve(standing) is QpStatus.SOLVED, name


def test_contradictory_limits_end_in_a_named_status(solo12, standing):
    """Feet that must press with 500 N each have no torques to do it, and none may be made up."""
    limits = WholeBodyLimits(normal_force_min=500.0, normal_force_max=1000.0)
    controller = WholeBodyController(solo12, WholeBodySettings(limits=limits))
    at_rest(controller)
    for tick in range(3):
        assert controller.solve(standing) in (QpStatus.INFEASIBLE, QpStatus.MAX_ITERATIONS)
        assert controller.failures == tick + 1
    assert not controller.tau.any() and controller.damping > 0


def test_a_reference_beyond_all_reason_does_not_stall_a_tick(controller, standing):
    """1e20 is finite, so it reaches the solver; its steps are bounded, where they took 45 s at ProxQP's defaults."""
    at_rest(controller)
    standing.com[1] = 1e20
    assert controller.solve(standing) in (QpStatus.INFEASIBLE, QpStatus.MAX_ITERATIONS)
    assert controller._solver.iterations <= 200 * 11
    standing.com[1] = controller.terms.com[1]
    assert controller.solve(standing) is QpStatus.SOLVED


def commands(controller, states, reference):
    controller.reset()
    taken = []
    for q, v in states:
        controller.sense(q, v)
        assert controller.solve(reference) is QpStatus.SOLVED
        taken.append(np.concatenate([controller.tau, controller.forces.ravel(), controller.acceleration]))
    return np.array(taken)


def test_same_inputs_after_a_reset_give_the_same_bits(solo12, random_state, standing):
    rng = np.random.default_rng(40)
    states = [random_state(rng) for _ in range(20)]
    for q, v in states:
        q[:3], v[:] = solo12.q_reference[:3], 0.2 * v
    controller = WholeBodyController(solo12, WholeBodySettings())
    first = commands(controller, states, standing)
    np.testing.assert_array_equal(commands(controller, states, standing), first)
    kept = standing.com.copy()
    standing.com[0] = np.nan  # a failure in between leaves no trace either
    assert controller.solve(standing) is QpStatus.NOT_FINITE
    standing.com[:] = kept
    np.testing.assert_array_equal(commands(controller, states, standing), first)
    other = WholeBodyController(solo12, WholeBodySettings())
    np.testing.assert_array_equal(commands(other, states, standing), first)


def test_tasks_without_weight_are_left_out(solo12):
    def names(**weights):
        return [task.name for task in standing_tasks(solo12, WholeBodySettings(**weights))]

    assert names(angular_momentum_weight=0.0) == ["feet", "com", "base_orientation", "posture"]
    assert names(base_position_weight=1.0, angular_momentum_weight=1.0)[-2:] == ["base_position", "angular_momentum"]


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("angular_momentum_weight", -1.0),
        ("force_weight", np.nan),
        ("acceleration_weight", np.inf),
        ("tolerance", 0.0),
        ("max_iterations", 0),
        ("fallback_damping", -0.1),
    ],
)
def test_impossible_settings_are_refused(argument, value):
    with pytest.raises(InputError, match=f"^{argument}: got {value}"):
        WholeBodySettings(**{argument: value})


def closed_loop(robot, duration, push=(0.0, 0.0, 0.0)):
    """Stand on the MuJoCo plant, pushed from 0.5 s on for 0.2 s; returns samples and the largest tilt in degrees."""
    plant, controller = MujocoPlant(robot), WholeBodyController(robot, WholeBodySettings())
    plant.reset(robot.x_reference)
    samples, tilt = [], 0.0
    reference = None
    for tick in range(round(duration / plant.dt)):
        if tick in (500, 700):
            force = np.array(push) if tick == 500 else np.zeros(3)
            plant.set_wrench("base_link", np.concatenate([force, np.zeros(3)]))
        sample = plant.sense()
        samples.append(sample)
        terms = controller.sense(sample.q, sample.v)
        if reference is None:
            reference = WholeBodyReference.standing(robot, terms.com, terms.contact_points)
        assert controller.solve(reference) is QpStatus.SOLVED
        tilt = max(tilt, np.degrees(np.arccos(min(1.0, terms.rotation[2, 2]))))
        plant.step(controller.tau)
    return samples, tilt


def test_standing_does_not_drift(solo12):
    samples, tilt = closed_loop(solo12, 2.0)
    drift = np.array([s.q[:3] for s in samples]) - solo12.q_reference[:3]
    assert np.abs(drift).max() < 1e-3
    assert tilt < 0.1
    assert np.abs(samples[-1].v).max() < 1e-3


def test_a_lateral_push_is_survived(solo12):
    samples, tilt = closed_loop(solo12, 3.0, push=(0.0, 10.0, 0.0))  # 2 N.s
    aside = np.array([s.q[1] for s in samples])
    assert 0.005 < aside.max() < 0.05  # it was pushed, and held
    assert tilt < 5.0
    assert abs(aside[-1]) < 0.01 and np.abs(samples[-1].v).max() < 0.05
    assert max(np.abs(s.tau).max() for s in samples) <= 1.8
