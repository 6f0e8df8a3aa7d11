"""The checks report all problems of a model at once."""

from __future__ import annotations

import pytest

from lgmpc.errors import ModelError
from lgmpc.robot import RobotSpec, load_robot


def problems(spec: RobotSpec) -> tuple[str, ...]:
    """The problems in the error of load_robot."""
    with pytest.raises(ModelError) as caught:
        load_robot(spec)
    return caught.value.problems


def test_a_good_robot_has_no_problems(solo_spec) -> None:
    assert load_robot(solo_spec).notes == (
        "position limits wider than a full turn: FL_HAA, FL_HFE, FL_KFE, FR_HAA and 8 more",
    )


def test_limits_that_never_bind() -> None:
    assert problems(RobotSpec(model="solo12")) == (
        "the URDF's effort limit of FL_HAA, FL_HFE, FL_KFE, FR_HAA and 8 more never binds (1000 N.m): give"
        " effort_limit_nm",
        "the URDF's velocity limit of FL_HAA, FL_HFE, FL_KFE, FR_HAA and 8 more never binds (1000 rad/s): give"
        " velocity_limit_rad_s",
    )


def test_only_the_joints_that_were_not_given_are_reported(solo_spec) -> None:
    (problem,) = problems(solo_spec.replace({"effort_limit_nm": {"?L_*": 1.8, "FR_*": 1.8, "HR_H??": 1.8}}))
    assert problem == "the URDF's effort limit of HR_KFE never binds (1000 N.m): give effort_limit_nm"


def test_zero_limits_forbid_motion() -> None:
    first, second = problems(RobotSpec(model="double_pendulum"))
    assert first == "the URDF's effort limit of joint1, joint2 forbids all motion (0 N.m): give effort_limit_nm"
    assert second.startswith("the URDF's velocity limit of joint1, joint2 forbids all motion")


def test_a_fixed_base_without_joints_is_refused(tmp_path) -> None:
    (tmp_path / "block.urdf").write_text('<robot name="block"><link name="block"/></robot>')
    (problem,) = problems(RobotSpec(urdf=tmp_path / "block.urdf", floating_base=False))
    assert problem == "nothing moves: its base is fixed and it has no joints (floating_base: true)"


def test_bodies_without_rotational_inertia_are_noted_with_that_of_a_sphere(tmp_path, data_dir) -> None:
    text = (data_dir / "tripod.urdf").read_text()
    start = text.index("<inertia ", text.index('<link name="leg_b">'))
    text = (
        text[:start]
        + '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
        + text[text.index("/>", start) + 2 :]
    )
    (tmp_path / "points.urdf").write_text(text)
    (note,) = [each for each in load_robot(RobotSpec(urdf=tmp_path / "points.urdf")).notes if "inertia" in each]
    # 0.5 kg of water: a radius of 49.2 mm, 2/5 m r^2 = 4.85e-4
    assert note.endswith('link \'leg_b\' (<inertia ixx="0.00048" iyy="0.00048" izz="0.00048"/>)')


def test_infinite_limits(tmp_path, data_dir) -> None:
    path = tmp_path / "endless.urdf"
    text = (data_dir / "tripod.urdf").read_text()
    text = text.replace('<limit effort="2" velocity="50"/>', "").replace('upper="0.4"', 'upper="1e308"')
    path.write_text(text)
    effort, velocity, position = problems(RobotSpec(urdf=path))
    assert effort == "the URDF's effort limit of spin never binds (infinite): give effort_limit_nm"
    assert velocity == "the URDF's velocity limit of spin never binds (infinite): give velocity_limit_rad_s"
    assert position == "no finite position limits: slide_a, slide_b, slide_c: give position_limit_rad"
    given = RobotSpec(
        urdf=path, effort_limit_nm={"spin": 2.0}, velocity_limit_rad_s={"spin": 50.0}, position_limit_rad=(0.1, 0.4)
    )
    assert load_robot(given).joint_upper[:3].tolist() == [0.4, 0.4, 0.4]


def test_missing_contact_frames_name_the_nearest(solo_spec) -> None:
    (problem,) = problems(solo_spec.replace({"contact_frames": ("FL_FOOT", "FR_FOT")}))
    assert problem.startswith("contact frame 'FR_FOT' is not in the model; did you mean FR_FOOT or")
    (problem,) = problems(solo_spec.replace({"contact_frames": ("qqq",)}))
    assert "there are root_joint, base_link, FL_HAA" in problem


def test_feet_need_a_free_flyer(solo_spec) -> None:
    (problem,) = problems(solo_spec.replace({"floating_base": False}))
    assert problem == (
        "contact_frames are given (FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT) but the base is fixed: a robot on feet needs a"
        " free-flyer (floating_base: true)"
    )


def test_bodies_that_cannot_exist(data_dir) -> None:
    assert problems(RobotSpec(urdf=data_dir / "impossible.urdf")) == (
        "link 'balloon': its mass is negative, -0.5 kg",
        "link 'saddle': its inertia is not positive definite; moments -0.01, 0.01, 0.03 kg.m2",
        "link 'needle': its inertia violates the triangle inequality; moments 0.1, 0.1, 0.5 kg.m2",
        "joints that move no inertia: j4; give the links after them an <inertial>, or the joints an armature",
    )


def test_missing_inertia(data_dir) -> None:
    spec = RobotSpec(urdf=data_dir / "zero_mass.urdf")
    assert problems(spec) == (
        "link 'base': the floating base has no mass (missing <inertial>?)",
        "joints that move no inertia: wave; give the links after them an <inertial>, or the joints an armature",
    )
    fixed = load_robot(spec.replace({"floating_base": False, "armature_kg_m2": {"wave": 1e-3}}))
    assert fixed.notes == ("no mass: link 'bracket', link 'flag'",)


def test_singular_for_another_reason() -> None:
    (problem,) = problems(RobotSpec(model="icub"))
    assert problem.startswith("its mass matrix is not positive definite in the reference posture")


def test_a_second_free_flyer(data_dir) -> None:
    spec = RobotSpec(urdf=data_dir / "floating_root.urdf")
    assert any("the URDF's root has a floating joint of its own, 'drift'" in problem for problem in problems(spec))
    robot = load_robot(spec.replace({"floating_base": False}))
    assert robot.floating_base and robot.nu == 2


def test_a_free_flyer_inside(tmp_path, data_dir) -> None:
    path = tmp_path / "inside.urdf"
    text = (data_dir / "floating_root.urdf").read_text()
    path.write_text(text.replace('name="left_finger" type="revolute"', 'name="left_finger" type="floating"'))
    found = problems(RobotSpec(urdf=path, floating_base=False))
    assert "joint 'left_finger' floats inside the robot: only the base may, no actuator moves it" in found


def test_unsupported_joints(tmp_path, data_dir) -> None:
    path = tmp_path / "planar.urdf"
    text = (data_dir / "tripod.urdf").read_text()
    path.write_text(text.replace('name="spin" type="continuous"', 'name="spin" type="planar"'))
    assert any(
        problem.startswith("joint 'spin' is a JointModelPlanar; supported are")
        for problem in problems(RobotSpec(urdf=path))
    )


def test_what_is_unusual_is_noted(data_dir) -> None:
    robot = load_robot(RobotSpec(urdf=data_dir / "floating_root.urdf", floating_base=False))
    assert robot.notes == (
        "mimic joints of the URDF are independent joints here: right_finger",
        "position limits wider than a full turn: left_finger",
    )


def test_keys_that_match_nothing(solo_spec) -> None:
    spec = solo_spec.replace({"effort_limit_nm": {"*": 1.8, "FL_KFX": 1.0}, "posture": {"*_KNEE": 1.0}})
    first, second = problems(spec)
    assert first.startswith("effort_limit_nm: 'FL_KFX' matches no joint; there are FL_KFE")
    assert second.startswith("posture: '*_KNEE' matches no joint; there are")


def test_position_limits_only_where_there_are_positions(data_dir) -> None:
    (problem,) = problems(RobotSpec(urdf=data_dir / "tripod.urdf", position_limit_rad={"spin": (0.0, 1.0)}))
    assert problem.startswith("position_limit_rad: 'spin' matches no joint that can have position limits; there are")


def write_urdf(path, data_dir, old: str, new: str):
    text = (data_dir / "tripod.urdf").read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return RobotSpec(urdf=path)


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ('<!DOCTYPE robot [<!ENTITY m "1">]>', "its DTD declares the entity 'm', which no parser of URDFs expands"),
        (f"<!DOCTYPE robot [<!ENTITY a '{'x' * 99}'><!ENTITY b '{'&a;' * 99}'>]>", "declares the entity 'a'"),
        ('<?xml version="1.0" encoding="utf-77"?>', "not well-formed XML (unknown encoding"),
    ],
    ids=["entity", "entities that grow", "encoding"],
)
def test_a_urdf_whose_meaning_depends_on_the_parser(tmp_path, data_dir, head, words) -> None:
    spec = write_urdf(tmp_path / "dtd.urdf", data_dir, '<?xml version="1.0"?>', head)
    assert any(problem.startswith(f"{spec.urdf}: ") and words in problem for problem in problems(spec))


def test_an_undefined_entity(tmp_path, data_dir) -> None:
    spec = write_urdf(tmp_path / "entity.urdf", data_dir, '<robot name="tripod"', '<robot name="&tripod;"')
    assert any("not well-formed XML (undefined entity: line" in problem for problem in problems(spec))


@pytest.mark.parametrize("text", ["<!DOCTYPE robot>", '<!DOCTYPE robot SYSTEM "robot.dtd">'])
def test_a_document_type_without_entities_is_harmless(tmp_path, data_dir, text) -> None:
    plain = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf")).notes
    spec = write_urdf(tmp_path / "tripod.urdf", data_dir, '<?xml version="1.0"?>', f'<?xml version="1.0"?>{text}')
    assert load_robot(spec).notes == plain


def test_undeclared_namespaces_are_harmless(tmp_path, data_dir) -> None:
    plain = load_robot(RobotSpec(urdf=data_dir / "tripod.urdf")).notes
    spec = write_urdf(tmp_path / "tripod.urdf", data_dir, '<robot name="tripod"', '<robot xacro:x="1" name="tripod"')
    assert load_robot(spec).notes == plain


@pytest.mark.parametrize(
    ("path", "noted"),
    [
        ("package://legs/../../secret.stl", True),
        ("package://legs/../arms/arm.stl", True),
        ("package://legs/meshes/../leg.stl", False),
        ("../meshes/leg.stl", False),
    ],
)
def test_a_mesh_outside_its_package_is_noted(tmp_path, data_dir, path, noted) -> None:
    mesh = f'<visual><geometry><mesh filename="{path}"/></geometry></visual>'
    spec = write_urdf(tmp_path / "mesh.urdf", data_dir, "<inertial>", f"{mesh}<inertial>")
    note = f"meshes outside the package that their path names: {path}"
    assert (note in load_robot(spec).notes) is noted
