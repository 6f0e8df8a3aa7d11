"""The predictive layer: limits of its disturbance observer, plans sampled at ticks."""

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.planner import PlanSampler
from lgmpc.mpc import Plan
from lgmpc.status import Status
from lgmpc.timegrid import TimeGrid

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_balance.yaml"


def test_the_observed_push_is_at_most_three_times_the_robot_s_weight() -> None:
    config = load_config(CONFIG)
    robot = build_robot(config)
    planner = build_controller(config, robot).planner
    assert planner is not None
    weight = 9.81 * robot.mass
    planner.observer.update(np.zeros(6))
    for size, expected in ((0.5 * weight, 0.5 * weight), (100.0 * weight, 3.0 * weight)):
        planner.observer.reset()
        for tick in range(1, 2000):  # the momentum grows as under a constant force, which no controller commanded
            planner.observer.expect(planner.observer.wrench.copy())
            planner.observer.update(np.array([0.0, size, 0.0, 0.0, 0.0, 0.0]) * tick * 1e-3)
        assert np.linalg.norm(planner.observer.wrench[:3]) == pytest.approx(expected, rel=1e-6)


def test_the_sampler_reads_the_plan_by_time() -> None:
    rng = np.random.default_rng(3)
    xs, forces = rng.normal(size=(21, 9)), rng.normal(size=(20, 4, 3))
    plan = Plan(2.0, 0.02, 2.5, xs, forces, Status.STEPPED, 1, 0.0)
    sampler = PlanSampler(TimeGrid(0.001, 10), 4)
    sampler.load(plan, 2.0)
    # In order, late, far beyond the sampled ticks (a missed update), and back again.
    for time in (2.0, 2.001, 2.009, 2.0052, 2.173, 2.174, 2.002):
        row, samples = sampler.row(time), sampler.samples
        nearest = time if time != 2.0052 else 2.005
        expected = plan.sample(nearest)
        np.testing.assert_allclose(samples.motion.com[row], expected.com, atol=1e-12)
        np.testing.assert_array_equal(samples.motion.forces[row], expected.forces)
        com = [expected.com, expected.com_velocity, expected.com_acceleration]
        np.testing.assert_allclose(samples.com[row], np.concatenate(com), atol=1e-9)
        turning = [expected.angular_momentum, expected.angular_momentum_rate]
        np.testing.assert_allclose(samples.angular_momentum[row], np.concatenate(turning), atol=1e-9)
    sampler.clear()
    assert sampler.plan is None
