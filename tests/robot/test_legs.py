"""Distances between legs: against coal's capsules, and legs that cross."""

from __future__ import annotations

from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Robot, RobotSpec, leg_clearances, load_robot


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


def test_distances_are_those_of_capsules(robot: Robot) -> None:
    rng, data = np.random.default_rng(0), robot.create_data()
    q = np.tile(robot.q_reference, (200, 1))
    q[:, 7:] += rng.normal(size=(200, 12))
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
