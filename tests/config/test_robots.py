"""The robot of a config, and its checks against the rest of the config."""

import re
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import load_config, parse_config
from lgmpc.config.robots import build_robot
from lgmpc.errors import ConfigError, ConfigErrors, ModelError

SOLO12 = Path(__file__).resolve().parents[2] / "configs" / "solo12_stand.yaml"


def test_the_shipped_configs_fit_their_robot(shipped_run: Path) -> None:
    config = load_config(shipped_run)
    robot = build_robot(config)
    assert robot.name == config.robot.model
    feet = [each.frame for each in config.robot.feet]
    assert robot.foot_names == (tuple(feet) or config.robot.contact_frames)
    assert np.isfinite(robot.effort_limit).all()


def test_solo12_is_as_built() -> None:
    robot = build_robot(load_config(SOLO12))
    assert robot.mass == pytest.approx(2.5, abs=0.01)
    np.testing.assert_array_equal(robot.effort_limit, 1.8)
    np.testing.assert_array_equal(robot.armature, 3.6e-4)
    assert robot.contact_frames == ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    joints = dict(zip(robot.joint_names, robot.q_reference[7:], strict=True))
    assert joints["FL_HFE"] == 0.8 and joints["HR_KFE"] == 1.6
    assert robot.joint_upper[robot.joint_names.index("FL_HFE")] == 1.45


def test_errors_have_the_place_in_the_file() -> None:
    config = parse_config("name: x\nrobot:\n  model: solo13\n", name="f.yaml")
    with pytest.raises(ConfigError, match=r"^f\.yaml:3: robot\.model: got solo13; .*Did you mean solo12"):
        build_robot(config)


def test_model_errors_name_the_keys() -> None:
    with pytest.raises(ModelError) as caught:
        build_robot(load_config(SOLO12, ["robot.effort_limit_nm=null", "robot.posture=lying"]))
    text = str(caught.value)
    assert "give effort_limit_nm" in text and "posture: no reference configuration" in text


def test_all_unmet_requirements_are_reported_at_once() -> None:
    config = load_config(SOLO12, ["robot.contact_frames=[]", "pushes=[{body: head, time_s: 0, impulse_ns: [0, 0, 1]}]"])
    with pytest.raises(ConfigErrors) as caught:
        build_robot(config)
    assert [problem.key for problem in caught.value.problems] == ["robot.contact_frames", "pushes.0.body"]
    assert caught.value.problems[0].choices == ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


MOTIONS = {
    "robot.contact_frames=[FL_FOOT, FR_FOOT, HL_FOOT, base_link]": ["robot.contact_frames: got base_link"],
    "plant.initial_posture={FL_HFX: 1.0}": ["plant.initial_posture: got FL_HFX; .* Did you mean FL_HFE"],
    "locomotion.gaits=[{name: hop, period_s: 0.3, duty: 0.5, offsets: [0.0, 0.5]}]": ["gaits.0.offsets: .* expected 4"],
    "commands=[{at_s: 1, gait: trott}]": ["commands.0.gait: got trott; .* Did you mean trot?"],
    "commands=[{at_s: 1, velocity_m_s: [0, 9, 0]}, {at_s: 2, height_m: 0.5}, {at_s: 3, height_m: -0.15}, "
    "{at_s: 4, yaw_rate_rad_s: -9}]": [
        r"commands.0.velocity_m_s: got 9 m/s; expected at most 3 m/s \(locomotion.limits.speed_m_s\)",
        "commands.1.height_m: got 0.5 m; .* stretched",
        r"commands.2.height_m: got -0.15 m; .* fallen \(modes.fall.height_share\)",
        r"commands.3.yaw_rate_rad_s: got -9 rad/s; expected at most 4 rad/s \(locomotion.limits.yaw_rate_rad_s\)",
    ],
    "commands=[{at_s: 1, velocity_m_s: [2, 0, 0], gait: walk}]": ["commands.0.velocity_m_s: .* the stance lasts 0.4"],
    "commands=[{at_s: 1, velocity_m_s: [2, 0, 0], gait: trot}, {at_s: 2, gait: walk}]": ["commands.1: got 2 m/s"],
}


@pytest.mark.parametrize("change", MOTIONS)
def test_motions_that_the_robot_cannot_make_are_refused(change: str) -> None:
    with pytest.raises(ConfigError) as caught:
        build_robot(load_config(SOLO12, [change]))
    found = caught.value.problems if isinstance(caught.value, ConfigErrors) else [caught.value]
    for problem, words in zip(found, MOTIONS[change], strict=True):
        assert re.search(words, str(problem))


def test_a_push_may_hit_any_link_that_moves() -> None:
    change = "pushes=[{body: FL_UPPER_LEG, time_s: 0, impulse_ns: [0, 0, 1]}]"
    assert "FL_UPPER_LEG" in build_robot(load_config(SOLO12, [change])).body_names


@pytest.mark.parametrize("frames", [["FL_FOOT"], ["FL_FOOT", "HR_FOOT"]])
def test_a_robot_on_fewer_than_three_contact_points_is_refused(frames: list[str]) -> None:
    expected = rf"robot\.contact_frames: got {len(frames)} contact point.*{frames[-1]}\); expected three or more"
    with pytest.raises(ConfigError, match=expected):
        build_robot(load_config(SOLO12, [f"robot.contact_frames={frames}"]))


def test_three_contact_points_on_one_line_are_refused_and_others_are_not(tmp_path: Path) -> None:
    tripod = (SOLO12.parents[1] / "tests" / "robot" / "data" / "tripod.urdf").read_text(encoding="utf-8")
    bent, straight = tmp_path / "bent.urdf", tmp_path / "straight.urdf"
    bent.write_text(tripod.replace('type="continuous"', 'type="fixed"'), encoding="utf-8")
    straight.write_text(bent.read_text().replace('xyz="-0.2 0.2 0"', 'xyz="-0.2 0 0"').replace("-0.2 -0.2 0", "0 0 0"))
    text = "name: x\nrobot: {urdf: %s, contact_frames: [foot_a, foot_b, foot_c], posture: {'slide_*': 0.2}}\n"
    assert build_robot(parse_config(text % bent)).nc == 3
    assert build_robot(parse_config(text % bent + "commands: [{at_s: 0, height_m: -0.01}]\n")).nc == 3
    with pytest.raises(ConfigError, match=r"commands\.0\.gait: got no name, and so trot; .* Valid: stand"):
        build_robot(parse_config(text % bent + "commands: [{at_s: 0, velocity_m_s: [0.1, 0, 0]}]\n"))
    with pytest.raises(ConfigError, match=r"got 3 contact points on one line \(foot_a, foot_b, foot_c\)"):
        build_robot(parse_config(text % straight))


def test_two_points_are_enough_for_a_robot_that_always_steps() -> None:
    commands = "commands=[{at_s: %g, velocity_m_s: [%g, 0.0, 0.0], gait: walk}]"
    assert build_robot(load_config("bolt_step", [commands % (0.0, 0.1)])).nc == 2
    for at, speed in ((0.5, 0.1), (0.0, 0.0)):
        with pytest.raises(ConfigError, match=r"2 contact points on one line .*; or two that always step: commands"):
            build_robot(load_config("bolt_step", [commands % (at, speed)]))


def test_bodies_without_rotational_inertia_are_an_error_for_mujoco() -> None:
    text = "name: x\nrobot: {model: icub_reduced, contact_frames: [l_sole, r_sole, l_hand]}\n"
    config = parse_config(text)
    words = r"robot.model: got 7 bodies with mass but without rotational inertia; .*0.00096 kg.m2 \(link 'r_hip_1'\)"
    with pytest.raises(ConfigError, match=words):
        build_robot(config)
    build_robot(config.replace({"plant.kind": "pinocchio"}))
