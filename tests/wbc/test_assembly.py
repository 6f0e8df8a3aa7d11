"""The QP's constraints against independent computations of what they stand for."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.wbc import (
    QpAssembly,
    QpStatus,
    TaskStack,
    WholeBodyController,
    WholeBodyLimits,
    WholeBodySettings,
    WholeBodyTerms,
    standing_tasks,
)


def test_the_cost_is_the_weighted_sum_of_squares(solo12, random_state, standing, randomise):
    settings, rng = WholeBodySettings(), np.random.default_rng(19)
    terms, stack = WholeBodyTerms(solo12), TaskStack(standing_tasks(solo12, settings), solo12.nv)
    qp = QpAssembly(solo12, stack, settings.limits, 0.3, 0.7)
    for _ in range(2):  # the second update must not see the first
        terms.update(*random_state(rng))
        randomise(standing, terms, rng)
        stack.update(terms, standing)
        qp.update(terms, standing)

    def cost(z):
        a, f = z[:18], z[18:]
        tasks = stack.weight @ (stack.jacobian @ a - stack.rhs) ** 2
        return 0.5 * (tasks + 0.3 * np.sum((f - standing.contact_forces.ravel()) ** 2) + 0.7 * a @ a)

    for _ in range(5):
        z = rng.normal(size=30)
        quadratic = 0.5 * z @ qp.hessian @ z + qp.gradient @ z
        assert quadratic == pytest.approx(cost(z) - cost(np.zeros(30)), rel=1e-9)


def external_forces(robot, data, points, forces, com, wrench):
    """What acts on every joint's body, in the joint's frame."""
    on_bodies = pin.StdVec_Force([pin.Force.Zero() for _ in range(robot.model.njoints)])
    for frame, point, force in zip(robot.contact_ids, points, forces, strict=True):
        joint = robot.model.frames[frame].parentJoint
        on_bodies[joint] += data.oMi[joint].actInv(pin.Force(force, np.cross(point, force)))
    at_origin = pin.Force(wrench[:3], wrench[3:] + np.cross(com, wrench[:3]))
    on_bodies[1] += data.oMi[1].actInv(at_origin)
    return on_bodies


def in_air(reference, foot):
    reference.stance[:] = True
    if foot is not None:
        reference.stance[foot] = False


@pytest.mark.parametrize("foot_in_air", [None, 2])
def test_solved_ticks_obey_the_equations_of_motion_and_every_limit(
    solo12, random_state, standing, randomise, foot_in_air
):
    """Inverse dynamics with the QP's forces and the external wrench: nothing on the base, the torques on the joints.

    And the centroidal momentum changes as the forces, the weight and the wrench say.
    """
    settings = WholeBodySettings(tolerance=1e-8)
    controller = WholeBodyController(solo12, settings)
    data, rng = solo12.create_data(), np.random.default_rng(20)
    in_air(standing, foot_in_air)
    saturated = 0
    for _ in range(25):
        q, v = random_state(rng)
        controller.reset()
        terms = controller.sense(q, v)
        randomise(standing, terms, rng)
        standing.foot_position[:] = terms.contact_points + 0.05
        assert controller.solve(standing) is QpStatus.SOLVED
        pin.forwardKinematics(solo12.model, data, q)
        com = pin.centerOfMass(solo12.model, solo12.create_data(), q)
        points = np.array([frame_point(solo12, q, frame) for frame in solo12.contact_ids])
        forces = external_forces(solo12, data, points, controller.forces, com, standing.external_wrench)
        generalised = pin.rnea(solo12.model, data, q, v, controller.acceleration, forces)
        np.testing.assert_allclose(generalised[:6], 0.0, atol=1e-6)
        np.testing.assert_allclose(generalised[6:], controller.tau, atol=1e-6)
        rate = terms.momentum_matrix @ controller.acceleration + terms.momentum_drift
        total = controller.forces.sum(axis=0) + solo12.mass * solo12.gravity
        moment = np.cross(points - com, controller.forces).sum(axis=0)
        np.testing.assert_allclose(rate, np.concatenate([total, moment]) + standing.external_wrench, atol=1e-6)
        assert np.abs(controller.tau).max() <= 1.8 + 1e-6
        saturated += np.abs(controller.tau).max() > 1.8 - 1e-6
        tangential = np.linalg.norm(controller.forces[:, :2], axis=1)
        assert (tangential <= settings.limits.friction * controller.forces[:, 2] + 1e-6).all()
        normal = controller.forces[:, 2]
        assert normal.max() <= settings.limits.normal_force_max + 1e-6
        assert normal[standing.stance].min() >= settings.limits.normal_force_min - 1e-6
        if foot_in_air is not None:
            np.testing.assert_allclose(controller.forces[foot_in_air], 0.0, atol=1e-6)
    assert saturated < 25  # otherwise the references are no trial of the rest


def frame_point(robot, q, frame):
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[frame].translation - [0, 0, robot.contact_radius]


def test_the_torque_limit_is_hard(solo12, standing):
    """An impossible jump takes all the torque there is, and no more."""
    controller = WholeBodyController(solo12, WholeBodySettings())
    standing.com_acceleration[2] = 200.0
    controller.sense(solo12.q_reference, np.zeros(solo12.nv))
    assert controller.solve(standing) is QpStatus.SOLVED
    assert np.abs(controller.tau).max() == pytest.approx(1.8, abs=1e-5)
    weak = dataclasses.replace(solo12, effort_limit=np.full(12, 1.0))
    controller = WholeBodyController(weak, WholeBodySettings())
    assert controller.solve(standing) is QpStatus.SOLVED
    assert np.abs(controller.tau).max() == pytest.approx(1.0, abs=1e-5)


class JointsAlone:
    """The joints under the QP's acceleration bounds, integrated as a plant does it."""

    def __init__(self, robot, limits, q):
        self.robot, self.dt = robot, 1e-3
        self.assembly = QpAssembly(robot, TaskStack([], robot.nv), limits, 1.0, 1.0)
        self.terms = WholeBodyTerms(robot)
        self.q, self.v = robot.q_reference.copy(), np.zeros(robot.nv)
        self.q[7:] = q

    def bounds(self, reference):
        self.terms.update(self.q, self.v)
        self.assembly.update(self.terms, reference)
        box = slice(6, self.robot.nv)
        return self.assembly.box_lower[box], self.assembly.box_upper[box]

    def step(self, acceleration):
        self.v[6:] += self.dt * acceleration
        self.q[7:] += self.dt * self.v[6:]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_running_into_its_limit_stops_there(solo12, standing, side):
    joints = JointsAlone(solo12, WholeBodyLimits(), solo12.q_reference[7:])
    farthest, fastest = np.full(12, -np.inf), 0.0
    for _ in range(1000):
        lower, upper = joints.bounds(standing)
        joints.step(upper if side > 0 else lower)
        farthest = np.maximum(farthest, side * joints.q[7:])
        fastest = max(fastest, np.abs(joints.v[6:]).max())
    limit = side * (solo12.joint_upper if side > 0 else solo12.joint_lower)
    assert (farthest <= limit).all()
    np.testing.assert_allclose(farthest, limit, atol=1e-6)  # it gets there
    assert fastest <= 30.0


def test_no_accelerations_within_the_bounds_pass_a_limit(solo12, standing):
    """Whatever is asked of the joints, held between the bounds they stay within position and velocity limits."""
    rng = np.random.default_rng(21)
    slow = dataclasses.replace(solo12, velocity_limit=np.full(12, 6.0))
    joints = JointsAlone(slow, WholeBodyLimits(), rng.uniform(slow.joint_lower, slow.joint_upper))
    at_limits = np.zeros(12)
    fastest = 0.0
    for tick in range(3000):
        if tick % 250 == 0:
            wish = rng.choice([-600.0, -100.0, 100.0, 600.0], 12)
        lower, upper = joints.bounds(standing)
        assert (lower <= upper).all()
        joints.step(np.clip(wish, lower, upper))
        q = joints.q[7:]
        assert (q <= slow.joint_upper).all() and (q >= slow.joint_lower).all()
        assert np.abs(joints.v[6:]).max() <= 6.0 + 1e-12
        at_limits += (q > slow.joint_upper - 0.02) | (q < slow.joint_lower + 0.02)
        fastest = max(fastest, np.abs(joints.v[6:]).max())
    assert (at_limits > 0).all() and fastest > 5.9


def test_a_joint_past_its_limit_is_brought_back(solo12, standing):
    joints = JointsAlone(solo12, WholeBodyLimits(), solo12.joint_upper + 0.1)
    for _ in range(300):
        lower, upper = joints.bounds(standing)
        assert (upper >= -2000.0).all() and (lower <= upper).all()
        joints.step(upper)
    assert (joints.q[7:] <= solo12.joint_upper + 1e-4).all()


def test_bounds_never_cross_or_exceed_the_cap_in_absurd_states(solo12, standing):
    rng = np.random.default_rng(22)
    joints = JointsAlone(solo12, WholeBodyLimits(joint_acceleration_max=500.0), np.zeros(12))
    for _ in range(100):
        joints.q[7:], joints.v[6:] = rng.normal(0, 5, 12), rng.normal(0, 100, 12)
        lower, upper = joints.bounds(standing)
        assert (lower <= upper).all() and (upper >= -500.0).all() and (lower <= 500.0).all()


def test_unlimited_joints_have_only_velocity_bounds(solo12, standing):
    endless = dataclasses.replace(solo12, joint_lower=np.full(12, -np.inf), joint_upper=np.full(12, np.inf))
    lower, upper = JointsAlone(endless, WholeBodyLimits(), np.zeros(12)).bounds(standing)
    np.testing.assert_allclose(upper, 30.0 / 0.05)
    np.testing.assert_allclose(lower, -30.0 / 0.05)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("friction", 0.0),
        ("friction", float("nan")),
        ("friction_facets", 2),
        ("normal_force_min", -1.0),
        ("normal_force_min", 25.0),
        ("normal_force_max", float("inf")),
        ("joint_horizon", 0.0),
        ("joint_acceleration_max", -1.0),
    ],
)
def test_impossible_limits_are_refused(argument, value):
    with pytest.raises(InputError, match=f"^{argument}: got {value}"):
        WholeBodyLimits(**{argument: value})
