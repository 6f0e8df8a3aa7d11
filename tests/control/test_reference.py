from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.lying import LegRetraction, LyingSettings, RiseMotion
from lgmpc.control.reference import CircleReference, DesiredMotion, MotionTasks, StandReference
from lgmpc.errors import InputError
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.settings import LocomotionSettings
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot.lying import lying_posture

CONFIGS = Path(__file__).parents[2] / "configs"

CIRCLE = CircleReference(radius_m=0.03, frequency_hz=0.5, start_s=0.5, ramp_s=2.0)


def test_standing_stays():
    for rows in StandReference().sample(np.linspace(0, 1, 5)):
        np.testing.assert_array_equal(rows, np.zeros((5, 3)))


def test_velocity_and_acceleration_are_the_derivatives():
    h = 1e-5
    times = np.concatenate([np.linspace(0.0, 5.0, 301), [0.5, 0.5 + 1e-3, 2.5 - 1e-3, 2.5]])
    offset, velocity, acceleration = CIRCLE.sample(times)
    (before, v_before, _), (after, v_after, _) = CIRCLE.sample(times - h), CIRCLE.sample(times + h)
    np.testing.assert_allclose(velocity, (after - before) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(acceleration, (v_after - v_before) / (2 * h), atol=1e-5)
    assert np.abs(velocity).max() > 0.05 and np.abs(acceleration).max() > 0.1


@pytest.mark.parametrize("seam", [0.5, 2.5])
def test_twice_continuous_at_begin_and_end_of_the_ramp(seam):
    below, above = (CIRCLE.sample(np.array([seam + side * 1e-9])) for side in (-1, 1))
    for one, other in zip(below, above, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)


def test_it_rests_first_and_then_holds_radius_and_frequency():
    for rows in CIRCLE.sample(np.linspace(0.0, 0.5, 20)):
        np.testing.assert_array_equal(rows, np.zeros((20, 3)))
    times = np.linspace(2.5, 6.5, 200)
    offset, velocity, acceleration = CIRCLE.sample(times)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 0.03, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 0.03 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(acceleration, -(np.pi**2) * offset, atol=1e-12)
    np.testing.assert_allclose(CIRCLE.sample(times + 2.0)[0], offset, atol=1e-12)  # one turn in 2 s
    assert not offset[:, 2].any()


def test_the_radius_grows_without_overshoot():
    radius = np.linalg.norm(CIRCLE.sample(np.linspace(0.5, 2.5, 500))[0], axis=1)
    assert (np.diff(radius) >= 0).all() and radius[-1] == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("argument", "value"),
    [("radius_m", 0.0), ("frequency_hz", -0.5), ("ramp_s", 0.0), ("radius_m", np.nan), ("start_s", np.inf)],
)
def test_circles_that_are_none_are_refused(argument, value):
    with pytest.raises(InputError, match=f"^{argument}: got"):
        CircleReference(**({"radius_m": 0.03, "frequency_hz": 0.5} | {argument: value}))


def test_a_lying_robot_has_the_base_of_its_lying_posture_as_target() -> None:
    """Turned and shifted: the centre of mass descends less than the base, as the legs fold beside it."""
    config = load_config(CONFIGS / "solo12_rise.yaml")
    robot = build_robot(config)
    lying, data = lying_posture(robot), robot.create_data()
    heights = [float(pin.centerOfMass(robot.model, data, q)[2]) for q in (lying, robot.q_reference)]
    tasks, legs = MotionTasks.of(build_controller(config, robot).wbc.tasks), LegGeometry.of(robot)
    desired = DesiredMotion(robot, legs, LocomotionSettings(), None)
    folding, lift = LegRetraction(robot, LyingSettings()), RiseMotion(LyingSettings())
    desired.builder.begin(np.array([3.0, -2.0, 0.0]), 0.7)
    desired.place(0.0, TerrainBelief(robot.nc, legs.height))
    com, base = desired.target.copy(), desired.base_target.copy()
    lift.begin(0.0, np.array([0.02, -0.01, heights[0] - heights[1]]), np.zeros(3))
    lift.update(0.0)
    desired.rise(lift, folding)
    desired.write_base(tasks)
    desired.write_balance(tasks)
    np.testing.assert_allclose(desired.target - com, [0.02, -0.01, heights[0] - heights[1]], atol=1e-12)
    descent = [0.02, -0.01, lying[2] - robot.q_reference[2]]
    np.testing.assert_allclose(desired.base_target[:3] - base[:3], descent, atol=1e-12)
    np.testing.assert_array_equal(desired.base_target[3:], base[3:])
    assert abs(heights[0] - heights[1] - descent[2]) > 1e-3
    np.testing.assert_array_equal(tasks.com.target.position, desired.target)
    np.testing.assert_array_equal(tasks.base_position.target.position, desired.base_target[:3])
    np.testing.assert_allclose(tasks.posture.target.position, lying[robot.joint_q], atol=1e-12)
