"""A robot at the end of a link, in another thread, and a page whose part is played by the test."""

from __future__ import annotations

import multiprocessing
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.config.deploying import serve_config
from lgmpc.config.execution import FinishedRun
from lgmpc.config.robots import build_robot
from lgmpc.control import Command, Measurement
from lgmpc.hardware import Deployment, StopReason, UdpDriver, UdpRobot
from lgmpc.hardware.safety import Operator
from lgmpc.hardware.simulated import LockStep, NoControllerError, Served
from lgmpc.live.deployed import DeployedRun, deployed_config
from lgmpc.live.history import PictureHistory
from lgmpc.live.viewing import Link
from lgmpc.live.wishes import Note, Order, Pace, Started
from lgmpc.locomotion.command import CommandEntry
from lgmpc.robot import Robot
from lgmpc.runs import RunLog

pytestmark = pytest.mark.slow
SECRET = bytes(32)
WALK = CommandEntry(at_s=0.0, velocity_m_s=(0.3, 0.0, 0.0), gait="trot")


class Far:
    """A simulated robot that waits for the command to each measurement, and wishes at times of its clock."""

    def __init__(self, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        self._link, self._out = Link(theirs), out
        changes = [
            "commands=[]",
            "duration_s=2.0",
            "deployment={silence_s: 9, lost_s: 10, lie_down_s: 1}",
            "log.rate_hz=1000",
        ]
        self._config = load_config("solo12_velocity_inekf", changes)
        self._end = UdpRobot(12, secret=SECRET)
        self._served: list[Served] = []
        self.commands: list[Any] = []
        self.heard: list[Any] = []
        self._monkeypatch = monkeypatch

    def drive(self, *script: tuple[float, Any]) -> tuple[FinishedRun, Deployment, Served]:
        wishes, watch, commands = list(script), DeployedRun.watch, self.commands

        def scripted(run: DeployedRun, tick: Any) -> bool:
            while wishes and wishes[0][0] <= tick.sample.time:
                wish = wishes.pop(0)[1]
                wish() if callable(wish) else self.pipe.send(wish)
                run._asked_at = -1.0
            return watch(run, tick)

        class Counted(UdpDriver):
            def write(self, command: Any) -> None:
                if command is not self._command:  # which is repeated where its packet was lost
                    commands.append(command)
                super().write(command)

        def serve() -> None:
            self._served.append(serve_config(patient, lambda robot: self._end, wait_s=60.0, lock_step=True))

        def driver(robot: Robot) -> UdpDriver:
            return Counted(self._end.address, robot.nu, SECRET)

        over, patient = threading.Event(), self._config.replace({"duration_s": 6.0})

        def answer(self: LockStep, measurement: Measurement) -> Command:
            """Wait for the command as long as there is a controller."""
            self._link.send(measurement)
            while not over.is_set():
                command = self._link.receive_answer(0.1)
                if command is not None:
                    return command
            raise NoControllerError("the run is over")

        self._monkeypatch.setattr(DeployedRun, "watch", scripted)
        self._monkeypatch.setattr(LockStep, "answer", answer)
        robot = threading.Thread(target=serve)
        robot.start()
        try:
            finished, deployment = deployed_config(
                self._config, driver, self._out, link=self._link, operator=Operator(armed=False)
            )
        finally:
            over.set()
        robot.join(60.0)
        return finished, deployment, self._served[0]

    def messages(self, kind: type) -> list[Any]:
        while self.pipe.poll():
            self.heard.append(self.pipe.recv())
        return [each for each in self.heard if isinstance(each, kind)]


@pytest.fixture
def far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Far:
    return Far(tmp_path, monkeypatch)


def test_a_robot_is_armed_walked_and_stopped_from_the_page(far: Far) -> None:
    pictures: list[RunLog] = []

    def arm() -> None:
        """Arm the robot when a second has passed without a command, and look at it then."""
        started = far.pipe.recv()
        assert isinstance(started, Started) and started.deployed and not started.tunable
        history = PictureHistory(build_robot(started.config), started)
        far.pipe.send(WALK)  # is followed from the first tick on
        if not far.pipe.poll(1.0) and not far.commands:
            far.pipe.send(Order("arm"))
        while not (pictures and pictures[-1].time[-1] > 0.5):
            time.sleep(0.02)
            if history.update():
                pictures.append(history.log(history.at(0.0), 100))
        history.close()

    arming = threading.Thread(target=arm)
    arming.start()
    finished, deployment, served = far.drive((0.5, Pace(paused=True)), (1.2, Order("stop")))
    arming.join()
    assert deployment.ending is StopReason.STOPPED and deployment.failure == "emergency stop on the page"
    assert served.q[-1, 0] > 0.15 and served.max_tilt_deg < 5.0
    log = finished.session.log
    assert 1.2 <= log.time[-1] < 1.25
    shown = pictures[-1]
    at = np.searchsorted(log.time, shown.time[-1])
    np.testing.assert_array_equal(shown.q[-1], log.q[at])
    np.testing.assert_array_equal(far.commands[-1].tau, 0.0)
    assert (far.commands[-1].kd > 0.0).all()
    refused, over = far.messages(Note)
    assert "no such control" in refused.text and over.over and over.error


def test_joints_of_a_disarmed_robot_are_damped_until_it_is_armed_again(far: Far) -> None:
    far.pipe.send(Order("arm"))
    _, deployment, served = far.drive((0.2, Order("disarm")), (0.25, Order("arm")), (0.6, Order("lie")))
    torques = np.array([np.abs(command.tau).max() for command in far.commands])
    assert (torques[:195] > 0.1).all() and not torques[205:245].any() and (torques[255:595] > 0.1).all()
    assert deployment.ending is StopReason.INTERRUPTED
    assert served.q[590, 2] > 0.2 and served.q[-1, 2] < 0.2


def test_a_robot_whose_page_is_gone_stands_still(far: Far) -> None:
    far.pipe.send(Order("arm"))
    far.pipe.send(WALK)
    _, deployment, served = far.drive((0.8, far.pipe.close))
    assert deployment.ending is StopReason.DURATION
    assert served.q[800, 0] > 0.1 and np.abs(served.v[1900:2000, :2]).max() < 0.05
