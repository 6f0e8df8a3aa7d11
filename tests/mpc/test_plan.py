from __future__ import annotations

import numpy as np
import pytest

from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import CentroidalMpc, MeasuredState, Plan, PosturePlan
from lgmpc.mpc.centroidal import CentroidalMpc as Mpc

MASS = 2.5
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def planned() -> tuple[Mpc, Plan]:
    mpc = CentroidalMpc(MASS, 4)
    x = STANDING + [0.01, -0.02, 0.0, 0.8, 0.9, -0.1, 0.05, -0.02, 0.01]
    wrench = np.array([1.0, -2.0, 0.5, 0.02, 0.0, -0.03])
    contacts = ContactHorizon.allocate(20, 4)
    contacts.hold(FEET, np.ones(4, dtype=bool), 0.6)
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (21, 1))
    reference = MotionReference(np.tile(STANDING[:3], (21, 1)), np.zeros((21, 3)), level, np.zeros((21, 3)))
    state = MeasuredState.centroidal(2.0, x[:3], x[3:])
    for _ in range(6):  # iterate, so that the plan satisfies the dynamics to rounding
        plan = mpc.update(state, contacts, reference, np.tile(wrench, (20, 1)))
    return mpc, plan


@pytest.mark.parametrize("offset", [0.0, 0.001, 0.0099, 0.0201, 0.1234, 0.395, 0.4])
def test_sample_is_the_motion_under_the_interval_s_forces(planned: tuple[Mpc, Plan], offset: float) -> None:
    mpc, plan = planned
    action = mpc.problem.action
    k = min(int(offset / 0.02 + 1e-12), 19)
    p = mpc.problem.parameters[k].copy()
    p[action.parameters["duration"]] = offset - 0.02 * k
    exact = action.evaluate(plan.xs[k], plan.forces[k].ravel(), p).x_next
    sample = plan.sample(2.0 + offset)
    np.testing.assert_allclose(sample.com, exact[:3], atol=1e-9)
    np.testing.assert_allclose(sample.linear_momentum, exact[3:6], atol=1e-9)
    np.testing.assert_allclose(sample.angular_momentum, exact[6:9], atol=1e-9)
    np.testing.assert_allclose(sample.com_velocity, exact[3:6] / MASS, atol=1e-9)
    np.testing.assert_array_equal(sample.forces, plan.forces[k])
    force = plan.forces[k].sum(0) + MASS * np.array([0, 0, -9.81]) + p[action.parameters["external_wrench"]][:3]
    np.testing.assert_allclose(sample.com_acceleration, force / MASS, atol=1e-7)
    moment = np.cross(FEET - exact[:3], plan.forces[k]).sum(0) + p[action.parameters["external_wrench"]][3:]
    np.testing.assert_allclose(sample.angular_momentum_rate, moment, atol=1e-7)


def test_many_samples_are_each_one_sample(planned: tuple[Mpc, Plan]) -> None:
    _, plan = planned
    times = np.array([1.9, 2.0, 2.013, 2.2, 2.4, 3.0])
    rows = plan.sample_at(times)
    for i, t in enumerate(times):
        for name, value in vars(plan.sample(t)).items():
            np.testing.assert_array_equal(getattr(rows, name)[i], value)


def test_outside_the_horizon_its_ends_hold(planned: tuple[Mpc, Plan]) -> None:
    _, plan = planned
    np.testing.assert_array_equal(plan.sample(0.0).com, plan.xs[0, :3])
    np.testing.assert_array_equal(plan.sample(0.0).forces, plan.first_forces)
    np.testing.assert_allclose(plan.sample(9.0).com, plan.xs[-1, :3], atol=1e-12)
    np.testing.assert_array_equal(plan.sample(9.0).forces, plan.forces[-1])


def test_joints_move_linearly_between_nodes() -> None:
    joints = np.array([0.1, -0.4])
    qs = np.array([np.r_[0, 0, 0.2, 0, 0, 0, 1, k * joints] for k in range(3)])
    vs = np.array([np.r_[np.zeros(6), k * joints] for k in range(3)])
    plan = PosturePlan(1.0, 0.1, qs, vs)
    times = np.array([0.5, 1.0, 1.025, 1.1, 1.17, 1.2, 9.0])
    share = np.clip((times - 1.0) / 0.1, 0.0, 2.0)
    sample = plan.sample_at(times)
    np.testing.assert_allclose(sample.position, share[:, None] * joints, atol=1e-12)
    np.testing.assert_allclose(sample.velocity, share[:, None] * joints, atol=1e-12)
