"""Legs: their chains and planes; distances between links."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Robot, RobotSpec, leg_chain, leg_normals, load_robot, upper_body_joints
from lgmpc.robot.collision import LinkPairs, read_geometry
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


def test_distances_of_links_are_those_of_their_spheres() -> None:
    """Not of links that share a joint, nor of those that overlap in the reference posture."""
    model, geometry, radii = pin.Model(), pin.GeometryModel(), (0.1, 0.1, 0.15, 0.2)
    for i, radius in enumerate(radii):
        joint = model.addJoint(i, pin.JointModelTranslation(), pin.SE3.Identity(), f"joint {i}")
        frame = model.addFrame(pin.Frame(f"link {i}", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        part = pin.GeometryObject(f"part {i}", joint, frame, pin.SE3.Identity(), coal.Sphere(radius))
        geometry.addGeometryObject(part)
    reference = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, -0.2, 0.2])  # link 3 is in link 1
    pairs = LinkPairs(model, geometry, reference)
    q = np.random.default_rng(0).normal(scale=0.3, size=(200, 12))
    least, names = pairs.distances(q)
    places = np.cumsum(q.reshape(-1, 4, 3), axis=1)
    expected = {
        f"link {a} and link {b}": np.linalg.norm(places[:, a] - places[:, b], axis=1) - radii[a] - radii[b]
        for a, b in ((0, 2), (0, 3))
    }
    np.testing.assert_allclose(least, np.min(list(expected.values()), axis=0), atol=1e-9)
    np.testing.assert_allclose(least, [expected[name][k] for k, name in enumerate(names)], atol=1e-9)
    assert (least < 0.0).any() and (least > 0.0).any()
    np.testing.assert_array_equal(pairs.between([[1, 2], [4]]), [name.endswith("and link 3") for name in pairs.names])


def test_geometry_of_links_that_the_model_lacks_is_left_out() -> None:
    """The URDF of Talos' legs is that of the whole robot: its trunk and arms are welded to the base in the model."""
    legs = load_robot(RobotSpec(model="talos_legs", armature_kg_m2=0.1))
    model, data = legs.model, legs.create_data()
    geometry = read_geometry(model, legs.source)
    links = [model.frames[part.parentFrame].name for part in geometry.geometryObjects]
    sides = [f"leg_{side}_{i}_link" for side in ("left", "right") for i in range(1, 7)]
    assert links == ["base_link", *sides]
    assert [model.names[part.parentJoint] for part in geometry.geometryObjects[1:]] == [
        side.replace("link", "joint") for side in sides
    ]
    found = geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, found, legs.q_reference)
    for part, placement in zip(geometry.geometryObjects, found.oMg, strict=True):
        assert placement.isApprox(pin.updateFramePlacement(model, data, part.parentFrame))
