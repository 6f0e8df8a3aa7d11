"""Every task against its own definition, differentiated numerically along q(t) with q'(0) = v, q''(0) = a."""

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.robot import leg_normals
from lgmpc.wbc import Gain, SymbolicTask, WholeBodyController, WholeBodySettings, standard_tasks
from lgmpc.wbc.library import (
    AngularMomentumTask,
    BaseOrientationTask,
    BasePositionTask,
    ComTask,
    PostureTask,
    StanceTask,
    SwingTask,
    UpperBodyTask,
)
from tests.support.samples import b1_with_arm, solo8

H = 1e-4
NONE = Gain(kp=0.0)
STIFF = Gain(kp=400.0, kd=40.0)
UNEVEN = Gain(kp=3.0, kd=7.0)


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


# name: task of a gain, what it tracks, how often that is differentiated to give the acceleration, stance
TASKS = {
    "com": (lambda r, g: ComTask(g, 1.0), com, 2, True),
    "base_position": (lambda r, g: BasePositionTask(g, 1.0), base, 2, True),
    "posture": (lambda r, g: PostureTask(r, g, 1.0), joints, 2, True),
    "swing": (lambda r, g: SwingTask(r, g, 1.0), lowest_points, 2, False),
    "stance": (lambda r, g: StanceTask(r, g, 1.0), rolling_velocity, 1, True),
    "angular_momentum": (lambda r, g: AngularMomentumTask(g, 1.0), angular_momentum, 1, True),
}


def planes(robot, name, q):
    """What a task has of its quantity: of the feet of planar legs, such as the stilts' second, only what is within."""
    if name != "swing":
        return 1.0
    within = np.eye(3 * robot.nc)
    for foot, normal in enumerate(leg_normals(robot) @ pin.Quaternion(q[3:7]).matrix().T):
        within[3 * foot : 3 * foot + 3, 3 * foot : 3 * foot + 3] -= np.outer(normal, normal)
    return within


def rate_of(robot, quantity, q, v, a):
    ahead, behind = (quantity(robot, pin.integrate(robot.model, q, t * v), v + t * a) for t in (H, -H))
    return (ahead - behind) / (2 * H)


def numerical_acceleration(robot, quantity, order, q, v, a):
    def at(t):
        return quantity(robot, pin.integrate(robot.model, q, t * v + 0.5 * t**2 * a), v + t * a)

    if order == 1:
        return (at(H) - at(-H)) / (2 * H)
    return (at(H) - 2 * at(0.0) + at(-H)) / H**2


@pytest.mark.parametrize("name", TASKS)
def test_without_gains_the_residual_is_the_task_acceleration(robot, random_state, rows_of, name):
    make, quantity, order, stance = TASKS[name]
    rows, rng = rows_of(robot, make(robot, NONE)), np.random.default_rng(10)
    for _ in range(5):
        q, v = random_state(rng, robot)
        a = rng.normal(0, 5, robot.nv)
        jacobian, rhs, _ = rows(q, v, stance)
        expected = np.dot(planes(robot, name, q), numerical_acceleration(robot, quantity, order, q, v, a))
        np.testing.assert_allclose(jacobian @ a - rhs, expected, atol=3e-5 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("name", ["com", "base_position", "posture", "swing", "angular_momentum"])
def test_the_feed_forward_adds_to_the_right_hand_side(solo12, random_state, rows_of, name):
    make, _, _, stance = TASKS[name]
    task = make(solo12, STIFF)
    rows, state = rows_of(solo12, task), random_state(np.random.default_rng(11), solo12)
    _, without, _ = rows(*state, stance)
    wish = np.random.default_rng(12).normal(size=task.dim)
    buffer = task.target.rate if name == "angular_momentum" else task.target.acceleration
    buffer[...] = wish.reshape(buffer.shape)
    _, rhs, _ = rows(*state, stance)
    np.testing.assert_allclose(rhs - without, wish, atol=1e-10)


def test_orientation_residual_is_the_body_angular_acceleration(solo12, random_state, rows_of):
    rows, rng = rows_of(solo12, BaseOrientationTask(NONE, 1.0)), np.random.default_rng(13)
    q, v = random_state(rng, solo12)
    a = rng.normal(0, 5, solo12.nv)
    jacobian, rhs, _ = rows(q, v)
    rotation = pin.Quaternion(q[3:7]).matrix()

    def turned(t):
        ahead = pin.integrate(solo12.model, q, t * v + 0.5 * t**2 * a)
        return pin.log3(rotation.T @ pin.Quaternion(ahead[3:7]).matrix())

    np.testing.assert_allclose(jacobian @ a - rhs, (turned(H) + turned(-H)) / H**2, atol=1e-5)


@pytest.mark.parametrize("angle", [0.3, 2.0, np.pi - 0.1, np.pi - 1e-6])
def test_orientation_feedback_turns_the_base_to_its_target(solo12, rows_of, angle):
    """Integrate omega' = rhs: the error has to decay as (1 + 20 t) exp(-20 t), the critically damped double pole."""
    task = BaseOrientationTask(STIFF, 1.0)
    rows = rows_of(solo12, task)
    task.target.rotation[:] = pin.exp3(angle * np.array([0.6, -0.64, 0.48]))
    q, v, dt = solo12.q_reference.copy(), np.zeros(solo12.nv), 1e-3
    errors = []
    for _ in range(600):
        errors.append(np.linalg.norm(pin.log3(pin.Quaternion(q[3:7]).matrix().T @ task.target.rotation)))
        v[3:6] += dt * rows(q, v)[1]
        q = pin.integrate(solo12.model, q, dt * v)
    t = dt * np.arange(600)
    np.testing.assert_allclose(errors, angle * (1 + 20 * t) * np.exp(-20 * t), atol=0.02 * angle)
    assert np.all(np.diff(errors) <= 1e-9) and errors[-1] < 1e-3


def test_orientation_feedback_follows_a_turning_target(solo12, rows_of):
    task = BaseOrientationTask(STIFF, 1.0)
    rows, target = rows_of(solo12, task), task.target
    rate, dt = np.array([0.5, -1.0, 2.0]), 1e-3
    target.rotation[:] = pin.exp3(np.array([0.4, 0.2, -0.3]))
    target.angular_velocity[:] = rate
    q, v = solo12.q_reference.copy(), np.zeros(solo12.nv)
    for _ in range(1000):
        v[3:6] += dt * rows(q, v)[1]
        q = pin.integrate(solo12.model, q, dt * v)
        target.rotation[:] = target.rotation @ pin.exp3(dt * rate)
    np.testing.assert_allclose(pin.Quaternion(q[3:7]).matrix(), target.rotation, atol=1e-3)
    np.testing.assert_allclose(v[3:6], rate, atol=1e-3)


def test_orientation_damping_acts_on_the_difference_of_the_angular_velocities(solo12, random_state, rows_of):
    """In world axes, where a base and a target that are turned differently have their velocities in common."""
    task, free = BaseOrientationTask(Gain(kp=0.0, kd=8.0), 1.0), BaseOrientationTask(NONE, 1.0)
    rng = np.random.default_rng(15)
    q, v = random_state(rng, solo12)
    rotation, target, wanted = pin.Quaternion(q[3:7]).matrix(), pin.exp3(rng.normal(size=3)), rng.normal(size=3)
    task.target.rotation[:], task.target.angular_velocity[:] = target, wanted
    added = rows_of(solo12, task)(q, v)[1] - rows_of(solo12, free)(q, v)[1]
    np.testing.assert_allclose(rotation @ added, 8.0 * (target @ wanted - rotation @ v[3:6]), atol=1e-11)


@pytest.mark.parametrize("name", ["com", "base_position", "posture", "swing"])
def test_feedback_points_to_the_target_and_damps(robot, random_state, rows_of, name):
    """kp multiplies target minus position, kd target rate minus rate."""
    make, quantity, _, stance = TASKS[name]
    rng = np.random.default_rng(14)
    free, fed = make(robot, NONE), make(robot, UNEVEN)
    fed.target.position[...] = rng.normal(size=fed.target.position.shape)
    fed.target.velocity[...] = rng.normal(size=fed.target.velocity.shape)
    q, v = random_state(rng, robot)
    added = rows_of(robot, fed)(q, v, stance)[1] - rows_of(robot, free)(q, v, stance)[1]
    expected = 3.0 * (fed.target.position.ravel() - quantity(robot, q, v))
    expected += 7.0 * (fed.target.velocity.ravel() - rate_of(robot, quantity, q, v, np.zeros(robot.nv)))
    np.testing.assert_allclose(added, np.dot(planes(robot, name, q), expected), atol=1e-5)


def test_momentum_and_contact_velocity_feedback(robot, random_state, rows_of):
    q, v = random_state(np.random.default_rng(15), robot)
    task = AngularMomentumTask(Gain(kp=0.0, kd=8.0), 1.0)
    task.target.momentum[:] = 0.1, -0.2, 0.3
    added = rows_of(robot, task)(q, v)[1] - rows_of(robot, AngularMomentumTask(NONE, 1.0))(q, v)[1]
    np.testing.assert_allclose(added, 8.0 * (task.target.momentum - angular_momentum(robot, q, v)), atol=1e-11)
    damped, free = (rows_of(robot, StanceTask(robot, gain, 1.0))(q, v)[1] for gain in (Gain(kp=0.0, kd=20.0), NONE))
    np.testing.assert_allclose(damped - free, -20.0 * rolling_velocity(robot, q, v), atol=1e-11)


def test_feet_switch_between_stance_and_swing(solo12, random_state, rows_of):
    """A foot's rows count in one of the two tasks, and the target of a foot that stands is not even read."""
    stance, swing = StanceTask(solo12, Gain(kp=0.0, kd=20.0), 1e3), SwingTask(solo12, STIFF, 10.0)
    held, followed = rows_of(solo12, stance), rows_of(solo12, swing)
    state = random_state(np.random.default_rng(16), solo12)
    swing.target.position[:] = 0.1
    swing.target.position[[0, 2, 3]] = np.nan
    flags = np.array([True, False, True, True])
    in_air = np.repeat(~flags, 3)
    np.testing.assert_array_equal(followed(*state, flags)[2], np.where(in_air, 10.0, 0.0))
    np.testing.assert_array_equal(held(*state, flags)[2], np.where(in_air, 0.0, 1e3))
    for rows in (held, followed):
        rhs, weight = rows(*state, flags)[1:]
        assert np.isfinite(rhs).all()
        np.testing.assert_array_equal(rhs[weight == 0.0], 0.0)
    np.testing.assert_array_equal(held(*state, flags)[1][~in_air], held(*state, True)[1][~in_air])


class FootHeight(SymbolicTask):
    dim = 1

    def position(self, s):
        return s.placement("FL_FOOT").translation[2]


def test_ones_own_task_in_three_lines(solo12, random_state, rows_of):
    """Its Jacobian and drift are those that Pinocchio has for the frame."""
    task = FootHeight(UNEVEN, weight=2.0)
    task.target.position[:], task.target.velocity[:], task.target.acceleration[:] = 0.3, 0.2, 0.1
    rows, rng, frame = rows_of(solo12, task), np.random.default_rng(17), solo12.contact_ids[0]
    model, data = solo12.model, solo12.create_data()
    for _ in range(5):
        q, v = random_state(rng, solo12)
        jacobian, rhs, weight = rows(q, v)
        pin.forwardKinematics(model, data, q, v, np.zeros(solo12.nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        expected = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[2]
        drift = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear[2]
        np.testing.assert_allclose(jacobian[0], expected, atol=1e-13)
        height = data.oMf[frame].translation[2]
        feedback = 0.1 + 3.0 * (0.3 - height) + 7.0 * (0.2 - expected @ v)
        np.testing.assert_allclose(rhs, feedback - drift, atol=1e-11)
        np.testing.assert_array_equal(weight, 2.0)


@pytest.mark.usefixtures("interpreted")
def test_a_controller_follows_ones_own_task(solo12):
    """RiseMotion a foot by its height alone, while the others carry the weight."""
    settings = WholeBodySettings().replace({"weights.swing": 0.0})
    task = FootHeight(Gain(kp=100.0), weight=100.0, name="lift")
    controller = WholeBodyController(solo12, settings, [*standard_tasks(solo12, settings), task])
    terms = controller.sense(solo12.q_reference, np.zeros(solo12.nv))
    controller.contacts.stance[0] = False
    task.target.position[:] = terms.contact_points[0, 2] + solo12.contact_radius + 0.01
    controller.stand()
    controller.solve()
    acceleration = controller.acceleration
    frame = pin.computeFrameJacobian(
        solo12.model, solo12.create_data(), solo12.q_reference, solo12.contact_ids[0], pin.LOCAL_WORLD_ALIGNED
    )
    assert (frame @ acceleration)[2] == pytest.approx(100.0 * 0.01, rel=0.05)


def test_a_target_that_a_task_does_not_have_is_named(solo12):
    with pytest.raises(InputError, match="target of task 'com': got posittion.*position"):
        ComTask(STIFF, 1.0).target.posittion[:] = 0.0
    assert hasattr(ComTask(STIFF, 1.0).target, "velocity")
    assert not hasattr(ComTask(STIFF, 1.0).target, "rotation")


def test_standing_targets_are_here_and_in_the_reference_posture(solo12, random_state):
    controller = WholeBodyController(solo12, WholeBodySettings())
    terms = controller.sense(*random_state(np.random.default_rng(18), solo12))
    for task in controller.tasks.values():
        for key in task.layout:
            if key not in ("kp", "kd", "weight"):
                task.layout.view(task.memory, key)[:] = np.nan
    controller.stand()
    targets = {name: task.target for name, task in controller.tasks.items()}
    assert all(np.isfinite(task.memory).all() for task in controller.tasks.values())
    np.testing.assert_array_equal(targets["com"].position, terms.com)
    np.testing.assert_array_equal(targets["swing"].position, terms.contact_points)
    np.testing.assert_array_equal(targets["posture"].position, solo12.q_reference[7:])
    np.testing.assert_array_equal(targets["base_position"].position, terms.q[:3])
    np.testing.assert_allclose(targets["base_orientation"].rotation, np.eye(3), atol=1e-15)
    for name in ("com", "swing", "posture", "base_position"):
        assert not targets[name].velocity.any() and not targets[name].acceleration.any()


@pytest.mark.parametrize(
    ("weight", "message"),
    [
        (-1.0, "weight of task 'com': got -1.0; expected finite, not negative"),
        (float("nan"), "weight of task 'com'"),
        ((1.0, 2.0), r"weight of task 'com': got \(1.0, 2.0\); expected one number or 3"),
    ],
)
def test_bad_weights_are_refused(weight, message):
    with pytest.raises(InputError, match=message):
        ComTask(STIFF, weight)


class WrongSize(SymbolicTask):
    dim = 2

    def position(self, s):
        return s.com


class Nothing(SymbolicTask):
    dim = 1


class NoColumn(SymbolicTask):
    dim = 1

    def position(self, s):
        return None


def test_tasks_that_are_not_written_right_are_refused(solo12):
    with pytest.raises(
        InputError, match=r"velocity of task 'WrongSize': got shape \(3, 1\); expected .* shape \(2, 1\)"
    ):
        WholeBodyController(solo12, WholeBodySettings(), [WrongSize(STIFF, 1.0)])
    with pytest.raises(InputError, match="task 'Nothing': got neither position nor velocity"):
        WholeBodyController(solo12, WholeBodySettings(), [Nothing(STIFF, 1.0)])
    with pytest.raises(InputError, match="velocity of task 'NoColumn': got NotImplementedError: .* a CasADi column"):
        WholeBodyController(solo12, WholeBodySettings(), [NoColumn(STIFF, 1.0)])
    with pytest.raises(InputError, match="two called 'com'"):
        WholeBodyController(solo12, WholeBodySettings(), [ComTask(STIFF, 1.0), ComTask(STIFF, 2.0)])
    for wrong in ("text", ["text"]):
        with pytest.raises(InputError, match="tasks: got text; expected a list of tasks"):
            WholeBodyController(solo12, WholeBodySettings(), wrong)


def test_swings_of_planar_legs_demand_nothing_normal_to_their_plane(rows_of, random_state):
    """Of any target, the rows contain the part in the plane: with it, the foot's acceleration is as without legs."""
    robot, rng = solo8(), np.random.default_rng(16)
    task = SwingTask(robot, STIFF, 1.0)
    q, v = random_state(rng, robot)
    task.target.position[...] = lowest_points(robot, q, v).reshape(4, 3) + rng.normal(0, 0.1, (4, 3))
    jacobian, rhs, weight = rows_of(robot, task)(q, v, False)
    across = pin.Quaternion(q[3:7]).matrix()[:, 1]
    for foot in range(4):
        rows = slice(3 * foot, 3 * foot + 3)
        np.testing.assert_allclose(across @ jacobian[rows], 0.0, atol=1e-12)
        assert across @ rhs[rows] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(weight, 1.0)
    a = rng.normal(0, 5, robot.nv)
    free = SwingTask(robot, NONE, 1.0)
    residual = (lambda j, r, _: j @ a - r)(*rows_of(robot, free)(q, v, False)).reshape(4, 3)
    expected = numerical_acceleration(robot, lowest_points, 2, q, v, a).reshape(4, 3)
    within = np.eye(3) - np.outer(across, across)
    np.testing.assert_allclose(residual, expected @ within, atol=3e-5 * np.abs(expected).max())


def test_joints_that_move_no_foot_have_a_task_of_their_own(solo12, rows_of, random_state):
    robot, rng = b1_with_arm(), np.random.default_rng(17)
    settings = WholeBodySettings()
    assert "upper_body_joints" not in {task.name for task in standard_tasks(solo12, settings)}
    (task,) = (task for task in standard_tasks(robot, settings) if task.name == "upper_body_joints")
    task.stand(robot, None)
    q, v = random_state(rng, robot)
    jacobian, rhs, weight = rows_of(robot, task)(q, v)
    np.testing.assert_array_equal(jacobian, np.eye(25)[18:])
    np.testing.assert_allclose(rhs, 100.0 * (robot.q_reference - q)[19:] - 20.0 * v[18:], atol=1e-9)
    np.testing.assert_array_equal(weight, 10.0)
    assert isinstance(task, UpperBodyTask)
