"""Feet as patches: soles from corners and from collision geometry, and conversions between feet and their points."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yaml

from lgmpc import RobotSpec, load_config
from lgmpc.errors import ConfigError, ModelError
from lgmpc.robot import FootPoints, load_robot

TALOS = {"model": "talos", "posture": "half_sitting", "armature_kg_m2": {"gripper_*": 0.1}}
SQUARE = [[0.1, 0.05], [-0.1, 0.05], [-0.1, -0.05], [0.1, -0.05]]
BOTH = ("left_sole_link", "right_sole_link")


def talos(*soles, **more):
    feet = [{"frame": frame, "sole": sole} for frame, sole in zip(BOTH, soles, strict=True)]
    return RobotSpec.model_validate({**TALOS, "feet": feet, **more}, strict=False)


@pytest.fixture(scope="module")
def standing():
    return load_robot(talos("auto", SQUARE))


def test_a_sole_is_found_in_the_collision_geometry(standing):
    """Talos' foot is 0.21 x 0.124 m, its lower face rounded at the edges, 1 mm below the frame of its sole."""
    foot = standing.feet[0]
    assert foot.size == pytest.approx((0.205, 0.124), abs=0.006)
    assert abs(foot.position[2]) < 1e-3
    x, y = (foot.points - np.roll(foot.points, 1, axis=0)).T
    assert ((x * np.roll(y, -1) - y * np.roll(x, -1)) > 0).all()  # convex, counterclockwise


def test_each_corner_is_a_contact_point_and_each_sole_a_foot(standing):
    data = standing.create_data()
    pin.framesForwardKinematics(standing.model, data, standing.q_reference)
    points = np.array([data.oMf[i].translation for i in standing.contact_ids])
    assert standing.nf == 2 and standing.nc == 8 and standing.foot_names == BOTH
    centres = np.array([data.oMf[i].translation for i in standing.foot_ids])
    np.testing.assert_allclose(centres, points.reshape(2, 4, 3).mean(axis=1), atol=1e-12)
    assert np.abs(points[:, 2]).max() < 1e-3 and points[:, 2].min() == pytest.approx(0.0, abs=1e-12)


def test_points_of_a_turned_foot_are_where_its_rotation_puts_them(standing):
    """Against Pinocchio: the whole robot turned by a yaw, and by a tilt that the surface shares."""
    patches, data, q = standing.foot_points, standing.create_data(), standing.q_reference.copy()
    tilt = pin.exp3(np.array([0.1, -0.2, 0.0]))
    for yaw, turn in ((0.7, np.eye(3)), (-2.5, np.eye(3)), (0.0, tilt)):
        q[3:7] = pin.Quaternion(turn @ pin.rpy.rpyToMatrix(0.0, 0.0, yaw)).coeffs()
        pin.framesForwardKinematics(standing.model, data, q)
        points = np.array([data.oMf[i].translation for i in standing.contact_ids])
        centres = patches.mean(points)
        if turn is not tilt:
            np.testing.assert_allclose(patches.yaws(points), yaw, atol=1e-3)  # the posture is levelled by 0.2 mrad
        placed = patches.place(centres, np.full(2, yaw), turn[:, 2])
        np.testing.assert_allclose(placed, points, atol=1e-4)


def test_point_feet_are_their_points(solo_spec):
    solo12 = load_robot(solo_spec)
    patches, values = solo12.foot_points, np.arange(12.0).reshape(4, 3)
    flags = np.array([True, False, True, True])
    assert patches.single and solo12.nf == solo12.nc and solo12.foot_ids == solo12.contact_ids
    assert patches.spread(values) is values and patches.mean(values) is values
    assert patches.place(values, np.zeros(4), np.array([0.0, 0.0, 1.0])) is values and patches.touching(flags) is flags


def test_a_foot_touches_if_one_of_its_points_does():
    patches = FootPoints((4, 1, 3), np.zeros((8, 3)))
    flags = np.array([0, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert patches.touching(flags).tolist() == [True, False, True]
    assert patches.spread(np.array([5, 6, 7])).tolist() == [5, 5, 5, 5, 6, 7, 7, 7]
    assert patches.spread(["a", "b", "c"]) == ["a"] * 4 + ["b"] + ["c"] * 3
    assert patches.mean(np.arange(8.0)).tolist() == [1.5, 4.0, 6.0]
    assert patches.total(np.arange(8.0)).tolist() == [6.0, 4.0, 18.0]


@pytest.mark.parametrize(
    ("sole", "words"),
    [
        ([[0.1, 0.05], [-0.1, 0.05], [0.0, 0.05]], "corners within 200.0 x 0.0 mm; expected three or more that span"),
        ([[2.0 * x, 3.0 * y] for x, y in SQUARE], "a sole of 0.400 x 0.300 m; expected at most 1.5 times its link's"),
        ([*SQUARE, [0.0, 0.0]], "5 corners of which 4 are on their hull; expected a convex sole"),
    ],
)
def test_soles_that_cannot_be_are_refused(sole, words):
    with pytest.raises(ModelError, match=r"feet.1.sole") as error:
        load_robot(talos("auto", sole))
    assert words in str(error.value)


def test_soles_that_overlap_are_refused():
    spec = talos(SQUARE, SQUARE).replace({"feet.0.position_m": (0.0, -0.15, 0.0)})
    with pytest.raises(ModelError, match="soles of left_sole_link and right_sole_link overlap"):
        load_robot(spec)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"feet": [{"frame": "a", "sole": [[0, 0], [1, 0]]}]}, "feet.0.sole"),
        ({"feet": [{"frame": "a"}, {"frame": "a"}]}, "feet.1.frame"),
        ({"feet": [{"frame": "a"}], "contact_frames": ["b"]}, "contact_frames"),
        ({"feet": [{"frame": "a"}], "contact_radius_m": 0.01}, "contact_radius_m"),
        ({"feet": [{"frame": "a", "sole": "flat"}]}, "feet.0.sole"),
    ],
)
def test_specs_that_contradict_themselves_are_refused(change, words, tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump({"name": "a", "robot": {**TALOS, **change}}))
    with pytest.raises(ConfigError) as error:
        load_config(path)
    assert f"robot.{words}" in str(error.value)
    assert "\n" not in str(error.value).strip()
