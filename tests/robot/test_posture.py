"""The reference posture, and its placement on the ground."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yaml

from lgmpc.errors import ModelError
from lgmpc.robot import Robot, RobotSpec, load_robot

FEET = ("foot_a", "foot_b", "foot_c")


def contact_points(robot: Robot) -> np.ndarray:
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    return np.array([data.oMf[i].translation - [0, 0, robot.contact_radius] for i in robot.contact_ids])


def test_solo_stands_on_four_feet(solo_spec) -> None:
    robot = load_robot(solo_spec)
    assert np.abs(contact_points(robot)[:, 2]).max() < 1e-15
    assert robot.q_reference[:2].tolist() == [0, 0]
    assert robot.q_reference[3:7].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("radius", [0.0, 0.016])
def test_the_contact_points_touch_the_ground(solo_spec, radius: float) -> None:
    robot = load_robot(solo_spec.replace({"contact_radius_m": radius, "posture": "straight_standing"}))
    assert contact_points(robot)[:, 2].min() == pytest.approx(0, abs=1e-15)


def test_uneven_legs_tilt_the_base_until_all_feet_touch(data_dir) -> None:
    spec = RobotSpec(
        urdf=data_dir / "tripod.urdf",
        contact_frames=FEET,
        contact_radius_m=0.02,
        posture={"slide_a": 0.3, "slide_b": 0.2},
    )
    robot = load_robot(spec)
    assert np.abs(contact_points(robot)[:, 2]).max() < 1e-15
    rotation = pin.Quaternion(robot.q_reference[3:7])
    assert abs(rotation.toRotationMatrix()[2, 2]) < 0.999
    assert rotation.z == pytest.approx(0, abs=1e-12)  # the smallest rotation: no yaw
    assert np.linalg.norm(robot.q_reference[3:7]) == pytest.approx(1, abs=1e-15)
    assert not any("height" in note for note in robot.notes)


def test_feet_that_cannot_all_touch_are_noted(data_dir) -> None:
    robot = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf", contact_frames=(*FEET, "foot_d"), posture={}))
    assert robot.notes[1:] == ("in the reference posture the contact points differ by 200.0 mm in height",)
    assert contact_points(robot)[:, 2].min() == pytest.approx(0, abs=1e-15)
    assert robot.q_reference[6] == 1


def test_two_feet_leave_the_base_upright(data_dir) -> None:
    spec = RobotSpec(urdf=data_dir / "tripod.urdf", contact_frames=FEET[:2], posture={"slide_a": 0.3})
    robot = load_robot(spec)
    assert robot.q_reference[6] == 1 and "differ by 200.0 mm" in robot.notes[1]


def test_a_steep_plane_of_hands_and_feet_is_not_levelled(data_dir, tmp_path) -> None:
    path = tmp_path / "wall.urdf"
    text = (data_dir / "tripod.urdf").read_text()
    path.write_text(
        text.replace(
            '<parent link="leg_a"/><child link="foot_a"/><origin xyz="0 0 -0.2"/>',
            '<parent link="leg_a"/><child link="foot_a"/><origin xyz="0 0 1.2"/>',
        )
    )
    assert load_robot(RobotSpec(urdf=path, contact_frames=FEET)).q_reference[6] == 1


def test_named_postures(data_dir, solo_spec) -> None:
    spec = RobotSpec(urdf=data_dir / "tripod.urdf", srdf=data_dir / "tripod.srdf", posture="tall")
    robot = load_robot(spec)
    assert robot.q_reference[7:10].tolist() == [0.35] * 3
    assert robot.armature.tolist() == [0, 0, 0, 2e-5 * 100]
    with pytest.raises(ModelError, match="posture: no reference configuration is named 'tal'; there are tall"):
        load_robot(spec.replace({"posture": "tal"}))
    with pytest.raises(ModelError, match="named 'tall'; the model has none"):
        load_robot(spec.replace({"srdf": None}))
    assert load_robot(solo_spec).q_reference[8] == 0.8  # the named model's own


def test_joints_not_named_stay_inside_their_limits() -> None:
    robot = load_robot(RobotSpec(model="panda", posture={"panda_joint1": 1.0}))
    assert robot.q_reference[:4].tolist() == [1.0, 0.0, 0.0, -0.0698]


def test_a_posture_outside_the_limits() -> None:
    with pytest.raises(ModelError) as caught:
        load_robot(RobotSpec(model="panda", posture={"panda_joint4": 0.1}))
    assert caught.value.problems == (
        "the reference posture has panda_joint4 at 0.1, outside its limits [-3.072, -0.0698]",
    )


def test_a_models_own_posture_is_moved_into_the_limits() -> None:
    robot = load_robot(RobotSpec(model="kinova"))
    (note,) = robot.notes
    assert note.startswith("its own posture 'arm_up' is outside the limits of j2s6s200_joint_3; ")
    lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    joint = robot.model.joints[robot.model.getJointId("j2s6s200_joint_3")].idx_q
    assert lower[joint] <= robot.q_reference[joint] <= upper[joint]


def test_a_posture_is_proposed_to_a_robot_that_would_start_at_its_limits() -> None:
    """Go2's knees cannot be straight. With the proposed posture each foot is below its thigh, off every limit."""
    usual = load_robot(RobotSpec(model="go2"))
    feet = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
    spec = RobotSpec(urdf=usual.source.urdf, contact_frames=feet, package_dirs=usual.source.package_dirs)
    robot = load_robot(spec)
    knees = [name for name in robot.joint_names if "calf" in name]
    (note,) = robot.notes
    assert note.startswith(f"without a posture {', '.join(knees)} start at a limit; ")
    posture = yaml.safe_load(note[note.index("posture: {") :])["posture"]
    proposed = load_robot(spec.replace({"posture": posture}))
    assert proposed.notes == ()
    q, margin = proposed.q_reference[7:], 0.08 * (robot.joint_upper - robot.joint_lower)
    assert (robot.joint_lower + margin < q).all() and (q < robot.joint_upper - margin).all()
    data = proposed.create_data()
    pin.framesForwardKinematics(proposed.model, data, proposed.q_reference)
    for foot in feet:
        thigh = proposed.model.getJointId(foot.replace("foot", "thigh_joint"))
        away = data.oMf[proposed.frame(foot)].translation - data.oMi[thigh].translation
        assert abs(away[0]) < 5e-3 and away[2] < -0.25


def test_a_robot_on_soles_without_a_posture_is_refused_with_one_to_paste() -> None:
    """G1's neutral legs are straight. In the proposed posture it stands on flat soles, its knees bent."""
    feet = [{"frame": f"{side}_ankle_roll_link", "sole": "auto"} for side in ("left", "right")]
    spec = RobotSpec.model_validate({"model": "g1", "feet": feet, "armature_kg_m2": 0.01}, strict=False)
    with pytest.raises(ModelError) as caught:
        load_robot(spec)
    (problem,) = caught.value.problems
    assert problem.startswith("posture: none is given, and its files have none; expected one with flat soles and bent ")
    robot = load_robot(spec.replace({"posture": yaml.safe_load(problem[problem.index("posture: {") :])["posture"]}))
    assert robot.notes == () and np.ptp(contact_points(robot)[:, 2]) < 1e-3
    angles = dict(zip(robot.joint_names, robot.q_reference[7:], strict=True))
    assert min(angles["left_knee_joint"], angles["right_knee_joint"]) > 0.3
    com = pin.centerOfMass(robot.model, robot.create_data(), robot.q_reference)
    assert com[0] == pytest.approx(contact_points(robot)[:, 0].mean(), abs=0.02)
    assert load_robot(spec.replace({"posture": {}})).q_reference[7:] == pytest.approx(0.0)  # asked for
