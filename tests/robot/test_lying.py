"""The lying posture: feet in their places, trunk on the floor, within the joints' limits."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.robot.lying import crouching_posture, lowest_point, lying_posture, place_feet

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


def solo(**changes: object) -> Robot:
    spec = {
        "model": "solo12",
        "contact_frames": FEET,
        "contact_radius_m": 0.016,
        "posture": "standing",
        "effort_limit_nm": 1.8,
        "velocity_limit_rad_s": 30.0,
        "position_limit_rad": {"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
        "armature_kg_m2": 3.6e-4,
        "collision_shapes": (
            {"kind": "sphere", "link": "*_LOWER_LEG", "radius_m": 0.012},
            {"kind": "box", "link": "base_link", "half_size_m": (0.20, 0.08, 0.03)},
        ),
    }
    return load_robot(RobotSpec.model_validate(spec | changes))


def feet(robot: Robot, q: np.ndarray) -> np.ndarray:
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    return np.array([data.oMf[frame].translation for frame in robot.contact_ids])


def test_solo12_lies_on_its_trunk_with_its_feet_where_they_stand() -> None:
    robot = solo()
    q = lying_posture(robot)
    assert q[2] == pytest.approx(0.03, abs=1e-9)  # half the height of the trunk's box
    np.testing.assert_allclose(feet(robot, q), feet(robot, robot.q_reference), atol=1e-4)
    assert lowest_point(robot, q) == pytest.approx(0.0, abs=1e-4)
    joints = q[robot.joint_q]
    assert (joints > robot.joint_lower).all() and (joints < robot.joint_upper).all()


def test_round_feet_roll_under_a_robot_that_crouches_until_its_hips_are_near_their_limits() -> None:
    """With straight hips everything moves in planes, in which a foot's centre goes r times the lower leg's angle."""
    robot = solo(posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6})
    q = crouching_posture(robot, 0.03)
    moved = feet(robot, q) - feet(robot, robot.q_reference)
    change = (q - robot.q_reference)[robot.joint_q].reshape(4, 3)
    np.testing.assert_allclose(moved[:, 0], 0.016 * change[:, 1:].sum(axis=1), atol=5e-4)  # in steps of 1 cm
    np.testing.assert_allclose(moved[:, 2], 0.0, atol=1e-4)
    assert moved[0, 0] < -0.005
    margin = np.minimum(q[robot.joint_q] - robot.joint_lower, robot.joint_upper - q[robot.joint_q])
    assert 0.05 <= margin.min() < 0.1


def test_a_crouch_does_not_go_below_the_given_height() -> None:
    assert crouching_posture(solo(), 0.2)[2] == 0.2


def test_legs_that_fold_less_end_higher() -> None:
    """With the knees limited to 2 rad the base stays where the legs are as short as that allows."""
    robot = solo(position_limit_rad={"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.0, 2.0)})
    q = lying_posture(robot)
    assert 0.15 < q[2] < 0.2
    np.testing.assert_allclose(feet(robot, q), feet(robot, robot.q_reference), atol=1e-4)
    assert np.abs(q[robot.joint_q]).max() < 2.0


def test_feet_out_of_reach_are_none() -> None:
    robot = solo()
    far = feet(robot, robot.q_reference) + [0.5, 0.0, 0.0]
    assert place_feet(robot, robot.q_reference, robot.q_reference[:3], far) is None


@pytest.mark.parametrize("model", ["anymal_c", "go2"])
def test_other_quadrupeds_fold_their_legs(model: str) -> None:
    names = {
        "anymal_c": ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
        "go2": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
    }
    limits = {"position_limit_rad": {"*": (-3.0, 3.0)}} if model == "anymal_c" else {}
    robot = load_robot(RobotSpec(model=model, contact_frames=names[model], contact_radius_m=0.02, **limits))
    q = lying_posture(robot)
    assert q[2] < 0.5 * robot.q_reference[2]
    assert lowest_point(robot, q) > -1e-3


def test_an_arm_does_not_lie() -> None:
    with pytest.raises(InputError, match="a floating base and contact frames"):
        lying_posture(load_robot(RobotSpec(model="panda")))
