"""From section ``robot`` to a robot that the rest of the config fits."""

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import load_config, parse_config
from lgmpc.config.robots import build_robot
from lgmpc.errors import ConfigError, ConfigErrors, ModelError

SOLO12 = Path(__file__).resolve().parents[2] / "configs" / "solo12_stand.yaml"


def test_the_shipped_configs_fit_their_robot(shipped_run: Path) -> None:
    robot = build_robot(load_config(shipped_run))
    assert robot.name == "solo12"
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


def test_all_misfits_are_found_at_once() -> None:
    config = load_config(
        SOLO12,
        ["robot.contact_frames=[]", "pushes=[{body: head, time_s: 0, impulse_ns: [0, 0, 1]}]"],
    )
    with pytest.raises(ConfigErrors) as caught:
        build_robot(config)
    assert [problem.key for problem in caught.value.problems] == ["robot.contact_frames", "pushes.0.body"]
    assert caught.value.problems[0].choices == ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


def test_a_push_may_hit_any_link_that_moves() -> None:
    change = "pushes=[{body: FL_UPPER_LEG, time_s: 0, impulse_ns: [0, 0, 1]}]"
    assert "FL_UPPER_LEG" in build_robot(load_config(SOLO12, [change])).body_names
