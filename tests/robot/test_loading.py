"""Robots are loaded by their files and the config, without meshes; errors name what was found."""

from __future__ import annotations

import os
import pickle
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import example_robot_data
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError, ModelError
from lgmpc.robot import RobotSpec, available_models, load_robot
from lgmpc.robot.sources import build_model, resolve

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def test_a_robot_that_was_used_can_be_sent_to_another_process(solo_spec) -> None:
    robot = load_robot(solo_spec)
    used = robot.link_pairs.names, robot.foot_ids, robot.symbolic.nv
    copy = pickle.loads(pickle.dumps(robot))
    assert (copy.link_pairs.names, copy.foot_ids, copy.symbolic.nv) == used


def test_solo12_as_built(solo_spec) -> None:
    robot = load_robot(solo_spec)
    assert (robot.name, robot.nq, robot.nv, robot.nu, robot.nc) == ("solo12", 19, 18, 12, 4)
    assert robot.floating_base
    assert robot.mass == pytest.approx(2.5, abs=1e-2)
    assert robot.joint_names[:3] == ("FL_HAA", "FL_HFE", "FL_KFE")
    assert [robot.model.frames[i].name for i in robot.contact_ids] == list(solo_spec.contact_frames)
    assert (robot.effort_limit == 1.8).all() and (robot.model.effortLimit[6:] == 1.8).all()
    assert (robot.velocity_limit == 30).all() and (robot.model.velocityLimit[6:] == 30).all()
    assert (robot.armature == 3.6e-4).all() and (robot.model.armature == [0] * 6 + [3.6e-4] * 12).all()
    assert (robot.joint_lower == -10).all() and (robot.joint_upper == 10).all()
    assert robot.q_reference[robot.joint_q].shape == robot.x_reference[19:][robot.joint_v].shape == (12,)
    assert robot.gravity.tolist() == [0, 0, -9.81]


def test_model_is_that_of_the_official_loader(solo_spec, close) -> None:
    robot, official = load_robot(solo_spec.replace({"armature_kg_m2": 0.0})), example_robot_data.load("solo12")
    rng = np.random.default_rng(0)
    q = pin.integrate(robot.model, official.q0, rng.normal(size=18))
    v, a = rng.normal(size=(2, 18))
    expected = pin.rnea(official.model, official.data, q, v, a)
    close(pin.rnea(robot.model, robot.create_data(), q, v, a), expected, 1e-14)
    assert np.abs(robot.q_reference[7:] - official.q0[7:]).max() == 0
    assert robot.source.urdf.samefile(official.urdf)


def test_meshes_are_found_through_the_source(solo_spec) -> None:
    source = load_robot(solo_spec).source
    text = source.urdf.read_text()
    address = text[text.index("package://") + len("package://") :].split('"')[0]
    assert any((folder / address).is_file() for folder in source.package_dirs)


def test_loading_reads_no_mesh(data_dir) -> None:
    robot = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf"))
    assert "package://nowhere/body.stl" in robot.source.urdf.read_text()  # a mesh that does not exist


def test_arrays_are_read_only(solo_spec) -> None:
    robot = load_robot(solo_spec)
    for values in (robot.q_reference, robot.x_reference, robot.effort_limit, robot.joint_lower, robot.gravity):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


def test_bodies_for_pushes(solo_spec) -> None:
    robot = load_robot(solo_spec)
    assert robot.body_names[0] == "base_link" and "universe" not in robot.body_names
    frame = robot.model.frames[robot.body_frame("FL_LOWER_LEG")]
    assert (frame.name, robot.model.names[frame.parentJoint]) == ("FL_LOWER_LEG", "FL_KFE")
    with pytest.raises(InputError, match="body: got base_lnk; .*Did you mean base_link"):
        robot.body_frame("base_lnk")


def test_frames_that_share_their_name_with_a_joint() -> None:
    robot = load_robot(RobotSpec(model="anymal_c"))
    assert robot.model.frames[robot.frame("LF_HAA")].name == "LF_HAA"
    assert robot.model.frames[robot.body_frame("LF_HAA")].type == pin.BODY
    with pytest.raises(InputError, match="frame: got LF_HAX"):
        robot.frame("LF_HAX")


def test_values_by_name_pattern_and_default() -> None:
    spec = RobotSpec(
        model="anymal_c",
        effort_limit_nm={"LF_KFE": 7.0, "*": 50.0, "*_KFE": 60.0},
        velocity_limit_rad_s={"?H_*": 5.0},
        armature_kg_m2={"*_HAA": 0.2},
        position_limit_rad={"*_HFE": (-1.0, 2.0)},
        posture={"*_HFE": 0.5, "LH_HFE": -0.5},
    )
    robot = load_robot(spec)
    value = dict(zip(robot.joint_names, robot.effort_limit, strict=True))
    assert (value["LF_KFE"], value["RF_KFE"], value["RF_HFE"]) == (7.0, 60.0, 50.0)
    speed = dict(zip(robot.joint_names, robot.velocity_limit, strict=True))
    assert (speed["LH_HAA"], speed["LF_HAA"]) == (5.0, 7.5)
    assert sorted(set(robot.armature)) == [0.0, 0.2]
    names = list(robot.joint_names)
    hip = names.index("LF_HFE")
    assert (robot.joint_lower[hip], robot.joint_upper[hip]) == (-1.0, 2.0)
    assert robot.model.lowerPositionLimit[7 + hip] == -1.0
    assert robot.joint_upper[names.index("LF_HAA")] == 0.49
    joints = dict(zip(names, robot.q_reference[7:], strict=True))
    assert (joints["LF_HFE"], joints["LH_HFE"], joints["LF_KFE"]) == (0.5, -0.5, 0.0)


def test_one_sided_joints_stay_on_the_side_of_the_reference_posture(solo_spec) -> None:
    both = load_robot(solo_spec)
    robot = load_robot(solo_spec.replace({"one_sided_rad": {"*_KFE": 0.15}}))
    lower, upper = both.joint_lower.copy(), both.joint_upper.copy()
    for i, name in enumerate(robot.joint_names):
        if name.endswith("KFE"):
            behind = name.startswith("H")  # hind knees are bent to the other side than front knees
            lower[i], upper[i] = (0.15, upper[i]) if behind else (lower[i], -0.15)
    np.testing.assert_array_equal(robot.joint_lower, lower)
    np.testing.assert_array_equal(robot.joint_upper, upper)
    np.testing.assert_array_equal(robot.model.lowerPositionLimit[robot.joint_q], lower)


@pytest.mark.parametrize(
    ("sides", "words"),
    [
        ({"*_KNE": 0.1}, "one_sided_rad: '\\*_KNE' matches no joint"),
        ({"*_KFE": 1.7}, "the reference posture has FL_KFE at -1.6, outside its limits"),
    ],
)
def test_one_sided_joints_that_do_not_exist_or_are_too_near_to_zero(solo_spec, sides, words) -> None:
    with pytest.raises(ModelError, match=words):
        load_robot(solo_spec.replace({"one_sided_rad": sides}))


def test_rotor_parameters_of_the_srdf_are_the_armature_unless_given() -> None:
    talos = load_robot(RobotSpec(model="talos"))
    expected = talos.model.rotorInertia * talos.model.rotorGearRatio**2
    assert (talos.armature == expected[6:]).all() and talos.armature.max() > 0.05
    assert (load_robot(RobotSpec(model="talos", armature_kg_m2=0.0)).armature == 0).all()


def test_base_is_that_of_the_named_model_unless_given() -> None:
    assert not load_robot(RobotSpec(model="panda")).floating_base
    assert load_robot(RobotSpec(model="panda", floating_base=True)).nu == 9
    assert load_robot(RobotSpec(model="iris")).nu == 0


def test_joints_without_scalar_position(data_dir) -> None:
    robot = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf", posture={"spin": 0.5}))
    assert robot.joint_names == ("slide_a", "slide_b", "slide_c", "spin")
    assert robot.joint_lower.tolist() == [0.1, 0.1, 0.1, -np.inf]
    assert robot.q_reference[-2:].tolist() == [np.cos(0.5), np.sin(0.5)]


@pytest.mark.parametrize("name", ["talos_legs", "human", "panda_collision"])
def test_models_that_a_loader_changes_are_those_of_the_loader(name: str) -> None:
    limits = {"effort_limit_nm": 100.0, "velocity_limit_rad_s": 20.0, "position_limit_rad": (-3.0, 3.0)}
    robot, official = load_robot(RobotSpec(model=name, **limits)), example_robot_data.load(name)
    assert (robot.nq, robot.nv) == (official.nq, official.nv) and name in available_models()
    assert [each.translation.tolist() for each in robot.model.jointPlacements] == [
        each.translation.tolist() for each in official.model.jointPlacements
    ]
    assert robot.mass == pytest.approx(pin.computeTotalMass(official.model))
    with pytest.raises(InputError, match="floating_base: got .*as example-robot-data builds"):
        load_robot(RobotSpec(model=name, floating_base=not robot.floating_base))


def test_a_model_that_example_robot_data_cannot_load_quotes_it() -> None:
    with pytest.raises(ModelError, match="example-robot-data cannot load it: Building SDF models"):
        load_robot(RobotSpec(model="cassie"))


def test_bytes_that_are_no_text_are_named(tmp_path, data_dir) -> None:
    path = tmp_path / "name.urdf"
    path.write_bytes((data_dir / "tripod.urdf").read_bytes().replace(b'name="tripod"', b'name="tr\xffpod"'))
    with pytest.raises(ModelError, match="name.urdf: byte 0xff at [0-9]+ is no UTF-8"):
        load_robot(RobotSpec(urdf=path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '<child link="foot_a"/><origin xyz="0 0 -0.2"/>',
            '<child link="foot_a"/><origin xyz="0 0 1e200"/>',
            "foot_a'",
        ),
        ('<origin xyz="0.3 0 0"/>', '<origin xyz="1e200 0 0"/>', "joint 'slide_a' is 1e.200 m from its parent"),
        (
            '<origin xyz="0 0 -0.1"/><mass',
            '<origin xyz="0 0 1e200"/><mass',
            "link 'leg_a': its mass, centre or inertia has a number of 1e.200",
        ),
        ('<mass value="0.5"/>', '<mass value="1e200"/>', "link 'leg_a': its mass, .* 1e.200"),
    ],
)
def test_lengths_and_masses_that_overflow_are_named(tmp_path, data_dir, old: str, new: str, message: str) -> None:
    text = (data_dir / "tripod.urdf").read_text()
    assert old in text
    (tmp_path / "huge.urdf").write_text(text.replace(old, new))
    with pytest.raises(ModelError, match=message):
        load_robot(RobotSpec(urdf=tmp_path / "huge.urdf"))


def test_packages_are_found_around_the_urdf_and_where_ros_has_them(tmp_path, data_dir, monkeypatch) -> None:
    urdf = tmp_path / "src" / "tripod_description" / "urdf" / "tripod.urdf"
    urdf.parent.mkdir(parents=True)
    text = (data_dir / "tripod.urdf").read_text()
    urdf.write_text(text.replace("package://nowhere/", "package://tripod_description/"))
    robot = load_robot(RobotSpec(urdf=urdf))
    assert robot.source.package_dirs == (tmp_path / "src",) and robot.notes == ()

    urdf.write_text(text)
    assert "package nowhere was not found: give the folder that contains it as robot.package_dirs" in str(
        load_robot(RobotSpec(urdf=urdf)).notes
    )
    (tmp_path / "ros" / "nowhere").mkdir(parents=True)
    for listed in (tmp_path / "ros", tmp_path / "ros" / "nowhere"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join([str(tmp_path / "none"), str(listed)]))
        robot = load_robot(RobotSpec(urdf=urdf))
        assert robot.source.package_dirs == (tmp_path / "ros",) and robot.notes == ()
    given = load_robot(RobotSpec(urdf=urdf, package_dirs=(tmp_path / "ros",)))
    assert given.source.package_dirs == (tmp_path / "ros",)


def test_a_robot_is_described_in_a_line(solo_spec) -> None:
    words = "<Robot solo12: 2.500 kg, free base, 12 joints, FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT>"
    assert repr(load_robot(solo_spec)) == words


def test_unknown_robot_names_the_nearest() -> None:
    with pytest.raises(InputError, match="Did you mean solo12") as caught:
        load_robot(RobotSpec(model="solo21"))
    assert caught.value.argument == "model"


def test_missing_files_name_the_nearest(data_dir) -> None:
    with pytest.raises(InputError, match="urdf: got .*tripot.urdf; expected a file that exists. Did you mean tripod"):
        load_robot(RobotSpec(urdf=data_dir / "tripot.urdf"))
    with pytest.raises(InputError, match="srdf: got"):
        load_robot(RobotSpec(urdf=data_dir / "tripod.urdf", srdf=data_dir / "none.srdf"))
    with pytest.raises(InputError, match="srdf: got"):
        load_robot(RobotSpec(model="solo12", srdf=data_dir / "none.srdf"))


def test_a_urdf_that_cannot_be_read_is_quoted_by_its_parser(tmp_path, capfd) -> None:
    path = tmp_path / "broken.urdf"
    path.write_text('<robot name="r"><link name="a"/><link name="b"/></robot>')
    with pytest.raises(ModelError, match="Two root links found") as caught:
        load_robot(RobotSpec(urdf=path))
    assert caught.value.robot == "broken" and len(caught.value.problems) == 1
    path.write_text("<robot")
    with pytest.raises(ModelError, match=r"broken\.urdf: .*XML"):
        load_robot(RobotSpec(urdf=path))
    assert capfd.readouterr().err == ""


def test_more_joints_than_pinocchio_has_memory_for_are_one_error(tmp_path) -> None:
    joint = (
        '<link name="l{0}"/><joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/></joint>'
    )
    path = tmp_path / "chain.urdf"
    chain = "".join(joint.format(i, i - 1) for i in range(1, 501))
    path.write_text(f'<robot name="chain"><link name="l0"/>{chain}</robot>')
    with pytest.raises(ModelError, match="506 degrees of freedom; at most 200 are supported"):
        load_robot(RobotSpec(urdf=path))


def test_robots_load_in_several_threads() -> None:
    """The parser's messages are captured from a file descriptor of the whole process, which is restored."""
    source = resolve(RobotSpec(model="solo12"))
    before, saved, interval = os.fstat(2), os.dup(2), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            models = list(pool.map(lambda _: build_model(source)[0], range(120)))
        after = os.fstat(2)
    finally:
        sys.setswitchinterval(interval)
        os.dup2(saved, 2)
        os.close(saved)
    assert {model.nq for model in models} == {19}
    assert os.path.samestat(before, after)


def test_parts_that_cannot_be_parsed_are_notes_and_not_printed(tmp_path, capfd) -> None:
    path = tmp_path / "part.urdf"
    capsule = '<collision><geometry><capsule radius="0.1" length="1"/></geometry></collision>'
    path.write_text(f'<robot name="part"><link name="a">{INERTIAL}{capsule}</link></robot>')
    robot = load_robot(RobotSpec(urdf=path))
    assert robot.collision_shapes == () and any("collision element for Link [a]" in note for note in robot.notes)
    assert capfd.readouterr().err == ""


def test_collision_geometry_without_size_is_named(tmp_path) -> None:
    path = tmp_path / "point.urdf"
    sphere = '<collision><geometry><sphere radius="0"/></geometry></collision>'
    path.write_text(f'<robot name="point"><link name="a">{INERTIAL}{sphere}</link></robot>')
    with pytest.raises(ModelError, match="collision geometry 'a_0': radius_m: got 0; .*: give collision_shapes"):
        _ = load_robot(RobotSpec(urdf=path)).collision_shapes


def test_a_process_without_standard_error_loads_robots(tmp_path) -> None:
    script = tmp_path / "load.py"
    script.write_text("from lgmpc.robot import RobotSpec, load_robot\nprint(load_robot(RobotSpec(model='go2')).name)\n")
    done = subprocess.run(f"{shlex.quote(sys.executable)} {script} 2>&-", shell=True, capture_output=True, text=True)
    assert done.stdout == "go2\n"


def test_an_srdf_that_cannot_be_read(tmp_path, data_dir) -> None:
    path = tmp_path / "broken.srdf"
    path.write_text("<robot")
    with pytest.raises(ModelError, match=r"broken\.srdf: "):
        load_robot(RobotSpec(urdf=data_dir / "tripod.urdf", srdf=path))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": None}, r"model: got nothing \(null\); expected a robot's name here, or a file"),
        ({"urdf": Path("a.urdf")}, "urdf: got the text 'a.urdf'; expected no file here, because model is given"),
        ({"contact_radius_m": -0.01}, "contact_radius_m: got -0.01; expected a number not below 0"),
        ({"contact_radius_m": float("nan")}, "contact_radius_m: got NaN"),
        ({"contact_radius_m": 16e3}, "contact_radius_m: got 16000; expected a number not above 0.5"),
        ({"contact_frames": ("a", "b", "a")}, "contact_frames.2: got the text 'a'; expected each frame once"),
        ({"effort_limit_nm": 0.0}, "effort_limit_nm: got 0; expected a number not below 1e-06"),
        ({"effort_limit_nm": {"*_KFE": float("inf")}}, r"effort_limit_nm.\*_KFE: got inf"),
        ({"velocity_limit_rad_s": True}, "velocity_limit_rad_s: got true"),
        ({"velocity_limit_rad_s": 1e-308}, "velocity_limit_rad_s: got 1e-308; expected a number not below 0.001"),
        ({"armature_kg_m2": -1.0}, "armature_kg_m2: got -1"),
        ({"posture": {"FL_HAA": float("nan")}}, "posture.FL_HAA: got NaN"),
        ({"position_limit_rad": (1.0, -1.0)}, r"position_limit_rad: got the list \[1.0, -1.0\]; expected \[lowest"),
        ({"position_limit_rad": {"a": (0.0, float("inf"))}}, "position_limit_rad.a.1: got inf"),
    ],
)
def test_impossible_values_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RobotSpec(**{"model": "solo12", **changes})
