"""The QP's data against independent computations of what it stands for."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.status import Status
from lgmpc.wbc import Gain, NumericTask, SymbolicTask, WholeBodyController, WholeBodySettings
from lgmpc.wbc.library import ComTask


def contact_jacobian(robot, q):
    """Of the material points in contact: the frame's velocity and omega x (-r e_z)."""
    model, data = robot.model, robot.create_data()
    lever = pin.skew(np.array([0.0, 0.0, -robot.contact_radius]))
    frames = [pin.computeFrameJacobian(model, data, q, i, pin.LOCAL_WORLD_ALIGNED) for i in robot.contact_ids]
    return np.vstack([frame[:3] - lever @ frame[3:] for frame in frames])


@pytest.mark.usefixtures("interpreted")
def test_the_constraints_are_pinocchios_dynamics(robot, random_state, randomise):
    """M, h and J_c of the equations of motion, wrench about the centre of mass, load of joints, on several robots."""
    wbc, rng = WholeBodyController(robot, WholeBodySettings()), np.random.default_rng(18)
    qp, model, nv, nu = wbc.solver, robot.model, robot.nv, robot.nu
    for _ in range(5):
        q, v = random_state(rng, robot)
        wbc.sense(q, v)
        randomise(wbc, rng)
        wbc.qp.update()
        mass = pin.crba(model, robot.create_data(), q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, robot.create_data(), q, v)
        bias[6:] -= wbc.joint_load
        rows = np.hstack([mass, -contact_jacobian(robot, q).T])
        scale = np.abs(rows).max()
        np.testing.assert_allclose(qp.equality, rows[:6], atol=1e-13 * scale)
        np.testing.assert_allclose(qp.inequality[:nu], rows[6:], atol=1e-13 * scale)
        np.testing.assert_allclose(qp.upper[:nu], robot.effort_limit - bias[6:], atol=1e-11)
        np.testing.assert_allclose(qp.lower[:nu], -robot.effort_limit - bias[6:], atol=1e-11)
        # Power of the wrench on a rigid motion of the base, twist by twist.
        com = pin.centerOfMass(model, robot.create_data(), q)
        rotation = pin.Quaternion(q[3:7]).matrix()
        for i, twist in enumerate(np.eye(6)):
            linear, angular = rotation @ twist[:3], rotation @ twist[3:]
            velocity = linear + np.cross(angular, com - q[:3])
            power = wbc.external_wrench @ np.concatenate([velocity, angular])
            assert qp.equality_rhs[i] == pytest.approx(power - bias[i], abs=1e-11 * scale)
        solution, torques = rng.normal(size=nv + 3 * robot.nc), np.zeros(nu)
        qp.values[:] = qp.inequality @ solution
        wbc.qp.write_torques(torques)
        np.testing.assert_allclose(torques, (rows @ solution + bias)[6:], atol=1e-11 * scale)


@pytest.mark.usefixtures("interpreted")
def test_the_cost_is_the_weighted_sum_of_squares(robot, random_state, randomise, rows_of):
    settings = WholeBodySettings().replace(
        {"weights.force": 0.3, "weights.acceleration": 0.7, "weights.base_position": 2.0}
    )
    wbc, rng = WholeBodyController(robot, settings), np.random.default_rng(19)
    rows = [rows_of(robot, task) for task in wbc.tasks.values()]
    wbc.contacts.stance[1] = False
    for _ in range(2):  # the second update must not see the first
        q, v = random_state(rng, robot)
        wbc.sense(q, v)
        randomise(wbc, rng)
        wbc.qp.update()
    found = [each(q, v, wbc.contacts.stance) for each in rows]
    nv = robot.nv
    force_weight = 0.3 * (2.5 / robot.mass) ** 2

    def cost(z):
        a, f = z[:nv], z[nv:]
        tasks = sum(weight @ (jacobian @ a - rhs) ** 2 for jacobian, rhs, weight in found)
        return 0.5 * (tasks + force_weight * np.sum((f - wbc.contacts.target_forces.ravel()) ** 2) + 0.7 * a @ a)

    qp = wbc.solver
    for _ in range(5):
        z = rng.normal(size=qp.size)
        quadratic = 0.5 * z @ qp.hessian @ z + qp.gradient @ z
        assert quadratic == pytest.approx(cost(z) - cost(np.zeros(qp.size)), rel=1e-9)


def test_weights_of_momenta_and_forces_follow_the_robots_mass(robot):
    settings = WholeBodySettings().scaled(robot)
    factor = (2.5 / robot.mass) ** 2
    assert settings.weights.angular_momentum == pytest.approx(100.0 * factor)
    assert settings.weights.force == pytest.approx(1e-4 * factor)
    assert settings.weights.com == (10.0, 10.0, 10.0)
    assert settings.stepping_weights.angular_momentum == pytest.approx(factor)
    assert settings.stepping_weights.base_orientation == pytest.approx(1.5 * (robot.mass / 2.5) ** (2.0 / 3.0))
    assert settings.normal_force_n == pytest.approx((0.04 * robot.mass, 24.0 * robot.mass))
    assert WholeBodySettings(normal_force_n=(1.0, 2.0)).scaled(robot).normal_force_n == (1.0, 2.0)


def external_forces(robot, data, points, forces, com, wrench):
    """What acts on every joint's body, in the joint's frame."""
    on_bodies = pin.StdVec_Force([pin.Force.Zero() for _ in range(robot.model.njoints)])
    for frame, point, force in zip(robot.contact_ids, points, forces, strict=True):
        joint = robot.model.frames[frame].parentJoint
        on_bodies[joint] += data.oMi[joint].actInv(pin.Force(force, np.cross(point, force)))
    at_origin = pin.Force(wrench[:3], wrench[3:] + np.cross(com, wrench[:3]))
    on_bodies[1] += data.oMi[1].actInv(at_origin)
    return on_bodies


def frame_point(robot, q, frame):
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[frame].translation - [0, 0, robot.contact_radius]


@pytest.mark.parametrize("foot_in_air", [None, 2])
def test_solved_ticks_obey_the_equations_of_motion_and_every_limit(solo12, random_state, randomise, foot_in_air):
    """Inverse dynamics with the QP's forces and the external wrench: nothing on the base, the torques on the joints.

    And the centroidal momentum changes as the forces, the weight and the wrench say.
    """
    settings = WholeBodySettings(tolerance=1e-8)
    controller = WholeBodyController(solo12, settings)
    data, rng = solo12.create_data(), np.random.default_rng(20)
    stance = controller.contacts.stance
    if foot_in_air is not None:
        stance[foot_in_air] = False
    saturated = 0
    for _ in range(25):
        q, v = random_state(rng, solo12)
        controller.reset()
        terms = controller.sense(q, v)
        randomise(controller, rng)
        assert controller.solve() is Status.CONVERGED
        pin.forwardKinematics(solo12.model, data, q)
        com = pin.centerOfMass(solo12.model, solo12.create_data(), q)
        points = np.array([frame_point(solo12, q, frame) for frame in solo12.contact_ids])
        wrench = controller.external_wrench
        forces = external_forces(solo12, data, points, controller.forces, com, wrench)
        generalised = pin.rnea(solo12.model, data, q, v, controller.acceleration, forces)
        np.testing.assert_allclose(generalised[:6], 0.0, atol=1e-6)
        np.testing.assert_allclose(generalised[6:], controller.tau + controller.joint_load, atol=1e-6)
        total = controller.forces.sum(axis=0) + solo12.mass * solo12.gravity
        moment = np.cross(points - com, controller.forces).sum(axis=0)
        expected = np.concatenate([total, moment]) + wrench
        np.testing.assert_allclose(terms.momentum_rate(controller.acceleration), expected, atol=1e-6)
        assert np.abs(controller.tau).max() <= 1.8 + 1e-6
        saturated += np.abs(controller.tau).max() > 1.8 - 1e-6
        tangential = np.linalg.norm(controller.forces[:, :2], axis=1)
        assert (tangential <= settings.friction * controller.forces[:, 2] + 1e-6).all()
        normal = controller.forces[:, 2]
        assert normal.max() <= 24.0 * solo12.mass + 1e-6
        assert normal[stance].min() >= 0.04 * solo12.mass - 1e-6
        if foot_in_air is not None:
            np.testing.assert_allclose(controller.forces[foot_in_air], 0.0, atol=1e-6)
    assert saturated < 25  # otherwise the targets are no trial of the rest


def test_the_torque_limit_is_hard(solo12, controller):
    """An impossible jump takes all the torque there is, and no more."""
    controller.tasks["com"].target.acceleration[2] = 200.0
    assert controller.solve() is Status.CONVERGED
    assert np.abs(controller.tau).max() == pytest.approx(1.8, abs=1e-5)
    weak = WholeBodyController(dataclasses.replace(solo12, effort_limit=np.full(12, 1.0)), WholeBodySettings())
    weak.tasks["com"].target.acceleration[2] = 200.0
    assert weak.solve() is Status.CONVERGED
    assert np.abs(weak.tau).max() == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("facets", [4, 12])
@pytest.mark.parametrize("direction", [0.0, np.pi / 4, 1.0])
def test_friction_given_at_a_tick_keeps_the_forces_inside_that_cone(solo12, facets, direction):
    """The pyramid of the coefficient of each foot at this tick is inscribed in its cone, and reached."""
    controller = WholeBodyController(solo12, WholeBodySettings(friction_facets=facets, tolerance=1e-8))
    for friction in ([0.2, 0.3, 0.4, 0.5], [0.6, 0.6, 0.1, 0.1]):
        controller.contacts.friction[:] = friction
        controller.tasks["com"].target.acceleration[:2] = 200.0 * np.cos(direction), 200.0 * np.sin(direction)
        assert controller.solve() is Status.CONVERGED
        tangential = np.linalg.norm(controller.forces[:, :2], axis=1)
        ratio = tangential / (np.array(friction) * controller.forces[:, 2])
        assert ratio.max() <= 1.0 + 1e-5
        normals = 2.0 * np.pi * np.arange(facets) / facets
        along = np.max(controller.forces[:, :1] * np.cos(normals) + controller.forces[:, 1:2] * np.sin(normals), axis=1)
        width = np.array(friction) * np.cos(np.pi / facets) * controller.forces[:, 2]
        assert (along / width).max() == pytest.approx(1.0, abs=1e-4)


def test_normal_forces_keep_the_bounds_that_each_foot_has_at_a_tick(solo12, controller):
    contacts = controller.contacts
    contacts.highest_normal[0] = 2.0
    contacts.lowest_normal[3] = 7.5
    assert controller.solve() is Status.CONVERGED
    assert controller.forces[0, 2] == pytest.approx(2.0, abs=1e-4)
    assert controller.forces[3, 2] >= 7.5 - 1e-4
    contacts.highest_normal[0] = 25.0
    contacts.stance[3] = False  # its bounds are those of a foot in the air: no force
    controller.tasks["swing"].target.position[:] = controller.terms.contact_points
    assert controller.solve() is Status.CONVERGED
    np.testing.assert_allclose(controller.forces[3], 0.0, atol=1e-4)
    assert controller.forces[:, 2].sum() == pytest.approx(9.81 * solo12.mass, rel=0.05)


def test_weights_and_gains_are_buffers_too(solo12, controller):
    """A heavier posture task moves the joints more towards a target that contradicts the feet."""
    posture = controller.tasks["posture"]
    posture.target.position[0] += 0.3

    def acceleration():
        controller.reset()
        assert controller.solve() is Status.CONVERGED
        return controller.acceleration[6]

    light = acceleration()
    posture.weight[:] = 1e4
    heavy = acceleration()
    posture.kp[:] = 0.0
    assert heavy > 5.0 * abs(light) and abs(acceleration()) < 0.2 * heavy


class JointsAlone:
    """The joints under the QP's acceleration bounds, integrated as a plant does it."""

    def __init__(self, robot, settings, q):
        self.robot, self.dt = robot, 1e-3
        self.wbc = WholeBodyController(robot, settings, [])
        self.q, self.v = robot.q_reference.copy(), np.zeros(robot.nv)
        self.q[7:] = q

    def bounds(self):
        self.wbc.sense(self.q, self.v)
        self.wbc.qp.update()
        box = slice(6, self.robot.nv)
        return self.wbc.solver.box_lower[box], self.wbc.solver.box_upper[box]

    def step(self, acceleration):
        self.v[6:] += self.dt * acceleration
        self.q[7:] += self.dt * self.v[6:]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_running_into_its_limit_stops_there(solo12, side):
    joints = JointsAlone(solo12, WholeBodySettings(), solo12.q_reference[7:])
    farthest, fastest = np.full(12, -np.inf), 0.0
    for _ in range(1000):
        lower, upper = joints.bounds()
        joints.step(upper if side > 0 else lower)
        farthest = np.maximum(farthest, side * joints.q[7:])
        fastest = max(fastest, np.abs(joints.v[6:]).max())
    limit = side * (solo12.joint_upper if side > 0 else solo12.joint_lower)
    assert (farthest <= limit).all()
    np.testing.assert_allclose(farthest, limit, atol=1e-6)  # it gets there
    assert fastest <= 30.0


def test_no_accelerations_within_the_bounds_pass_a_limit(solo12):
    """Held between the bounds, joints stay within position and velocity limits, whatever the accelerations are."""
    rng = np.random.default_rng(21)
    slow = dataclasses.replace(solo12, velocity_limit=np.full(12, 6.0))
    joints = JointsAlone(slow, WholeBodySettings(), rng.uniform(slow.joint_lower, slow.joint_upper))
    at_limits = np.zeros(12)
    fastest = 0.0
    for tick in range(3000):
        if tick % 250 == 0:
            wish = rng.choice([-600.0, -100.0, 100.0, 600.0], 12)
        lower, upper = joints.bounds()
        assert (lower <= upper).all()
        joints.step(np.clip(wish, lower, upper))
        q = joints.q[7:]
        assert (q <= slow.joint_upper).all() and (q >= slow.joint_lower).all()
        assert np.abs(joints.v[6:]).max() <= 6.0 + 1e-12
        at_limits += (q > slow.joint_upper - 0.02) | (q < slow.joint_lower + 0.02)
        fastest = max(fastest, np.abs(joints.v[6:]).max())
    assert (at_limits > 0).all() and fastest > 5.9


def test_a_joint_past_its_limit_is_brought_back(solo12):
    joints = JointsAlone(solo12, WholeBodySettings(), solo12.joint_upper + 0.1)
    for _ in range(300):
        lower, upper = joints.bounds()
        assert (upper >= -2000.0).all() and (lower <= upper).all()
        joints.step(upper)
    assert (joints.q[7:] <= solo12.joint_upper + 1e-4).all()


def test_bounds_never_cross_or_exceed_the_cap_in_absurd_states(solo12):
    rng = np.random.default_rng(22)
    joints = JointsAlone(solo12, WholeBodySettings(joint_acceleration_max_rad_s2=500.0), np.zeros(12))
    for _ in range(100):
        joints.q[7:], joints.v[6:] = rng.normal(0, 5, 12), rng.normal(0, 100, 12)
        lower, upper = joints.bounds()
        assert (lower <= upper).all() and (upper >= -500.0).all() and (lower <= 500.0).all()


def test_unlimited_joints_have_only_velocity_bounds(solo12):
    endless = dataclasses.replace(solo12, joint_lower=np.full(12, -np.inf), joint_upper=np.full(12, np.inf))
    lower, upper = JointsAlone(endless, WholeBodySettings(), np.zeros(12)).bounds()
    np.testing.assert_allclose(upper, 30.0 / 0.02)
    np.testing.assert_allclose(lower, -30.0 / 0.02)


class ComInNumpy(NumericTask):
    """The centre of mass by Pinocchio's own functions."""

    name = "com"
    dim = 3

    def __init__(self, robot, gain, weight):
        super().__init__(robot, gain, weight)
        self.robot, self.data = robot, robot.create_data()

    def update(self, terms):
        model, data = self.robot.model, self.data
        self.jacobian[:] = pin.jacobianCenterOfMass(model, data, terms.q)
        pin.centerOfMass(model, data, terms.q, terms.v, np.zeros(self.robot.nv))
        self.error[:] = self.target.position - data.com[0]
        self.rate[:] = self.target.velocity - data.vcom[0]
        self.acceleration[:] = self.target.acceleration
        self.drift[:] = data.acom[0]


@pytest.mark.usefixtures("interpreted")
def test_a_task_in_numpy_adds_what_its_expression_adds(solo12, random_state):
    rng, gain, weight = np.random.default_rng(23), Gain(kp=100.0), (1.0, 2.0, 3.0)
    tasks = [ComInNumpy(solo12, gain, weight), ComTask(gain, weight)]
    numeric, symbolic = (WholeBodyController(solo12, WholeBodySettings(), [task]) for task in tasks)
    for _ in range(3):
        state = random_state(rng, solo12)
        targets = rng.normal(size=(3, 3))
        for wbc, task in zip((numeric, symbolic), tasks, strict=True):
            wbc.sense(*state)
            task.target.position[:], task.target.velocity[:], task.target.acceleration[:] = targets
            wbc.qp.update()
        for name in ("hessian", "gradient"):
            expected = getattr(symbolic.solver, name)
            scale = np.abs(expected).max()
            np.testing.assert_allclose(getattr(numeric.solver, name), expected, atol=1e-12 * scale)
    tasks[0].target.position[0] = np.nan
    assert numeric.solve() is Status.NOT_FINITE


def test_an_interpreted_controller_computes_what_a_compiled_one_does(solo12, random_state, randomise, monkeypatch):
    compiled = WholeBodyController(solo12, WholeBodySettings())
    monkeypatch.setenv("LGMPC_JIT", "0")
    interpreted = WholeBodyController(solo12, WholeBodySettings())
    state = random_state(np.random.default_rng(24), solo12)
    for wbc in (compiled, interpreted):
        wbc.sense(*state)
        randomise(wbc, np.random.default_rng(25))
        assert wbc.solve() is Status.CONVERGED
    np.testing.assert_allclose(interpreted.tau, compiled.tau, atol=1e-5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("friction", 0.0),
        ("friction", 5.0),
        ("friction", float("nan")),
        ("friction_facets", 2),
        ("normal_force_n", (-1.0, 2.0)),
        ("normal_force_n", (25.0, 25.0)),
        ("joint_horizon_s", 0.0),
        ("joint_acceleration_max_rad_s2", -1.0),
        ("rate_hz", 1e-3),
        ("tolerance", 0.0),
        ("max_iterations", 0),
        ("fallback_damping_nms", -0.1),
        ("weights.angular_momentum", -1.0),
        ("weights.force", float("nan")),
        ("weights.acceleration", float("inf")),
        ("gains.swing.kp", -1.0),
    ],
)
def test_impossible_settings_are_refused(key, value):
    with pytest.raises(InputError, match=f"^{key}"):
        WholeBodySettings().replace({key: value})


def test_gains_are_critically_damped_unless_the_damping_is_given():
    assert Gain(kp=100.0).damping == 20.0
    assert Gain(kp=100.0, kd=3.0).damping == 3.0


class Twice(SymbolicTask):
    dim = 1

    def velocity(self, s):
        return s.v[0]

    def error(self, s):
        return 0 * s.v[0]


def test_tasks_without_weight_are_left_out(solo12):
    """A task without a weight costs nothing, but its target can be written all the same."""
    settings = WholeBodySettings()
    alone, beside = (
        WholeBodyController(solo12, settings, [Twice(Gain(kp=0.0), 1.0, "a"), *extra])
        for extra in ([], [Twice(Gain(kp=0.0), 0.0, "b")])
    )
    for wbc in (alone, beside):
        wbc.qp.update()
    beside.tasks["b"].target.position[:] = np.nan
    assert np.isfinite(beside.qp.update())
    np.testing.assert_array_equal(alone.solver.hessian, beside.solver.hessian)
    everything = WholeBodyController(solo12, settings)
    everything.tasks["base_position"].target.position[:] = np.nan  # its weight is 0 by default
    assert everything.solve() is Status.CONVERGED
