"""Motion references: integrated commands on a lead, and poses that fit them."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.locomotion.command import CommandLimiter, CommandLimits, MotionCommand, VelocityRamp
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.reference import ReferenceBuilder, ReferenceSettings
from lgmpc.locomotion.terrain import TerrainBelief
from lgmpc.robot import Robot
from lgmpc.timegrid import TimeGrid

N, DT = 20, 0.02
HORIZON = TimeGrid(DT, N)


FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])


def level(height: float = 0.0) -> TerrainBelief:
    return sloped((0.0, 0.0), height)


def sloped(slope: tuple[float, float], height: float = 0.0) -> TerrainBelief:
    """The belief of a robot that stands on a plane of this slope, ``height`` at the origin."""
    belief, points = TerrainBelief(4, 0.24), FEET.copy()
    points[:, 2] = height + points[:, :2] @ slope
    belief.begin(points)
    return belief


def written(builder: ReferenceBuilder, robot: Robot, command: MotionCommand, height: float = 0.0) -> MotionReference:
    reference = MotionReference.standing(robot, N, np.zeros(3))
    builder.write(reference, command, HORIZON, level(height))
    return reference


def test_at_rest_it_is_the_reference_posture(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    com = pin.centerOfMass(solo12.model, solo12.create_data(), solo12.q_reference)
    builder.begin(com, 0.0)
    reference = written(builder, solo12, MotionCommand())
    np.testing.assert_allclose(reference.q, np.tile(solo12.q_reference, (N + 1, 1)), atol=1e-9)
    np.testing.assert_allclose(reference.com, np.tile(com, (N + 1, 1)), atol=1e-9)
    assert not reference.com_velocity.any() and not reference.angular_velocity.any()


def test_every_pose_has_its_centre_of_mass_where_the_reference_has_it(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    builder.begin(np.array([1.0, -2.0, 0.0]), 2.5)
    command = MotionCommand(0.5, -0.2, 1.5, 0.02, 0.2, -0.1)
    reference = written(builder, solo12, command, height=0.3)
    data = solo12.create_data()
    for k in (0, 7, N):
        np.testing.assert_allclose(pin.centerOfMass(solo12.model, data, reference.q[k]), reference.com[k], atol=1e-9)
        rotation = pin.Quaternion(reference.q[k, 3:7]).matrix()
        expected = pin.rpy.rpyToMatrix(command.roll, command.pitch, 2.5 + 1.5 * DT * k)
        np.testing.assert_allclose(rotation, expected, atol=1e-12)
    assert reference.com[0, 2] == pytest.approx(0.3 + legs.height + 0.02)


def test_positions_are_the_integral_of_velocities_in_a_turn(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    builder.begin(np.zeros(3), 0.4)
    command = MotionCommand(vx=0.8, vy=0.1, yaw_rate=2.0)
    reference = written(builder, solo12, command)
    assert np.linalg.norm(reference.com_velocity, axis=1) == pytest.approx(math.hypot(0.8, 0.1))
    np.testing.assert_allclose(reference.angular_velocity, np.tile([0.0, 0.0, 2.0], (N + 1, 1)))
    # Moving on step by step comes to the same nodes.
    com = np.zeros(3)
    for k in range(N):
        np.testing.assert_allclose([builder.x, builder.y], reference.com[k, :2], atol=1e-4)
        for _ in range(20):
            builder.advance(1e-3, command)
            com[:2] = builder.x, builder.y


def test_a_robot_that_is_displaced_turns_at_the_commanded_velocity(solo12: Robot, legs: LegGeometry) -> None:
    """At the commanded velocity, off the desired position, it keeps its displacement in its own axes."""
    builder, command = ReferenceBuilder(solo12, legs), MotionCommand(vx=0.4, vy=-0.1, yaw_rate=1.5)
    builder.begin(np.zeros(3), 0.2)
    com, shift = np.array([0.02, -0.03, 0.2]), np.array([-0.02, 0.03])
    for _ in range(500):
        middle = builder.yaw + 0.5e-3 * command.yaw_rate
        com[:2] += 1e-3 * (pin.utils.rotate("z", middle) @ [command.vx, command.vy, 0.0])[:2]
        builder.advance(1e-3, command)
        builder.turn_about(com, 1e-3 * command.yaw_rate)
    turned = pin.utils.rotate("z", 500e-3 * command.yaw_rate)[:2, :2] @ shift
    np.testing.assert_allclose([builder.x - com[0], builder.y - com[1]], turned, atol=1e-9)


def test_a_horizon_foresees_how_the_limited_command_goes_on(solo12: Robot, legs: LegGeometry) -> None:
    """Following the limiter step by step comes to the nodes that were written at the start."""
    builder, limiter = ReferenceBuilder(solo12, legs), CommandLimiter(CommandLimits(acceleration_m_s2=2.0))
    builder.begin(np.zeros(3), 0.4)
    wanted = MotionCommand(0.3, -0.2)
    command = limiter.step(wanted, 1e-3)
    reference = MotionReference.standing(solo12, N, np.zeros(3))
    builder.write(reference, command, HORIZON, level(), limiter.ramp)
    assert 0.0 < limiter.ramp.duration < N * DT
    for k in range(N):
        np.testing.assert_allclose([builder.x, builder.y], reference.com[k, :2], atol=3e-4)
        np.testing.assert_allclose(builder.velocity(command), reference.com_velocity[k, :2], atol=1e-9)
        for _ in range(20):
            builder.advance(1e-3, command)
            command = limiter.step(wanted, 1e-3)
    assert limiter.ramp == VelocityRamp() and command.vx == 0.3


def test_the_desired_position_is_no_further_ahead_than_its_lead(solo12: Robot, legs: LegGeometry) -> None:
    settings = ReferenceSettings(max_reference_lead_m=0.04, max_yaw_lead_rad=0.2)
    builder = ReferenceBuilder(solo12, legs, settings)
    com = np.array([0.0, 0.0, 0.2])
    builder.begin(com, 0.0)
    for _ in range(1000):  # held in place against a command
        builder.advance(1e-3, MotionCommand(vx=0.5, yaw_rate=1.0))
        builder.shorten(com, 0.0)
    assert math.hypot(builder.x, builder.y) == pytest.approx(0.04)
    assert builder.yaw == pytest.approx(0.2)
    com[:2] = 1.0, -1.0  # pushed far away
    builder.advance(1e-3, MotionCommand())
    builder.shorten(com, 0.0)
    assert math.hypot(builder.x - 1.0, builder.y + 1.0) == pytest.approx(0.04)


def test_the_heading_counts_turns(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    builder.begin(np.zeros(3), 3.0)
    for k in range(1, 3001):
        measured = math.remainder(3.0 + 2e-3 * k, 2.0 * math.pi)
        builder.advance(1e-3, MotionCommand(yaw_rate=2.0))
        builder.shorten(np.zeros(3), measured)
    assert builder.yaw == pytest.approx(9.0)


def test_the_velocity_is_turned_into_the_world(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    builder.begin(np.zeros(3), 0.5 * math.pi)
    assert builder.velocity(MotionCommand(vx=0.5, vy=0.2)) == pytest.approx((-0.2, 0.5))


def test_the_pose_of_now_is_the_first_node_of_the_horizon(solo12: Robot, legs: LegGeometry) -> None:
    builder = ReferenceBuilder(solo12, legs)
    builder.begin(np.array([1.0, -2.0, 0.0]), 2.5)
    for command in (MotionCommand(), MotionCommand(0.5, -0.2, 1.5, 0.02, 0.2, -0.1), MotionCommand(0.5, roll=0.1)):
        builder.advance(0.1, command)
        reference, pose = written(builder, solo12, command, height=0.3), builder.pose(command, level(0.3))
        np.testing.assert_allclose(pose.centre[:3], reference.com[0], atol=1e-12)
        np.testing.assert_allclose(pose.centre[3:6], reference.com_velocity[0], atol=1e-12)
        np.testing.assert_allclose(pose.base_pose, reference.q[0, :7], atol=1e-12)
        rotation = pose.attitude[:9].reshape(3, 3)
        np.testing.assert_allclose(rotation, pin.Quaternion(pose.base_pose[3:]).matrix(), atol=1e-12)
        turning = rotation @ pose.attitude[9:]
        np.testing.assert_allclose(turning, reference.angular_velocity[0], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_on_a_slope_the_base_is_parallel_to_it_and_the_way_rises_with_it(
    solo12: Robot, legs: LegGeometry, yaw: float
) -> None:
    builder, ground = ReferenceBuilder(solo12, legs), sloped((0.2, -0.1), 0.4)
    slope = np.array(ground.slope)
    builder.begin(np.array([1.0, -2.0, 0.0]), yaw)
    command = MotionCommand(vx=0.5, vy=0.1)
    pose, reference = builder.pose(command, ground), MotionReference.standing(solo12, N, np.zeros(3))
    builder.write(reference, command, HORIZON, ground)
    normal = np.array([*-slope, 1.0]) / math.sqrt(1.0 + slope @ slope)
    rotation = pose.attitude[:9].reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 2], normal, atol=1e-9)
    assert math.atan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(yaw)
    np.testing.assert_allclose(reference.com[:, 2], 0.4 + reference.com[:, :2] @ slope + legs.height, atol=1e-9)
    np.testing.assert_allclose(reference.com_velocity[:, 2], reference.com_velocity[:, :2] @ slope, atol=1e-12)
    np.testing.assert_allclose(np.diff(reference.com, axis=0) / DT, reference.com_velocity[:-1], atol=1e-9)
    np.testing.assert_allclose(pose.centre[:3], reference.com[0], atol=1e-12)
    np.testing.assert_allclose(pose.base_pose[:3], reference.q[0, :3], atol=1e-12)
    turn = pin.Quaternion(reference.q[-1, 3:7]).matrix()
    np.testing.assert_allclose(turn, rotation, atol=1e-12)
    # The base carries the centre of mass of the reference posture.
    np.testing.assert_allclose(pose.centre[:3], pose.base_pose[:3] - rotation @ legs.base, atol=1e-12)
