"""The example of a ROS 2 node, with stand-ins for rclpy and the messages; on a machine with ROS 2, with those."""

from __future__ import annotations

import importlib.util
import queue
import runpy
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lgmpc.config import dump_config, load_config
from lgmpc.config.build import build_robot
from lgmpc.errors import InputError

FILE = Path(__file__).resolve().parents[2] / "docs" / "guide" / "ros2_node.py"
TICKS = 40


def message(**fields: Any) -> Any:
    return SimpleNamespace(**fields)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return message(x=x, y=y, z=z)


class Topics:
    """Stand-ins: a node whose spinning publishes a standing robot's sensors, one state for each command."""

    def __init__(self, names: tuple[str, ...], joints: Any) -> None:
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.published: queue.Queue[list[float]] = queue.Queue()
        self.received: list[list[float]] = []
        self.names, self.joints = names, joints
        topics = self

        class Node:
            def __init__(self, name: str) -> None:
                self.name = name

            def create_subscription(self, kind: Any, topic: str, callback: Callable[[Any], None], quality: Any) -> None:
                topics.callbacks[topic] = callback

            def create_publisher(self, kind: Any, topic: str, quality: Any) -> Any:
                assert topic == "effort_controller/commands"
                return message(publish=lambda sent: topics.published.put(list(sent.data)))

        kinds = {name: type(name, (SimpleNamespace,), {}) for name in ("Imu", "JointState", "Float64MultiArray")}
        kinds["Twist"] = lambda: message(linear=vector(), angular=vector())  # type: ignore[assignment]
        self.modules: dict[str, dict[str, Any]] = {
            "rclpy": {"init": lambda: None, "shutdown": lambda: None, "spin": self.spin},
            "rclpy.node": {"Node": Node},
            "rclpy.qos": {"qos_profile_sensor_data": 5},
            **{f"{package}.msg": kinds for package in ("geometry_msgs", "sensor_msgs", "std_msgs")},
            **{package: {} for package in ("geometry_msgs", "sensor_msgs", "std_msgs")},
        }

    def spin(self, node: Any) -> None:
        backwards, n = slice(None, None, -1), len(self.names)
        self.callbacks["joint_states"](message(name=[]))  # of another part of the robot
        for tick in range(TICKS + 1):
            self.callbacks["imu"](message(angular_velocity=vector(), linear_acceleration=vector(z=9.81)))
            state = message(name=self.names[backwards], position=self.joints[backwards], velocity=[0.0] * n)
            state.effort, state.header = [0.0] * n, message(stamp=message(sec=5, nanosec=1_000_000 * tick))
            self.callbacks["joint_states"](state)
            self.received.append(self.published.get(timeout=60.0))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_node_answers_each_state_of_the_joints_by_torques(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    robot = build_robot(load_config("solo12_velocity_inekf"))
    topics = Topics(robot.joint_names, robot.q_reference[robot.joint_q].tolist())
    for name, content in topics.modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    config = tmp_path / "short.yaml"
    config.write_text(
        dump_config(
            load_config(
                "solo12_velocity_inekf",
                [f"duration_s={1e-3 * TICKS}", "deployment.silence_s=10", "deployment.lost_s=20"],
            )
        )
    )
    monkeypatch.setattr(sys, "argv", [str(FILE), str(config)])
    runpy.run_path(str(FILE), run_name="__main__")
    end = time.perf_counter() + 30.0
    while len(topics.received) < TICKS and time.perf_counter() < end:  # of the thread that spins
        time.sleep(0.01)
    torques = np.array(topics.received[:TICKS])
    assert torques.shape == (TICKS, robot.nu)
    knees = [name.endswith("KFE") for name in robot.joint_names]
    assert (np.abs(torques[-1][knees]) > 0.1).all() and (np.abs(torques) < 1.8).all()  # it stands


def test_the_node_is_short_and_python() -> None:
    lines = FILE.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 80
    compile("\n".join(lines), str(FILE), "exec")


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="no ROS 2")
def test_the_node_starts_under_ros_2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [str(FILE), "no_such_config"])
    with pytest.raises(InputError):
        runpy.run_path(str(FILE), run_name="__main__")
