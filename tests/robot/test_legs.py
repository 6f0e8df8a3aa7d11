"""Legs: their chains and planes, and the distances between them against coal's capsules."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Robot, RobotSpec, leg_chain, leg_clearances, leg_normals, load_robot, upper_body_joints
from tests.support.samples import b1_with_arm, solo8


@pytest.fixture(scope="module")
def robot() -> Robot:
    frames = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=frames,
            contact_radius_m=0.016,
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
        )
    )


def capsule(radius: float, one: np.ndarray, other: np.ndarray) -> tuple[coal.Capsule, coal.Transform3s]:
    along = other - one
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / np.linalg.norm(along)).matrix()
    return coal.Capsule(radius, float(np.linalg.norm(along))), coal.Transform3s(turn, 0.5 * (one + other))


@pytest.mark.parametrize("planar", [False, True], ids=["solo12", "solo8"])
def test_distances_are_those_of_capsules(robot: Robot, planar: bool) -> None:
    robot = solo8() if planar else robot
    rng, data = np.random.default_rng(0), robot.create_data()
    q = np.tile(robot.q_reference, (200, 1))
    q[:, 7:] += rng.normal(size=(200, robot.nu))
    expected = []
    for each in q:
        pin.framesForwardKinematics(robot.model, data, each)
        legs = []
        for frame in robot.contact_ids:
            knee = robot.model.frames[frame].parentJoint
            points = [data.oMi[knee - 1].translation, data.oMi[knee].translation, data.oMf[frame].translation]
            legs.append([capsule(0.016, a, b) for a, b in zip(points, points[1:], strict=False)])
        pairs = [(a, b) for one, other in combinations(legs, 2) for a in one for b in other]
        expected.append(min(coal.distance(*a, *b, coal.DistanceRequest(True), coal.DistanceResult()) for a, b in pairs))
    found = leg_clearances(robot, q)
    assert (found < 0.0).any() and (found > 0.0).any()
    apart = found > 1e-3  # of overlapping shapes coal gives the depth, which is another measure
    np.testing.assert_allclose(found[apart], np.array(expected)[apart], atol=1e-6)
    np.testing.assert_array_equal(found < 0.0, np.array(expected) < 0.0)


def names(robot: Robot, joints: list[int]) -> list[str]:
    return [robot.model.names[joint] for joint in joints]


def test_a_leg_begins_with_the_joint_that_swings_it_ahead(robot: Robot) -> None:
    assert names(robot, leg_chain(robot, robot.contact_ids[0])) == ["FL_HFE", "FL_KFE"]
    planar = solo8()
    assert names(planar, leg_chain(planar, planar.contact_ids[3])) == ["HR_HFE", "HR_KFE"]


def test_planar_legs_have_the_normal_of_their_plane(robot: Robot) -> None:
    """No motion of their joints, however large, moves the feet along it."""
    np.testing.assert_array_equal(leg_normals(robot), np.zeros((4, 3)))
    planar, rng = solo8(), np.random.default_rng(1)
    normals, data = leg_normals(planar), planar.create_data()
    np.testing.assert_allclose(np.abs(normals), np.tile([0.0, 1.0, 0.0], (4, 1)), atol=1e-9)
    turned = np.concatenate([[0.3, -0.2, 0.5], pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()])
    for _ in range(10):
        q = np.concatenate([turned, rng.uniform(-2.0, 2.0, 8)])
        pin.framesForwardKinematics(planar.model, data, q)
        for normal, frame in zip(normals, planar.contact_ids, strict=True):
            pin.framesForwardKinematics(planar.model, data, q)
            moved = data.oMi[1].actInv(data.oMf[frame].translation)
            pin.framesForwardKinematics(planar.model, data, planar.q_reference)
            assert normal @ (moved - data.oMi[1].actInv(data.oMf[frame].translation)) == pytest.approx(0.0, abs=1e-9)


def test_a_leg_that_only_slides_is_not_planar(data_dir: Path) -> None:
    """Two directions are normal to its motion."""
    feet = ("foot_a", "foot_b", "foot_c")
    robot = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf", contact_frames=feet, posture={"slide_*": 0.2}))
    np.testing.assert_array_equal(leg_normals(robot), np.zeros((3, 3)))


def test_joints_of_an_arm_are_on_no_leg(robot: Robot) -> None:
    assert upper_body_joints(robot) == []
    both = b1_with_arm()
    assert names(both, upper_body_joints(both)) == [*(f"joint{i}" for i in range(1, 7)), "jointGripper"]
