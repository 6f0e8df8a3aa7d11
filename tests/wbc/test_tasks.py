"""Every task against its own definition, differentiated numerically along q(t) with q'(0) = v, q''(0) = a."""

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.wbc import Gain, TaskStack, WholeBodyReference, WholeBodyTerms
from lgmpc.wbc.tasks import AngularMomentumTask, BaseOrientationTask, BasePositionTask, ComTask, FootTask, PostureTask

H = 1e-4
NONE = Gain(0.0, 0.0)
STIFF = Gain(400.0, 40.0)


def zero_reference(robot, stance=True):
    nc = robot.nc
    reference = WholeBodyReference.standing(robot, np.zeros(3), np.zeros((nc, 3)))
    reference.stance[:] = stance
    return reference


def single(robot, task):
    return TaskStack([task], robot.nv)


def com(robot, q, v):
    return pin.centerOfMass(robot.model, robot.create_data(), q)


def base(robot, q, v):
    return q[:3]


def joints(robot, q, v):
    return q[7:]


def lowest_points(robot, q, v):
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    return np.concatenate([data.oMf[i].translation - [0, 0, robot.contact_radius] for i in robot.contact_ids])


def rolling_velocity(robot, q, v):
    data = robot.create_data()
    pin.forwardKinematics(robot.model, data, q, v)
    twists = [pin.getFrameVelocity(robot.model, data, i, pin.LOCAL_WORLD_ALIGNED) for i in robot.contact_ids]
    return np.concatenate([m.linear + np.cross(m.angular, [0, 0, -robot.contact_radius]) for m in twists])


def angular_momentum(robot, q, v):
    return pin.computeCentroidalMomentum(robot.model, robot.create_data(), q, v).angular


# name: task with zero gains, what it tracks, how often that is differentiated to give the acceleration, stance
TASKS = {
    "com": (lambda r: ComTask(r, NONE, 1.0), com, 2, True),
    "base_position": (lambda r: BasePositionTask(r, NONE, 1.0), base, 2, True),
    "posture": (lambda r: PostureTask(r, NONE, 1.0), joints, 2, True),
    "swing feet": (lambda r: FootTask(r, 0.0, NONE, 1.0, 1.0), lowest_points, 2, False),
    "stance feet": (lambda r: FootTask(r, 0.0, NONE, 1.0, 1.0), rolling_velocity, 1, True),
    "angular_momentum": (lambda r: AngularMomentumTask(r, 0.0, 1.0), angular_momentum, 1, True),
}


def numerical_acceleration(robot, quantity, order, q, v, a):
    def at(t):
        return quantity(robot, pin.integrate(robot.model, q, t * v + 0.5 * t**2 * a), v + t * a)

    if order == 1:
        return (at(H) - at(-H)) / (2 * H)
    return (at(H) - 2 * at(0.0) + at(-H)) / H**2


@pytest.mark.parametrize("name", TASKS)
def test_without_gains_the_residual_is_the_task_acceleration(solo12, random_state, name):
    make, quantity, order, stance = TASKS[name]
    stack, terms, reference = single(solo12, make(solo12)), WholeBodyTerms(solo12), zero_reference(solo12, stance)
    rng = np.random.default_rng(10)
    for _ in range(10):
        q, v = random_state(rng)
        a = rng.normal(0, 5, solo12.nv)
        terms.update(q, v)
        stack.update(terms, reference)
        expected = numerical_acceleration(solo12, quantity, order, q, v, a)
        np.testing.assert_allclose(stack.jacobian @ a - stack.rhs, expected, atol=3e-5)


@pytest.mark.parametrize("name", ["com", "angular_momentum", "swing feet"])
def test_feed_forward_is_what_the_task_asks_for(solo12, random_state, name):
    make, _, _, stance = TASKS[name]
    stack, terms, reference = single(solo12, make(solo12)), WholeBodyTerms(solo12), zero_reference(solo12, stance)
    terms.update(*random_state(np.random.default_rng(11)))
    stack.update(terms, reference)
    without = stack.rhs.copy()
    wish = np.random.default_rng(12).normal(size=stack.rhs.size)
    reference.com_acceleration[:] = wish[:3]
    reference.angular_momentum_rate[:] = wish[:3]
    reference.foot_acceleration[:] = np.resize(wish, (4, 3))
    stack.update(terms, reference)
    np.testing.assert_allclose(stack.rhs - without, wish, atol=1e-12)


def test_orientation_residual_is_the_body_angular_acceleration(solo12, random_state):
    stack, terms = single(solo12, BaseOrientationTask(solo12, NONE, 1.0)), WholeBodyTerms(solo12)
    rng = np.random.default_rng(13)
    q, v = random_state(rng)
    a = rng.normal(0, 5, solo12.nv)
    terms.update(q, v)
    stack.update(terms, zero_reference(solo12))

    def turned(t):
        ahead = pin.integrate(solo12.model, q, t * v + 0.5 * t**2 * a)
        return pin.log3(terms.rotation.T @ pin.Quaternion(ahead[3:7]).matrix())

    np.testing.assert_allclose(stack.jacobian @ a - stack.rhs, (turned(H) + turned(-H)) / H**2, atol=1e-5)


@pytest.mark.parametrize("angle", [0.3, 2.0, np.pi - 0.1, np.pi - 1e-6])
def test_orientation_feedback_turns_the_base_to_its_target(solo12, angle):
    """Integrate omega' = rhs: the error has to decay as (1 + 20 t) exp(-20 t), the critically damped double pole."""
    stack, terms, reference = (
        single(solo12, BaseOrientationTask(solo12, STIFF, 1.0)),
        WholeBodyTerms(solo12),
        zero_reference(solo12),
    )
    axis = np.array([0.6, -0.64, 0.48])
    reference.base_rotation[:] = pin.exp3(angle * axis)
    q, v, dt = solo12.q_reference.copy(), np.zeros(solo12.nv), 1e-3
    errors = []
    for _ in range(600):
        terms.update(q, v)
        stack.update(terms, reference)
        errors.append(np.linalg.norm(pin.log3(terms.rotation.T @ reference.base_rotation)))
        v[3:6] += dt * stack.rhs
        q = pin.integrate(solo12.model, q, dt * v)
    t = dt * np.arange(600)
    np.testing.assert_allclose(errors, angle * (1 + 20 * t) * np.exp(-20 * t), atol=0.02 * angle)
    assert np.all(np.diff(errors) <= 1e-9) and errors[-1] < 1e-3


def test_orientation_feedback_follows_a_turning_target(solo12):
    stack, terms, reference = (
        single(solo12, BaseOrientationTask(solo12, STIFF, 1.0)),
        WholeBodyTerms(solo12),
        zero_reference(solo12),
    )
    rate, dt = np.array([0.5, -1.0, 2.0]), 1e-3
    reference.base_rotation[:] = pin.exp3(np.array([0.4, 0.2, -0.3]))
    reference.base_angular_velocity[:] = rate
    q, v = solo12.q_reference.copy(), np.zeros(solo12.nv)
    for _ in range(1000):
        terms.update(q, v)
        stack.update(terms, reference)
        v[3:6] += dt * stack.rhs
        q = pin.integrate(solo12.model, q, dt * v)
        reference.base_rotation[:] = reference.base_rotation @ pin.exp3(dt * rate)
    np.testing.assert_allclose(pin.Quaternion(q[3:7]).matrix(), reference.base_rotation, atol=1e-3)
    np.testing.assert_allclose(v[3:6], rate, atol=1e-3)


def test_position_feedback_points_to_the_target_and_damps(solo12, random_state):
    """kp multiplies target minus position, kd target rate minus rate, for all tasks that have both."""
    gain, rng = Gain(3.0, 7.0), np.random.default_rng(14)
    terms = WholeBodyTerms(solo12)
    q, v = random_state(rng)
    terms.update(q, v)
    made = {
        "com": (lambda g: ComTask(solo12, g, 1.0), com, ("com", "com_velocity"), True),
        "base": (lambda g: BasePositionTask(solo12, g, 1.0), base, ("base_position", "base_velocity"), True),
        "posture": (lambda g: PostureTask(solo12, g, 1.0), joints, ("joint_position", "joint_velocity"), True),
        "feet": (lambda g: FootTask(solo12, 0, g, 1, 1), lowest_points, ("foot_position", "foot_velocity"), False),
    }
    for name, (make, quantity, (position, velocity), stance) in made.items():
        reference = zero_reference(solo12, stance)
        target, target_rate = getattr(reference, position), getattr(reference, velocity)
        target[...] = rng.normal(size=target.shape)
        target_rate[...] = rng.normal(size=target.shape)
        free, fed = single(solo12, make(NONE)), single(solo12, make(gain))
        free.update(terms, reference)
        fed.update(terms, reference)
        rate = (
            quantity(solo12, pin.integrate(solo12.model, q, H * v), v)
            - quantity(solo12, pin.integrate(solo12.model, q, -H * v), v)
        ) / (2 * H)
        expected = 3.0 * (target.ravel() - quantity(solo12, q, v)) + 7.0 * (target_rate.ravel() - rate)
        np.testing.assert_allclose(fed.rhs - free.rhs, expected, atol=1e-5, err_msg=name)


def test_angular_momentum_feedback(solo12, random_state):
    terms, reference = WholeBodyTerms(solo12), zero_reference(solo12)
    q, v = random_state(np.random.default_rng(15))
    terms.update(q, v)
    reference.angular_momentum[:] = 0.1, -0.2, 0.3
    free, fed = (
        single(solo12, AngularMomentumTask(solo12, 0.0, 1.0)),
        single(solo12, AngularMomentumTask(solo12, 8.0, 1.0)),
    )
    free.update(terms, reference)
    fed.update(terms, reference)
    expected = 8.0 * (reference.angular_momentum - angular_momentum(solo12, q, v))
    np.testing.assert_allclose(fed.rhs - free.rhs, expected, atol=1e-12)


def test_feet_switch_between_stance_and_swing_and_back(solo12, random_state):
    task = FootTask(solo12, 20.0, STIFF, 1e3, 10.0)
    stack, terms, reference = single(solo12, task), WholeBodyTerms(solo12), zero_reference(solo12)
    q, v = random_state(np.random.default_rng(16))
    terms.update(q, v)
    reference.foot_position[:] = terms.contact_points + 0.1
    stack.update(terms, reference)
    all_stance = (stack.jacobian.copy(), stack.rhs.copy(), stack.weight.copy())
    np.testing.assert_allclose(stack.rhs, -20.0 * rolling_velocity(solo12, q, v) - terms.contact_drift, atol=1e-12)
    reference.stance[1] = False
    stack.update(terms, reference)
    swing = np.repeat([False, True, False, False], 3)
    np.testing.assert_array_equal(stack.weight, np.where(swing, 10.0, 1e3))
    np.testing.assert_array_equal(stack.rhs[~swing], all_stance[1][~swing])
    jacobian, drift = terms.foot_centre(1)
    np.testing.assert_allclose(stack.rhs[swing], 400 * 0.1 - 40 * jacobian @ v - drift, rtol=1e-12)
    reference.foot_position[1] = np.nan  # what a target was in the air is nothing to a foot that stands
    stack.update(terms, reference)
    reference.stance[1] = True
    stack.update(terms, reference)
    for now, before in zip((stack.jacobian, stack.rhs, stack.weight), all_stance, strict=True):
        np.testing.assert_array_equal(now, before)


def test_stack_puts_every_task_in_its_own_rows(solo12, random_state):
    makers = [lambda: ComTask(solo12, STIFF, (1, 2, 3)), lambda: PostureTask(solo12, STIFF, 0.5)]
    terms, reference = WholeBodyTerms(solo12), zero_reference(solo12)
    terms.update(*random_state(np.random.default_rng(17)))
    together = TaskStack([make() for make in makers], solo12.nv)
    together.update(terms, reference)
    alone = [single(solo12, make()) for make in makers]
    for stack in alone:
        stack.update(terms, reference)
    for name in ("jacobian", "rhs", "weight"):
        np.testing.assert_array_equal(getattr(together, name), np.concatenate([getattr(s, name) for s in alone]))
    np.testing.assert_array_equal(together.weight, [1, 2, 3] + 12 * [0.5])


def test_gain_for_a_wanted_damping():
    assert Gain.critically_damped(100.0) == Gain(100.0, 20.0)
    assert Gain.critically_damped(100.0, 0.7).kd == pytest.approx(14.0)


@pytest.mark.parametrize(
    ("gain", "weight", "message"),
    [
        (STIFF, -1.0, "weight of task 'com': got -1.0; expected finite, not negative"),
        (STIFF, float("nan"), "weight of task 'com'"),
        (STIFF, (1.0, 2.0), r"weight of task 'com': got \(1.0, 2.0\); expected one number or 3"),
        (Gain(-5.0, 1.0), 1.0, "kp of task 'com': got -5.0"),
        (Gain(5.0, (1.0, float("inf"), 1.0)), 1.0, "kd of task 'com'"),
    ],
)
def test_bad_gains_and_weights_are_refused(solo12, gain, weight, message):
    with pytest.raises(InputError, match=message):
        ComTask(solo12, gain, weight)
