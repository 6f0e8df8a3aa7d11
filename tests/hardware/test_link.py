"""A controller in one thread or process, a simulated robot in another, UDP between them."""

import errno
import json
import math
import os
import random
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.compile import StageKernel
from lgmpc.config import Config, load_config
from lgmpc.config.deploying import deploy_config, serve_config
from lgmpc.config.execution import run_config
from lgmpc.control import Command, Measurement
from lgmpc.errors import ConfigError, InputError, Interrupted
from lgmpc.hardware import Deployment, StopReason, UdpDriver, UdpRobot
from lgmpc.hardware.packets import PacketLayout, read_secret
from lgmpc.hardware.simulated import LockStep, NoControllerError, RealTime, Served
from lgmpc.hardware.udp import LOCALHOST, parse_address
from lgmpc.mpc import CentroidalMpc
from lgmpc.mpc.process import ProcessMpc
from lgmpc.robot import Robot
from lgmpc.runs import RunFolder
from lgmpc.runs.folder import DEPLOYMENT_FILE
from lgmpc.simulation.initial import initial_state

NU = 2


def at(time: float) -> Measurement:
    return Measurement(time, np.zeros(3), np.zeros(3), np.zeros(NU), np.zeros(NU), np.zeros(NU))


def torque(value: float) -> Command:
    return Command.feed_forward(np.full(NU, value), np.zeros(NU))


def on_a_link(config: Config, out: Path, **options: Any) -> tuple[Any, Deployment, Served]:
    ready, ends, served = threading.Event(), list[UdpRobot](), list[Served]()

    def link(robot: Robot) -> UdpRobot:
        ends.append(UdpRobot(robot.nu))
        ready.set()
        return ends[0]

    robot = threading.Thread(target=lambda: served.append(serve_config(config, link, wait_s=60.0, **options)))
    robot.start()
    assert ready.wait(60.0)
    finished, deployment = deploy_config(config, lambda robot: UdpDriver(ends[0].address, robot.nu), out)
    robot.join(60.0)
    return finished, deployment, served[0]


def test_in_lock_step_the_robot_moves_as_in_lgmpc_run_bit_for_bit(tmp_path: Path) -> None:
    """The controller depends on no simulator: across a link, from measurements only, it decides the same."""
    push = "pushes=[{body: base_link, time_s: 0.2, duration_s: 0.1, impulse_ns: [0.3, 1.0, 0]}]"
    # Simulated time does not pass while the robot's thread waits for a processor: that is no silence of the robot.
    patient = "deployment={silence_s: 30.0, lost_s: 60.0, planning: in_tick}"
    config = load_config("solo12_balance_inekf", ["duration_s=0.6", "log.rate_hz=1000", push, patient])
    finished, deployment, served = on_a_link(config, tmp_path / "deployed", lock_step=True)
    alone = run_config(config, tmp_path / "alone").session
    np.testing.assert_array_equal(served.q, alone.log.q)
    np.testing.assert_array_equal(served.v, alone.log.v)
    assert served.max_tilt_deg > 0.05
    assert (deployment.ticks, deployment.overtaken, deployment.missing, deployment.silences) == (600, 0, 0, 0)
    # The saved run holds what the controller knew: the estimate.
    saved = RunFolder.load(finished.folder.path)
    np.testing.assert_array_equal(saved.log.q, alone.log.estimate_q)
    np.testing.assert_array_equal(saved.log.tau_command, alone.log.tau_command)
    assert saved.result.verdict.passed and saved.result.certificate is None
    figures = json.loads((finished.folder.path / DEPLOYMENT_FILE).read_text())
    assert (figures["ending"], figures["ticks"], figures["missing"]) == ("duration", 600, 0)
    # Its gate limits slip, which a robot does not measure: that is said, and not failed.
    assert figures["not_measured"] == ["max_slip_m"]
    assert saved.result.metrics is not None and math.isnan(saved.result.metrics.max_slip_m)
    assert saved.result.metrics.max_abs_torque_nm == pytest.approx(np.abs(alone.log.tau).max(), abs=1e-9)
    assert 0.0 < figures["command_p50_ms"] <= figures["command_max_ms"]


def test_a_robot_along_a_slope_is_not_tilted() -> None:
    """Its base is judged against the ground, as in runs."""
    turned, normal = math.radians(10.0), np.array([[-math.sin(math.radians(10.0)), 0.0, math.cos(math.radians(10.0))]])
    q = np.array([[0.0, 0.0, 0.3, 0.0, -math.sin(turned / 2), 0.0, math.cos(turned / 2)]])
    served = Served(np.zeros(1), q, np.zeros((1, 6)), normal, "the duration is over")
    assert served.max_tilt_deg < 1e-5
    level = Served(np.zeros(1), q, np.zeros((1, 6)), np.array([[0.0, 0.0, 1.0]]), "the duration is over")
    assert level.max_tilt_deg == pytest.approx(10.0)


def test_in_real_time_the_robot_stands(tmp_path: Path) -> None:
    """On a busy machine ticks are late, measurements are overtaken; the robot stands all the same."""
    config = load_config("solo12_balance_inekf", ["duration_s=0.5", "pushes=[]", "gate={}"])
    finished, deployment, served = on_a_link(config, tmp_path)
    if not served.unanswered:  # else the machine paused for so long that the robot's watchdog damped its joints
        assert served.max_tilt_deg < 2.0
        assert served.q[:, 2].min() > 0.9 * served.q[0, 2]
    assert deployment.ticks + deployment.missing <= 500  # the last measurements may have arrived together
    assert deployment.ticks > 10
    assert finished.result.metrics is not None


def test_a_config_without_an_estimator_is_deployed_with_one(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    config = load_config("solo12_balance", ["deployment.lost_s=0.05", "plant.initial_posture=lying"])
    begun: list[Any] = []
    finished, deployment = deploy_config(
        config, lambda robot: UdpDriver((LOCALHOST, 9), robot.nu), tmp_path, prepared=begun.append
    )
    # The estimate begins where the robot does: on its belly.
    height = begun[0].legs.update(Lost(12).left[0]).q[2]
    assert height == initial_state(begun[0].controller.robot, config.plant)[2] < 0.1
    assert "no estimator: inekf" in caplog.text and finished.config.estimator.kind == "inekf"
    assert finished.result.verdict.reasons == (deployment.failure,)
    assert deployment.failure == "no measurement arrived: is the robot on, and is this its address?"


class Lost:
    """A robot that takes one measurement, and is silent from then on."""

    def __init__(self, nu: int) -> None:
        self.left = [
            Measurement(0.0, np.zeros(3), np.array([0.0, 0.0, 9.81]), np.zeros(nu), np.zeros(nu), np.zeros(nu))
        ]
        self.written: list[Command] = []
        self.waited: list[float] = []

    def read(self, timeout_s: float) -> list[Measurement]:
        self.waited.append(timeout_s)
        if not self.left:
            time.sleep(timeout_s)
        return [self.left.pop()] if self.left else []

    def write(self, command: Command) -> None:
        self.written.append(command)

    def close(self) -> None:
        pass


def test_a_robot_that_is_lost_fails_its_gate_and_the_section_deployment_applies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = ["deployment.silence_s=0.003", "deployment.lost_s=0.5", "deployment.damping_nms=0.37"]
    robots: list[Lost] = []
    config, bind, bound = load_config("solo12_balance_inekf", limits), StageKernel.bind, list[StageKernel]()

    def driver(robot: Robot) -> Lost:
        monkeypatch.setattr(StageKernel, "bind", lambda self, *a, **b: bound.append(self) or bind(self, *a, **b))
        robots.append(Lost(robot.nu))
        return robots[0]

    finished, deployment = deploy_config(config, driver, tmp_path)
    assert not bound  # the first tick finds everything ready
    assert finished.result.verdict.reasons[0] == "no measurements arrive"
    assert finished.exit_code == 1
    assert (deployment.ticks, deployment.silences) == (1, 1)
    assert [set(command.kd.tolist()) for command in robots[0].written[1:]] == [{0.37}, {0.37}]
    assert set(robots[0].waited) == {0.003}


@pytest.mark.parametrize("text", ["", "robot", "127.0.0.1", "127.0.0.1:", ":47800", "host:0", "host:65536", "host:-1"])
def test_an_address_is_host_and_port(text: str) -> None:
    with pytest.raises(InputError, match=r"host:port, as in 127.0.0.1:47800"):
        parse_address(text)
    assert parse_address("robot.local:1") == ("robot.local", 1)


def test_a_name_that_no_host_can_have_is_refused() -> None:
    with pytest.raises(InputError, match=r"robot: got a\.\.b:1"):
        UdpDriver(("a..b", 1), NU)
    with pytest.raises(InputError, match="address: got a..b:0"):
        UdpRobot(NU, "a..b")


def test_a_robot_to_which_no_controller_connects_ends() -> None:
    config = load_config("solo12_balance_inekf", ["duration_s=0.01"])
    with pytest.raises(NoControllerError, match=r"no controller within 0\.05 s"):
        serve_config(config, lambda robot: UdpRobot(robot.nu), wait_s=0.05)


@pytest.mark.parametrize(("lock_step", "expected"), [(False, [7]), (True, [0])])
def test_a_simulated_robot_asks_for_the_priority_of_the_deployment(
    monkeypatch: pytest.MonkeyPatch, lock_step: bool, expected: list[int]
) -> None:
    """Not in lock step, in which it would leave no time to others."""
    asked = list[int]()

    @contextmanager
    def recorded(priority: int) -> Iterator[None]:
        asked.append(priority)
        yield

    monkeypatch.setattr("lgmpc.config.deploying.real_time", recorded)
    config = load_config("solo12_balance_inekf", ["duration_s=0.01", "deployment.priority=7"])
    with pytest.raises(NoControllerError):
        serve_config(config, lambda robot: UdpRobot(robot.nu), lock_step=lock_step, wait_s=0.05)
    assert asked == expected


def test_plans_are_made_after_the_command_and_followed_from_the_next_tick_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order, plan, write = list[str](), CentroidalMpc.update, UdpDriver.write

    def planned(self: CentroidalMpc, *arguments: Any) -> Any:
        order.append("plan")
        return plan(self, *arguments)

    def written(self: UdpDriver, command: Command) -> None:
        if command is not self._command:  # which is repeated where its packet was lost
            order.append("command")
        write(self, command)

    monkeypatch.setattr(CentroidalMpc, "update", planned)
    monkeypatch.setattr(UdpDriver, "write", written)
    changes = ["duration_s=0.5", "log.rate_hz=1000", "deployment={silence_s: 30.0, lost_s: 60.0}"]
    config = load_config("solo12_balance_inekf", [*changes, "pushes.0.time_s=0.1"])
    before, _, _ = on_a_link(config.replace({"deployment.planning": "in_tick"}), tmp_path, lock_step=True)
    begun = order.index("command") - 1  # plans before are those that warm up the controller
    assert order[begun:][:13] == ["plan", *10 * ["command"], "plan", "command"]
    order.clear()
    after, _, served = on_a_link(config, tmp_path, lock_step=True)
    begun = order.index("command") - 1
    assert order[begun:][:13] == ["plan", *11 * ["command"], "plan"]  # the first command needs a plan
    logs = before.session.log, after.session.log
    np.testing.assert_array_equal(logs[0].mpc_time, logs[1].mpc_time)
    # Until the push the plans are the same ones; then each tick follows a plan that is one tick younger or older.
    np.testing.assert_array_equal(logs[0].mpc_horizon_com[1], logs[1].mpc_horizon_com[1])
    assert not np.array_equal(logs[0].tau_command[10], logs[1].tau_command[10])
    np.testing.assert_array_equal(logs[0].tau_command[:10], logs[1].tau_command[:10])
    np.testing.assert_allclose(logs[0].q, logs[1].q, atol=1e-3)
    assert served.max_tilt_deg > 0.3


@pytest.mark.slow
def test_a_robot_trots_on_while_its_mpcs_process_stops_and_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped for 200 ms, then killed: without plans, the whole-body QP balances until the next process plans."""
    trot = "commands=[{at_s: 0.1, velocity_m_s: [0.4, 0, 0], gait: trot}]"
    changes = [
        "duration_s=1.8",
        trot,
        "deployment.planning=own_process",
        "deployment.silence_s=10",
        "deployment.lost_s=20",
    ]
    faults = {0.6: signal.SIGSTOP, 0.8: signal.SIGCONT, 1.2: signal.SIGKILL}
    seen, update = list[ProcessMpc](), ProcessMpc.update

    def faulty(self: ProcessMpc, state: Any, *arguments: Any) -> Any:
        for at in [at for at in faults if state.time >= at]:
            assert self._process.pid is not None
            os.kill(self._process.pid, faults.pop(at))
        seen.append(self)
        return update(self, state, *arguments)

    monkeypatch.setattr(ProcessMpc, "update", faulty)
    finished, deployment, served = on_a_link(load_config("solo12_velocity_inekf", changes), tmp_path, lock_step=True)
    assert not faults and deployment.ending is StopReason.DURATION and seen[-1].restarts == 1
    assert served.q[-1, 0] > 0.5 and served.q[:, 2].min() > 0.2
    assert np.abs(served.q[:, 3:5]).max() < np.sin(np.radians(5.0) / 2.0)


def test_forecasts_of_steps_stay_in_the_loops_process() -> None:
    changes = ["estimator={kind: inekf}", "deployment.planning=own_process"]
    with pytest.raises(
        ConfigError, match="deployment.planning: got own_process; expected another: steps against pushes"
    ):
        deploy_config(load_config("solo12_step_recovery", changes), lambda robot: UdpDriver((LOCALHOST, 1), robot.nu))


@pytest.mark.parametrize("error", [KeyboardInterrupt(), Interrupted(signal.SIGTERM)])
def test_a_stopped_robot_says_so_and_keeps_its_motion(
    error: KeyboardInterrupt, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(range(5))

    def answer(self: LockStep, measurement: Measurement) -> Command:
        if next(answers, None) is None:
            raise error
        return Command.damping(np.zeros(12), measurement.joints, 0.1)

    monkeypatch.setattr(LockStep, "answer", answer)
    monkeypatch.setattr(UdpRobot, "wait_for_controller", lambda self, wait: True)
    config = load_config("solo12_balance_inekf", ["duration_s=0.01"])
    served = serve_config(config, lambda robot: UdpRobot(robot.nu), lock_step=True)
    number = error.signal if isinstance(error, Interrupted) else signal.SIGINT
    assert (served.ending, served.signal) == (f"it was stopped by {number.name}", number)
    assert served.q.shape == (5, 19)
    with pytest.raises(KeyboardInterrupt):
        serve_config(config, lambda robot: UdpRobot(robot.nu), lock_step=True)


def test_lgmpc_robot_ends_with_a_word_on_sigterm() -> None:
    command = [sys.executable, "-m", "lgmpc", "robot", "solo12_balance_inekf", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8")
    assert process.stderr is not None
    while "waits for a controller" not in process.stderr.readline():
        assert process.poll() is None
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 143 and "stopped" in errors


def test_a_packet_to_a_network_that_is_unreachable_is_lost() -> None:
    """As where the route of a connected link disappears: the kernel reports it for the next packet."""

    class Unreachable(socket.socket):
        def send(self, *_: object) -> int:
            raise OSError(errno.ENETUNREACH, "Network is unreachable")

    driver = UdpDriver((LOCALHOST, 9), NU)
    driver._socket.close()
    driver._socket = Unreachable(socket.AF_INET, socket.SOCK_DGRAM)
    driver._socket.setblocking(False)
    driver._socket.connect((LOCALHOST, 9))
    assert driver.read(0.0) == []
    driver.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        driver._arrived()


def test_a_port_that_is_taken_is_refused() -> None:
    first = UdpRobot(NU)
    with pytest.raises(InputError, match=rf"address: got 127.0.0.1:{first.address[1]}; expected a free one"):
        UdpRobot(NU, port=first.address[1])
    first.close()


@pytest.fixture
def linked() -> Iterator[tuple[UdpRobot, UdpDriver]]:
    """Both ends of a link, connected: one measurement was sent and has arrived."""
    robot = UdpRobot(NU)
    driver = UdpDriver(robot.address, NU)
    assert driver.read(0.0) == []
    assert robot.wait_for_controller(5.0)
    robot.send(at(0.0))
    assert [m.time for m in _all(driver, 1)] == [0.0]
    yield robot, driver
    robot.close()
    driver.close()


def test_old_foreign_and_broken_packets_are_no_measurements(linked: tuple[UdpRobot, UdpDriver]) -> None:
    robot, driver = linked
    robot.send(at(0.1))
    assert [m.time for m in _all(driver, 1)] == [0.1]
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.sendto(b"anything", driver._socket.getsockname())
    robot._number = -1  # a packet that was overtaken on its way has an old number
    robot.send(at(7.0))
    robot._post(b"no measurement", robot._peer)
    robot._number = 1
    robot.send(at(0.2))
    assert [m.time for m in _all(driver, 1)] == [0.2]
    assert driver.ignored == 1
    robot._number -= 1  # as where the network delivers a packet twice
    robot.send(at(0.2))
    robot.send(at(0.3))
    assert [m.time for m in _all(driver, 1)] == [0.3]
    stranger.close()


def _received(robot: UdpRobot) -> float | None:
    """Return the torque of the newest command that has arrived within a moment."""
    select.select([robot._socket], [], [], 1.0)
    found = robot.receive()
    return None if found is None else float(found[1].tau[0])


def test_who_does_not_know_the_secret_moves_no_motor(caplog: pytest.LogCaptureFixture) -> None:
    """Before, whoever said hello first took over the motors."""
    robot = UdpRobot(NU)
    foreign = UdpDriver(robot.address, NU, b"a secret of another user")
    foreign.read(0.0)
    assert not robot.wait_for_controller(0.05)
    assert [each.message for each in caplog.records] == ["a controller is refused: it has another secret"]
    with pytest.raises(InputError, match=r"secret: got another one than the robot's.*--secret"):
        foreign.read(1.0)
    # What was recorded of an earlier connection connects, but moves nothing: the robot's nonce is another one.
    earlier = UdpRobot(NU)
    driver = UdpDriver(earlier.address, NU)
    driver.read(0.0)
    assert earlier.wait_for_controller(5.0)
    earlier.send(at(0.0))
    assert _all(driver, 1)
    recorded = [driver._layout.hello(driver._nonce), *(driver._layout.command(k, k, torque(1.0)) for k in range(3))]
    for packet in recorded:
        foreign._socket.send(packet)
    assert robot.wait_for_controller(5.0)
    for k in range(3):
        robot.send(at(k))
    assert _received(robot) is None and robot.forged == 3
    # It does not keep the robot from the user's own controller either.
    own = UdpDriver(robot.address, NU)
    own.read(0.0)
    assert _received(robot) is None
    robot.send(at(4.0))
    assert _all(own, 1)
    own.write(torque(2.0))
    assert _received(robot) == 2.0
    for end in (robot, foreign, earlier, driver, own):
        end.close()


def test_replayed_and_forged_commands_are_none(linked: tuple[UdpRobot, UdpDriver]) -> None:
    """Before, an old command, or one numbered 2^64 - 1, kept the watchdog quiet."""
    robot, driver = linked
    first = driver._layout.command(0, 0, torque(1.0))
    driver._socket.send(first)
    assert _received(robot) == 1.0
    driver._socket.send(first)
    driver._socket.send(first[:16] + struct.pack("<Q", 2**64 - 1) + first[24:])
    driver._socket.send(driver._layout.command(1, 5, torque(1.0)))  # for a measurement that was never sent
    assert _received(robot) is None
    port = driver._socket.getsockname()[1]
    driver.close()
    thief = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    thief.bind((LOCALHOST, port))  # of a controller that has ended
    for key in (b"", b"guessed"):
        layout = PacketLayout(NU, key)
        layout.connect(b"c" * 16, b"r" * 16)
        thief.sendto(layout.command(9, 0, torque(1.0)), robot.address)
    assert _received(robot) is None
    assert robot.forged == 5
    thief.close()


def test_a_second_controller_is_refused_and_one_that_restarts_is_not(
    linked: tuple[UdpRobot, UdpDriver], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, driver = linked
    driver.write(torque(1.0))
    assert _received(robot) == 1.0
    second = UdpDriver(robot.address, NU)
    second.read(0.0)
    assert _received(robot) is None
    with pytest.raises(InputError, match="robot: got a robot to which a controller is connected"):
        second.read(1.0)
    assert "a controller is refused: another one is connected" in caplog.text
    driver.write(torque(2.0))
    assert _received(robot) == 2.0
    monkeypatch.setattr("lgmpc.hardware.udp._FREE_S", 0.0)  # as a second later
    third = UdpDriver(robot.address, NU)
    third.read(0.0)
    assert _received(robot) is None
    robot.send(at(3.0))
    assert [m.time for m in _all(third, 1)] == [0.0, 3.0][-1:] or third._number == robot._number
    third.write(torque(3.0))
    assert _received(robot) == 3.0
    for end in (second, third):
        end.close()


def test_a_robot_with_other_joints_is_named() -> None:
    robot, driver = UdpRobot(NU + 1), None
    driver = UdpDriver(robot.address, NU)
    driver.read(0.0)
    assert not robot.wait_for_controller(0.05)
    with pytest.raises(InputError, match="robot: got a robot with 3 joints; expected the config's, with 2"):
        driver.read(1.0)
    robot.close()
    driver.close()


@pytest.mark.parametrize(("name", "refused"), [("go2 a b", True), ("solo12 a b", False), ("", False)])
def test_a_controller_for_another_robot_of_as_many_joints_is_refused(name: str, refused: bool) -> None:
    """A Go2 executed the torques of a Solo12. Ends that do not say which robot it is are connected."""
    robot = UdpRobot(NU, robot="solo12 a b")
    driver = UdpDriver(robot.address, NU, robot=name)
    driver.read(0.0)
    assert robot.wait_for_controller(0.05) is not refused
    if refused:
        with pytest.raises(InputError, match="robot: got another robot; expected the config's, with 2"):
            driver.read(1.0)
    robot.close()
    driver.close()


def test_a_robot_that_restarts_is_connected_anew(caplog: pytest.LogCaptureFixture) -> None:
    first = UdpRobot(NU)
    driver = UdpDriver(first.address, NU)
    driver.read(0.0)
    assert first.wait_for_controller(5.0)
    for k in range(5):
        first.send(at(k))
    assert len(_all(driver, 5)) == 5
    port = first.address[1]
    first.close()
    again = UdpRobot(NU, port=port)
    found = threading.Event()
    thread = threading.Thread(target=lambda: again.wait_for_controller(5.0) and (again.send(at(0.5)) or found.set()))
    thread.start()
    assert [m.time for m in _all(driver, 1)] == [0.5]
    thread.join()
    assert found.is_set() and "the robot is connected anew" in caplog.text
    driver.write(torque(1.0))
    assert _received(again) == 1.0
    again.close()
    driver.close()


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1"])
def test_addresses_of_a_network_have_a_warning(host: str, caplog: pytest.LogCaptureFixture) -> None:
    end = UdpRobot(NU, host) if host == "0.0.0.0" else UdpDriver((host, 9), NU)
    end.close()
    assert "the link uses a network" in caplog.text
    caplog.clear()
    UdpRobot(NU).close()
    assert not caplog.records


def test_the_secret_is_a_file_that_others_cannot_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    secret = read_secret()
    own = tmp_path / "lgmpc" / "link.secret"
    assert own.stat().st_mode & 0o777 == 0o600 and own.read_bytes().strip() == secret == read_secret()
    assert list(own.parent.iterdir()) == [own]
    own.chmod(0o640)
    with pytest.raises(InputError, match=r"secret: got .*of mode 640.*chmod 600"):
        read_secret()
    short = tmp_path / "short"
    short.write_text("short")
    short.chmod(0o600)
    with pytest.raises(InputError, match="5 bytes"):
        read_secret(short)
    with pytest.raises(InputError, match="No such file"):
        read_secret(tmp_path / "none")


class Lossy:
    """A network between a driver and a robot that loses, doubles and reorders packets, both ways."""

    def __init__(self, robot: tuple[str, int], share: float, lost_first: int = 0) -> None:
        self._rng, self._share, self._lost_first = random.Random(3), share, lost_first
        self._front, self._back = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._front.bind((LOCALHOST, 0))
        self._back.connect(robot)
        self.address = self._front.getsockname()
        self._client: Any = None
        self._kept: list[tuple[Any, bytes]] = []
        self._open = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._open = False
        self._thread.join()
        self._front.close()
        self._back.close()

    def _run(self) -> None:
        while self._open:
            for end in select.select([self._front, self._back], [], [], 0.02)[0]:
                if end is self._front:
                    packet, self._client = self._front.recvfrom(4096)
                    self._pass(self._back.send, packet)
                else:
                    packet = self._back.recv(4096)
                    if packet[:4] == b"LGMm" and self._lost_first > 0:
                        self._lost_first -= 1
                        continue
                    self._pass(lambda data: self._front.sendto(data, self._client), packet)

    def _pass(self, send: Any, packet: bytes) -> None:
        kept, self._kept = self._kept, []
        chance = self._rng.random()
        if chance < self._share:
            return
        if chance < 2.0 * self._share:
            send(packet)
        if chance > 1.0 - self._share:
            self._kept = [(send, packet)]
        else:
            send(packet)
        for other, late in kept:
            other(late)


@pytest.mark.parametrize(("share", "lost_first"), [(0.0, 3), (0.05, 0)])
def test_in_lock_step_lost_doubled_and_reordered_packets_change_nothing(share: float, lost_first: int) -> None:
    """Before, the first measurement lost left both ends waiting for a minute."""
    robot = UdpRobot(NU)
    network = Lossy(robot.address, share, lost_first)
    driver = UdpDriver(network.address, NU)
    over = threading.Event()

    def controller() -> None:
        while not over.is_set():
            for m in driver.read(0.05):
                driver.write(torque(m.time))

    thread = threading.Thread(target=controller)
    thread.start()
    try:
        assert robot.wait_for_controller(5.0)
        pace = LockStep(robot, timeout_s=5.0)
        assert [pace.answer(at(float(k))).tau[0] for k in range(200)] == list(range(200))
    finally:
        over.set()
        thread.join()
        network.close()
        robot.close()
        driver.close()


def test_a_gain_beyond_all_bounds_is_refused_by_name(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Before, one of 1e300 ended the simulated robot without figures."""
    config = load_config("solo12_balance_inekf", ["duration_s=0.02", "pushes=[]"])
    ready, ends, served = threading.Event(), list[UdpRobot](), list[Served]()

    def link(robot: Robot) -> UdpRobot:
        ends.append(UdpRobot(robot.nu))
        ready.set()
        return ends[0]

    robot = threading.Thread(target=lambda: served.append(serve_config(config, link, lock_step=True)))
    robot.start()
    assert ready.wait(60.0)
    driver = UdpDriver(ends[0].address, 12)
    while robot.is_alive():
        for m in driver.read(0.05):
            gain = 1e300 if m.time == 0.005 else 3.0
            driver.write(Command(np.zeros(12), m.joints, np.zeros(12), np.full(12, gain), np.full(12, 0.1)))
    robot.join()
    driver.close()
    assert len(served[0].time) == 20 and np.isfinite(served[0].q).all()
    assert "the command at 0.005 s is beyond bounds (kp[0] is 1e+300, more than" in caplog.text


def test_programs_with_packets_of_another_version_are_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    robot, old = UdpRobot(NU), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    old.bind((LOCALHOST, 0))
    for _ in range(2):
        old.sendto(b"LGMh" + struct.pack("<HHQ", 1, NU, 0), robot.address)
    assert not robot.wait_for_controller(0.1)
    assert [each.message for each in caplog.records] == ["a controller is refused: its packets are of version 1, not 3"]
    driver = UdpDriver(old.getsockname(), NU)
    driver.read(0.0)
    old.sendto(b"LGMm" + struct.pack("<HHQ", 1, NU, 0) + bytes(8 * (7 + 3 * NU)), driver._socket.getsockname())
    with pytest.raises(InputError, match="robot: got packets of version 1; expected packets of version 3"):
        driver.read(1.0)
    for end in (robot, driver, old):
        end.close()


def _all(driver: UdpDriver, count: int) -> list[Measurement]:
    found: list[Measurement] = []
    for _ in range(100):
        found += driver.read(0.1)
        if len(found) >= count:
            break
    return found


def test_the_newest_command_acts_and_an_old_one_gives_way_to_the_watchdog() -> None:
    robot = UdpRobot(NU)
    driver = UdpDriver(robot.address, NU)
    driver.read(0.0)
    assert robot.wait_for_controller(5.0)
    pace = RealTime(robot, period_s=0.001)

    def controller() -> None:
        assert len(_all(driver, 5)) >= 5  # it is held, and its clock runs
        driver.write(torque(1.0))

    thread = threading.Thread(target=controller)
    thread.start()
    assert pace.answer(at(0.0)).tau[0] == 1.0  # the clock starts with the first command
    thread.join()
    assert pace.answer(at(0.001)).tau[0] == 1.0
    driver.write(torque(2.0))
    driver.write(torque(3.0))
    received = [pace.answer(at(0.002 + 0.001 * k)).tau[0] for k in range(20)]
    assert received[-1] in (2.0, 3.0)
    silent = pace.answer(at(0.2))
    assert (silent.tau == 0.0).all() and (silent.kd > 0.0).all()
    assert pace.unanswered == 1
    with pytest.raises(NoControllerError, match="no command for"):
        pace.answer(at(2.5))
    robot.close()
    driver.close()


def test_lock_step_ends_without_an_answer() -> None:
    robot = UdpRobot(NU)
    driver = UdpDriver(robot.address, NU)
    driver.read(0.0)
    assert robot.wait_for_controller(5.0)
    with pytest.raises(NoControllerError, match=r"no command within 0.05 s"):
        LockStep(robot, timeout_s=0.05).answer(at(0.0))
    robot.close()
    driver.close()
