import logging

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import load_robot
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.status import Status
from lgmpc.wbc import WholeBodyController, WholeBodySettings


def at_rest(controller):
    robot = controller.robot
    return controller.sense(robot.q_reference, np.zeros(robot.nv))


def test_standing_torques_are_those_of_statics(solo12):
    """At rest: the forces nearest to the target ones that carry the weight, and the torques that transmit them."""
    controller = WholeBodyController(solo12, WholeBodySettings(tolerance=1e-9))
    forces = controller.contacts.target_forces
    forces[:, 2] *= (1.2, 0.9, 0.7, 1.1)  # not in equilibrium
    forces[:, 0] = 0.3, -0.1, 0.2, 0.1
    assert controller.solve() is Status.CONVERGED
    model, data = solo12.model, solo12.create_data()
    gravity = pin.computeGeneralizedGravity(model, data, solo12.q_reference)
    jacobians = []
    for frame in solo12.contact_ids:
        j = pin.computeFrameJacobian(model, data, solo12.q_reference, frame, pin.LOCAL_WORLD_ALIGNED)
        jacobians.append(j[:3] - pin.skew(np.array([0, 0, -solo12.contact_radius])) @ j[3:])
    jacobian = np.vstack(jacobians)
    wished = forces.ravel()
    missing = gravity[:6] - jacobian[:, :6].T @ wished
    nearest = wished + np.linalg.pinv(jacobian[:, :6].T) @ missing
    np.testing.assert_allclose(controller.forces.ravel(), nearest, atol=1e-4)
    np.testing.assert_allclose(controller.tau, gravity[6:] - jacobian[:, 6:].T @ nearest, atol=1e-5)
    np.testing.assert_allclose(controller.acceleration, 0.0, atol=1e-3)
    np.testing.assert_allclose(controller.forces.sum(axis=0), [0, 0, 9.81 * solo12.mass], atol=1e-4)


def test_an_external_wrench_is_carried_by_the_feet(solo12, controller):
    controller.external_wrench[:] = 2.0, -3.0, 1.0, 0.1, 0.2, -0.1
    assert controller.solve() is Status.CONVERGED
    lever = controller.terms.contact_points - controller.terms.com
    weight = [0, 0, 9.81 * solo12.mass]
    np.testing.assert_allclose(controller.forces.sum(axis=0), weight - controller.external_wrench[:3], atol=0.02)
    moment = np.cross(lever, controller.forces).sum(axis=0)
    np.testing.assert_allclose(moment, -controller.external_wrench[3:], atol=0.02)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf, 1e200])
def test_poisoned_states_keep_the_last_torques_until_it_passes(solo12, controller, poison, caplog):
    controller.solve()
    good = (controller.tau.copy(), controller.forces.copy(), controller.acceleration.copy())
    ticks = 0
    with caplog.at_level(logging.WARNING):
        for where in (0, 3, 8, solo12.nq + 1, solo12.nq + 9):
            x = solo12.x_reference.copy()
            x[where] = poison
            controller.sense(x[: solo12.nq], x[solo12.nq :])
            assert controller.solve() is Status.NOT_FINITE
            ticks += 1
            assert controller.failures == ticks
            assert controller.damping == 0.1
            for kept, now in zip(good, (controller.tau, controller.forces, controller.acceleration), strict=True):
                np.testing.assert_array_equal(now, kept)
    assert [record.getMessage() for record in caplog.records] == [
        "whole-body QP NOT_FINITE: last torques with joint damping until it solves again"
    ]
    at_rest(controller)
    assert controller.solve() is Status.CONVERGED
    assert controller.damping == 0.0 and controller.failures == ticks
    np.testing.assert_allclose(controller.tau, good[0], atol=1e-4)


def test_every_burst_of_failures_is_logged_once(controller, caplog):
    with caplog.at_level(logging.WARNING):
        for bad in (True, True, False, True, True, True, False):
            controller.tasks["com"].target.position[0] = np.nan if bad else controller.terms.com[0]
            controller.solve()
    assert len(caplog.records) == 2 and controller.failures == 5


def test_a_nan_in_a_target_is_a_failed_tick(controller):
    controller.contacts.stance[0] = False
    inputs = [controller.contacts.target_forces, controller.external_wrench]
    names = [("com", "position"), ("com", "acceleration"), ("base_orientation", "rotation"), ("posture", "velocity")]
    names += [("swing", "position"), ("swing", "velocity"), ("angular_momentum", "rate")]
    inputs += [getattr(controller.tasks[task].target, target) for task, target in names]
    for buffer in inputs:
        kept = buffer.copy()
        buffer.flat[0] = np.nan
        assert controller.solve() is Status.NOT_FINITE
        buffer[...] = kept
        assert controller.solve() is Status.CONVERGED


def test_contradictory_limits_end_in_a_named_status(solo12):
    """Feet that must press with 500 N each have no torques to do it, and none may be made up."""
    controller = WholeBodyController(solo12, WholeBodySettings(normal_force_n=(500.0, 1000.0)))
    for tick in range(3):
        assert controller.solve() in (Status.INFEASIBLE, Status.ITERATION_LIMIT)
        assert controller.failures == tick + 1
    assert not controller.tau.any() and controller.damping > 0


def test_a_target_beyond_all_reason_does_not_stall_a_tick(controller):
    """1e20 is finite, so it reaches the solver; its steps are bounded, where they took 45 s at ProxQP's defaults."""
    controller.tasks["com"].target.position[1] = 1e20
    assert controller.solve() in (Status.INFEASIBLE, Status.ITERATION_LIMIT)
    assert controller.solver.iterations <= 200 * 11
    controller.tasks["com"].target.position[1] = controller.terms.com[1]
    assert controller.solve() is Status.CONVERGED


def commands(controller, states):
    controller.reset()
    taken = []
    for q, v in states:
        controller.sense(q, v)
        assert controller.solve() is Status.CONVERGED
        taken.append(np.concatenate([controller.tau, controller.forces.ravel(), controller.acceleration]))
    return np.array(taken)


def test_same_inputs_after_a_reset_give_the_same_bits(solo12, random_state):
    rng = np.random.default_rng(40)
    states = [random_state(rng, solo12) for _ in range(20)]
    for q, v in states:
        q[:3], v[:] = solo12.q_reference[:3], 0.2 * v
    controller = WholeBodyController(solo12, WholeBodySettings())
    first = commands(controller, states)
    np.testing.assert_array_equal(commands(controller, states), first)
    target = controller.tasks["com"].target.position
    kept = target.copy()
    target[0] = np.nan  # a failure in between leaves no trace either
    assert controller.solve() is Status.NOT_FINITE
    target[:] = kept
    np.testing.assert_array_equal(commands(controller, states), first)
    other = WholeBodyController(solo12, WholeBodySettings())
    np.testing.assert_array_equal(commands(other, states), first)


def test_stepping_replaces_weights_and_standing_restores_them(controller):
    weights = {name: task.weight.copy() for name, task in controller.tasks.items()}
    stepping = controller.settings.scaled(controller.robot).stepping_weights
    controller.use_stepping_weights(stepping=True)
    for name in ("com", "base_orientation", "angular_momentum", "posture"):
        np.testing.assert_array_equal(
            controller.tasks[name].weight, np.broadcast_to(getattr(stepping, name), weights[name].shape)
        )
        assert (controller.tasks[name].weight != weights[name]).any()
    for name in ("stance", "swing", "base_position"):
        np.testing.assert_array_equal(controller.tasks[name].weight, weights[name])
    controller.use_stepping_weights(stepping=False)
    for name, task in controller.tasks.items():
        np.testing.assert_array_equal(task.weight, weights[name])


def test_after_a_failed_tick_the_solver_starts_anew(controller):
    """As at the first tick: with torques at their limits, so that ProxQP is called, and its warm start counts."""
    acceleration = controller.tasks["com"].target.acceleration
    acceleration[2] = 200.0
    assert controller.solve() is Status.CONVERGED
    first = controller.tau.copy()
    acceleration[0] = 100.0
    assert controller.solve() is Status.CONVERGED
    acceleration[0] = 0.0
    controller.external_wrench[0] = np.nan
    assert controller.solve() is Status.NOT_FINITE
    controller.external_wrench[0] = 0.0
    assert controller.solve() is Status.CONVERGED
    np.testing.assert_array_equal(controller.tau, first)


def closed_loop(robot, duration, push=(0.0, 0.0, 0.0)):
    """Stand on the MuJoCo plant, pushed from 0.5 s on for 0.2 s; returns samples and the largest tilt in degrees."""
    plant, controller = MujocoPlant(robot), WholeBodyController(robot, WholeBodySettings())
    plant.reset(robot.x_reference)
    samples, tilt = [], 0.0
    for tick in range(round(duration / plant.dt)):
        if tick in (500, 700):
            force = np.array(push) if tick == 500 else np.zeros(3)
            plant.set_wrench("base_link", np.concatenate([force, np.zeros(3)]))
        sample = plant.sense()
        samples.append(sample)
        terms = controller.sense(sample.q, sample.v)
        if tick == 0:
            controller.stand()
        assert controller.solve() is Status.CONVERGED
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


def test_known_joint_friction_is_supplied_on_top_within_the_torque_limits(solo12, solo12_spec):
    """The same accelerations and forces as without friction; the torques differ by it, in closed form."""
    rough = load_robot(solo12_spec.replace({"joint_friction_nm": {"*_KFE": 0.1, "*_HFE": 0.05}}))
    rates = 0.2 * np.random.default_rng(5).normal(size=solo12.nu)
    v = np.concatenate([np.zeros(6), rates])
    smooth, compensating = (WholeBodyController(robot, WholeBodySettings(tolerance=1e-9)) for robot in (solo12, rough))
    for controller in (smooth, compensating):
        controller.sense(solo12.q_reference, v)
        assert controller.solve() is Status.CONVERGED
    friction = np.tile([0.0, 0.05, 0.1], 4)
    np.testing.assert_allclose(compensating.tau - smooth.tau, friction * np.tanh(rates / 0.1), atol=1e-6)
    np.testing.assert_allclose(compensating.acceleration, smooth.acceleration, atol=1e-4)
    for controller in (smooth, compensating):
        controller.tasks["com"].target.acceleration[2] = 200.0
        assert controller.solve() is Status.CONVERGED
        assert np.abs(controller.tau).max() == pytest.approx(1.8, abs=1e-3)  # the limit binds, friction included
