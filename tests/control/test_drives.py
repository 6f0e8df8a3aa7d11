"""References of the drives' own loop: closed forms, and a robot whose commands get lost."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.config.build import build_robot, prepare
from lgmpc.config.loading import load_config
from lgmpc.control.drives import DriveSettings, JointReferences
from lgmpc.control.interface import Command
from lgmpc.errors import ConfigError
from lgmpc.robot import Robot

PERIOD = 0.005


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(load_config("solo12_stand"))


def test_references_are_where_constant_accelerations_lead(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    tau, (whole_q, whole_v, whole_a) = rng.normal(size=robot.nu), rng.normal(size=(3, robot.nq))
    gains = DriveSettings(kp_nm_rad={"*_KFE": 3.0, "FL_KFE": 4.0}, kd_nms_rad=0.1)
    command = JointReferences(robot, gains, PERIOD).command(tau, whole_q, whole_v[:-1], whole_a[:-1])
    q, v, a = whole_q[7:], whole_v[6:-1], whole_a[6:-1]
    at_knees = np.array(["KFE" in name for name in robot.joint_names])
    np.testing.assert_array_equal(command.kp > 0.0, at_knees)
    assert command.kp[robot.joint_names.index("FL_KFE")] == 4.0 and (command.kd == 0.1).all()
    then = np.linspace(0.0, PERIOD, 1001)[:, None]
    np.testing.assert_allclose(command.q_des, q + np.trapezoid(v + a * then, then, axis=0), rtol=1e-12)
    np.testing.assert_allclose(command.v_des, v + a * PERIOD, rtol=1e-12)
    # Once the joints are there, the drives add nothing.
    np.testing.assert_array_equal(command.torque(command.q_des, command.v_des), tau)


def test_without_gains_the_torques_are_those_of_the_qp(robot: Robot) -> None:
    rng = np.random.default_rng(2)
    tau, q, v = rng.normal(size=robot.nu), rng.normal(size=robot.nq), rng.normal(size=robot.nv)
    command = JointReferences(robot, DriveSettings(), PERIOD).command(tau, q, v, np.zeros(robot.nv))
    assert command.torque(q + 1.0, v + 1.0) is tau and not command.kp.any() and not command.kd.any()
    same = Command(*(each.copy() for each in command))  # as it arrives over a link
    np.testing.assert_array_equal(same.torque(q + 1.0, v + 1.0), tau)


@pytest.mark.parametrize("name", Command._fields)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_the_first_element_that_is_not_finite_is_named(name: str, value: float) -> None:
    command = Command.feed_forward(np.ones(4), np.ones(4))
    assert not command.fault and not Command.damping(np.ones(4), np.full(4, np.nan), 0.1).fault
    broken = np.where(np.arange(4) == 2, value, 0.0)
    assert command._replace(**{name: broken}).fault == f"{name}[2] is {value}"
    assert Command(*(broken,) * 5).fault == f"tau[2] is {value}"


def test_a_key_that_matches_no_joint_is_named() -> None:
    config = load_config("solo12_stand", ["drives.kp_nm_rad={FL_KFF: 1.0}"])
    with pytest.raises(ConfigError, match=r"drives\.kp_nm_rad: got .*FL_KFF.*names or patterns of joints.*FL_KFE"):
        build_robot(config)


def test_gains_hold_the_motion_of_a_trot_whose_commands_get_lost() -> None:
    """At 200 Hz, half of the commands lost: without gains the robot tilts by 33 degrees, or falls."""
    found = []
    for gains in ("{}", "{kp_nm_rad: 3.0, kd_nms_rad: 0.1}"):
        rates = ["wbc.rate_hz=200", "mpc.rate_hz=100", "log.rate_hz=200", "plant.link.dropped_commands=0.5"]
        config = load_config("solo12_velocity", ["duration_s=2.5", "gate={}", f"drives={gains}", *rates])
        found.append(prepare(config).run(lambda progress: None).metrics)
    without, metrics = found
    assert without is not None and (without.fell or without.max_tilt_deg > 20.0)
    assert metrics is not None and metrics.walking is not None
    assert not metrics.fell and metrics.max_tilt_deg < 5.0  # measured 2.7
    assert metrics.walking.velocity_rmse_m_s < 0.03  # 0.013
