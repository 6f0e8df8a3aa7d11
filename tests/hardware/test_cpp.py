"""The example in C++ of the robot's end of the link."""

import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lgmpc.control import Command
from lgmpc.hardware import UdpDriver
from lgmpc.hardware.udp import LOCALHOST

SOURCE = Path(__file__).resolve().parents[2] / "docs" / "guide" / "robot_end.cpp"


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_the_example_in_cpp_is_a_robot(tmp_path: Path) -> None:
    program, secret = tmp_path / "robot_end", tmp_path / "secret"
    secret.write_text("a secret of both ends\n")
    subprocess.run(["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", str(SOURCE), "-o", str(program)], check=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOCALHOST, 0))
        port = free.getsockname()[1]
    arguments = [str(program), str(port), str(secret), "3", "20"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, encoding="utf-8") as robot:
        driver, times = UdpDriver((LOCALHOST, port), 3, b"a secret of both ends"), list[float]()
        while robot.poll() is None:
            for m in driver.read(0.05):
                times.append(m.time)
                assert m.accelerometer[2] == 9.81
                driver.write(Command.feed_forward(np.full(3, 1e3 * m.time), np.zeros(3)))
        driver.close()
        assert robot.stdout is not None
        lines = [line.split() for line in robot.stdout]
    assert [(int(tick), float(torque)) for tick, torque in lines] == [(k, pytest.approx(k)) for k in range(20)]
    np.testing.assert_allclose(times, 1e-3 * np.arange(20))
