"""The adapter to ODRI's robots, with a stand-in for their library: a robot that stands, and stores what it receives."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lgmpc.cli.running import RobotEnd
from lgmpc.config import load_config
from lgmpc.config.build import build_robot
from lgmpc.control import Command, Measurement, RobotState
from lgmpc.errors import InputError, LgmpcError
from lgmpc.hardware import DeploymentSettings, StopReason, deploy
from lgmpc.hardware.odri import OdriDriver
from lgmpc.timegrid import TimeGrid

NU, PERIOD = 12, 1e-3
POSTURE = np.linspace(-0.5, 0.5, NU)
FIELDS = ("torques", "desired_positions", "desired_velocities", "position_gains", "velocity_gains")


class Joints:
    """The library's joint modules; sensors change when they are parsed."""

    def __init__(self) -> None:
        self.positions, self.velocities, self.measured_torques = np.zeros((3, NU))
        self.given: dict[str, Any] = {}
        for name in FIELDS:
            setattr(self, f"set_{name}", lambda values, name=name: self.given.update({name: np.array(values)}))

    def set_zero_commands(self) -> None:
        self.given = {name: np.zeros(NU) for name in FIELDS}


class Robot:
    """The library's robot."""

    def __init__(self, fails_at: int | None = None, ready: bool = True) -> None:
        self.joints, self.sent, self.parsed = Joints(), list[dict[str, Any]](), 0
        self.imu = SimpleNamespace(
            gyroscope=np.zeros(3),
            accelerometer=np.array([0.0, 0.0, 9.81]),
            attitude_quaternion=np.array([0, 0, 0, 1.0]),
        )
        self.fails_at, self.ready, self.has_error, self.is_timeout = fails_at, ready, False, False

    def initialize(self, posture: Any) -> None:
        if not self.ready:
            raise RuntimeError("Timeout during Robot::WaitUntilReady().")
        self.calibrated_to = posture.copy()

    def parse_sensor_data(self) -> None:
        self.parsed += 1
        self.joints.positions[:] = self.parsed
        self.has_error = self.parsed == self.fails_at

    def send_command(self) -> bool:
        self.sent.append(dict(self.joints.given))
        return not self.has_error


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "config_solo12.yaml"
    path.write_text("robot: {}\n")
    return path


def installed(monkeypatch: pytest.MonkeyPatch, robot: Robot) -> Robot:
    library = ModuleType("libodri_control_interface_pywrap")
    library.robot_from_yaml_file = lambda name: robot  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, library.__name__, library)
    return robot


class Part:
    def __init__(self, update: Any) -> None:
        self.update = update


def run(driver: OdriDriver, ticks: int) -> Any:
    gains = [np.full(NU, float(k)) for k in range(5)]
    controller = Part(lambda state: Command(*gains))
    estimator = Part(lambda m: RobotState(m.time, m.joints, m.speeds))
    settings = DeploymentSettings(damping_nms=0.3)
    return deploy(driver, controller, estimator, ticks=TimeGrid(PERIOD, ticks), settings=settings)


def test_commands_and_gains_of_each_joint_reach_the_motor_boards(monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    robot = installed(monkeypatch, Robot())
    found = run(OdriDriver(file, POSTURE, PERIOD), 50)
    assert found.ending is StopReason.DURATION and found.ticks + found.missing > 40
    np.testing.assert_array_equal(robot.calibrated_to, POSTURE)
    for number, name in enumerate(FIELDS):
        np.testing.assert_array_equal(robot.sent[0][name], np.full(NU, float(number)))
    assert (robot.sent[-1]["velocity_gains"] == 0.3).all() and not robot.sent[-1]["torques"].any()
    assert not robot.joints.given["velocity_gains"].any()  # released at the end


def test_measurements_are_copies_at_the_control_rate(monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    installed(monkeypatch, Robot())
    driver, seen = OdriDriver(file, POSTURE, 0.01), list[Measurement]()
    while len(seen) < 5:
        seen += driver.read(0.002)
    assert [m.joints[0] for m in seen] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert (np.diff([m.time for m in seen]) > 0.0).all()
    np.testing.assert_array_equal(seen[0].accelerometer, [0.0, 0.0, 9.81])


def test_the_command_line_calibrates_to_the_reference_posture(monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    solo12 = build_robot(load_config("solo12_stand"))
    robot, link = installed(monkeypatch, Robot()), RobotEnd("odri", None, None, str(file))
    assert isinstance(link.end(robots=False, period=PERIOD)(solo12), OdriDriver)
    np.testing.assert_array_equal(robot.calibrated_to, solo12.q_reference[7:])
    with pytest.raises(InputError, match="--driver: got odri; expected a link that a simulated robot speaks"):
        link.end(robots=True)


def test_an_error_of_the_robot_ends_the_run_with_damped_joints(monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    robot = installed(monkeypatch, Robot(fails_at=10))
    found = run(OdriDriver(file, POSTURE, PERIOD), 50)
    assert found.ending is StopReason.FAILED and "the robot reports an error" in found.failure
    assert (robot.sent[-1]["velocity_gains"] == 0.3).all()


def test_one_error_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, file: Path, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "libodri_control_interface_pywrap", None)
    with pytest.raises(InputError, match="odri_control_interface, built with its Python bindings"):
        OdriDriver(file, POSTURE, PERIOD)
    installed(monkeypatch, Robot())
    with pytest.raises(InputError, match=r"expected the YAML file of an ODRI robot"):
        OdriDriver(tmp_path / "eth0", POSTURE, PERIOD)
    with pytest.raises(InputError, match="12 motors; expected one with 8"):
        OdriDriver(file, POSTURE[:8], PERIOD)
    installed(monkeypatch, Robot(ready=False))
    with pytest.raises(LgmpcError, match="is not ready: Timeout"):
        OdriDriver(file, POSTURE, PERIOD)
