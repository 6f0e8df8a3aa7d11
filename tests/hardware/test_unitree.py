"""Messages and links of Unitree's robots; both ends are in this process, on the loopback."""

import itertools
import json
import os
import struct
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.config.deploying import deploy_config, serve_config
from lgmpc.control import Command, Measurement
from lgmpc.errors import InputError
from lgmpc.hardware.simulated import Served
from lgmpc.hardware.unitree import UnitreeDriver, UnitreeRobot, _Network
from lgmpc.hardware.unitree_messages import COMMANDS, REQUEST, RESPONSE, STATES, Codec, Struct, crc32, idl_type

DOMAINS = itertools.count(2 + os.getpid() % 180)
JOINTS = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
PACKED = {
    ("go", "command"): "<4B4IH2x" + "B3x5f3I" * 20 + "4B" + "55Bx2I",
    ("go", "state"): "<4B4IH2x" + "13fb3x" + "B3x7fb3x3I" * 20 + "4BiH4b15H" + "8hI41B3xf2b2x2f4h2I",
    ("hg", "command"): "<2B2x" + "B3x5fI" * 35 + "5I",
    ("hg", "state"): "<2I2B2xI" + "13fh2x" + "B3x4f2hf7I" * 35 + "40B5I",
}
"""C structs as in unitree_sdk2py/utils/crc.py."""


def filled(part: Struct, rng: np.random.Generator) -> tuple[Any, list[Any]]:
    """Return a typed message with random values, and these in order; of integers those that all formats can hold."""
    values, flat = {}, []
    for name, kind, length in part.fields:
        found = []
        for _ in range(length or 1):
            if isinstance(kind, Struct):
                one, inner = filled(kind, rng)
                flat += inner
            else:
                one = float(np.float32(rng.normal())) if kind == "f4" else int(rng.integers(0, 127))
                flat.append(one)
            found.append(one)
        values[name] = found if length else found[0]
    return idl_type(part)(**values), flat


def crc_by_bits(words: list[int]) -> int:
    """The published algorithm, bit after bit."""
    crc = 0xFFFFFFFF
    for word in words:
        for bit in range(31, -1, -1):
            carry = crc & 0x80000000
            crc = (crc << 1) & 0xFFFFFFFF
            crc ^= 0x04C11DB7 if carry else 0
            crc ^= 0x04C11DB7 if word >> bit & 1 else 0
    return crc


@pytest.mark.parametrize(("family", "kind"), PACKED)
def test_bytes_and_checksums_are_those_of_the_typed_messages(family: str, kind: str) -> None:
    part = (COMMANDS if kind == "command" else STATES)[family]
    codec, (typed, flat) = Codec(part), filled(part, np.random.default_rng(4))
    data = typed.serialize(use_version_2=False)
    record = codec.decode(data + bytes(-len(data) % 4))
    assert record is not None and codec.dtype.itemsize == struct.calcsize(PACKED[family, kind])
    assert record.tobytes() == struct.pack(PACKED[family, kind], *flat)
    encoded = codec.encode(record)
    typed.crc = crc_by_bits(list(struct.unpack(f"<{codec.dtype.itemsize // 4 - 1}I", record.tobytes()[:-4])))
    data = typed.serialize(use_version_2=False)
    assert encoded == data + bytes(-len(data) % 4)
    assert codec.intact(codec.decode(encoded))
    assert codec.decode(encoded[:-4]) is None and codec.decode(b"\0\0" + encoded[2:]) is None


def test_the_checksum_of_known_words() -> None:
    assert crc32(bytes(4)) == crc_by_bits([0])
    assert crc32(struct.pack("<3I", 1, 0xFFFFFFFF, 0x12345678)) == crc_by_bits([1, 0xFFFFFFFF, 0x12345678])


@pytest.fixture
def linked() -> Iterator[tuple[UnitreeRobot, UnitreeDriver]]:
    domain = next(DOMAINS)
    robot = UnitreeRobot(JOINTS, "lo", domain)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lgmpc.hardware.unitree._SERVICE_S", 0.0)
        driver = UnitreeDriver(JOINTS, "lo", domain)
    assert robot.wait_for_controller(5.0)
    yield robot, driver
    robot.close()
    driver.close()


def exchanged(robot: UnitreeRobot, driver: UnitreeDriver, sent: Measurement) -> Measurement:
    for _ in range(100):  # until both have found each other
        robot.send(sent)
        found = driver.read(0.05)
        if found:
            return found[-1]
    raise AssertionError("no measurement")


def test_measurements_and_commands_arrive_in_the_order_of_the_joints(
    linked: tuple[UnitreeRobot, UnitreeDriver],
) -> None:
    robot, driver = linked
    own = [np.arange(3.0), np.arange(3.0, 6.0), *np.arange(36.0).reshape(3, 12)]
    attitude = np.array([0.0, 0.6, 0.0, 0.8])
    found = exchanged(robot, driver, Measurement(1.234, *own, attitude=attitude))
    assert found.time == pytest.approx(1.235)
    for sent, name in zip([*own, attitude], (*Measurement._fields[1:6], "attitude"), strict=True):
        np.testing.assert_allclose(getattr(found, name), sent, rtol=1e-6)
    command = Command(*np.arange(60.0).reshape(5, 12))
    driver.write(command)
    answer = robot.receive_answer(5.0)
    assert answer is not None
    for sent, received in zip(command, answer, strict=True):
        np.testing.assert_array_equal(received, sent)
    motors = driver._record["motor_cmd"]  # the order of the motors begins with the right leg in front
    assert motors["q"][:6].tolist() == [15.0, 16.0, 17.0, 12.0, 13.0, 14.0]
    assert motors["mode"].tolist() == [1] * 12 + [0] * 8
    assert driver._record["head"].tolist() == [0xFE, 0xEF] and driver._record["level_flag"] == 0xFF
    damaged = driver._channel._out.encode(driver._record)[:-1] + b"\xff"
    driver._channel._put(driver._channel._writer._ref, damaged)
    assert robot.receive_answer(0.5) is None and robot.forged == 1


def test_readings_of_a_robot_without_a_clock_have_the_times_at_which_they_were_written(
    linked: tuple[UnitreeRobot, UnitreeDriver],
) -> None:
    """unitree_mujoco in Python has none; several that are read together were not taken together."""
    robot, driver = linked
    exchanged(robot, driver, Measurement(1.0, *np.zeros((2, 3)), *np.zeros((3, 12))))
    driver.read(0.05)
    robot._record["tick"] = 0
    for _ in range(3):
        robot._channel.send(robot._record)
        time.sleep(0.02)
    assert np.diff([each.time for each in driver.read(0.5)]).min() >= 0.02


def test_the_robots_own_motion_service_is_released(monkeypatch: pytest.MonkeyPatch) -> None:
    domain, names, over = next(DOMAINS), ["normal"], threading.Event()
    network = _Network.of("lo", domain)
    requests = network.reader("rt/api/motion_switcher/request", REQUEST)
    answers, called = network.writer("rt/api/motion_switcher/response", RESPONSE), list[int]()

    def serve() -> None:
        header = idl_type(RESPONSE.fields[0][1])
        status = idl_type(RESPONSE.fields[0][1].fields[1][1])
        while not over.is_set():
            for each in filter(lambda sample: hasattr(sample, "header"), requests.take(N=8)):  # others: a writer ended
                called.append(each.header.identity.api_id)
                if called[-1] == 1003:
                    names[0] = ""
                data = json.dumps({"name": names[0]})
                answers.write(idl_type(RESPONSE)(header(each.header.identity, status(0)), data, []))
            time.sleep(0.005)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        UnitreeDriver(JOINTS, "lo", domain).close()
    finally:
        over.set()
        thread.join()
    assert called[0] == called[-1] == 1001 and 1003 in called and names == [""]


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"interface: got nowhere0; expected an interface of this machine"):
        UnitreeRobot(JOINTS, "nowhere0", next(DOMAINS))
    with pytest.raises(InputError, match="joints: got FL_HAA"):
        UnitreeRobot(["FL_HAA"], "lo")
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    with pytest.raises(InputError, match=r'pip install "lgmpc\[unitree\]"'):
        UnitreeRobot(JOINTS, "lo", next(DOMAINS))


def test_go2_stands_by_the_topics_of_its_maker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lgmpc.hardware.unitree._SERVICE_S", 0.0)
    patient = "deployment={silence_s: 30.0, lost_s: 60.0}"
    config = load_config(
        "go2_velocity", ["duration_s=0.2", "gate={}", "wbc.rate_hz=500", "mpc.enabled=false", "commands=[]", patient]
    )
    domain, served, ready = next(DOMAINS), list[Served](), threading.Event()

    def link(robot: Any) -> UnitreeRobot:
        end = UnitreeRobot(robot.joint_names, "lo", domain)
        ready.set()
        return end

    thread = threading.Thread(target=lambda: served.append(serve_config(config, link, lock_step=True)))
    thread.start()
    assert ready.wait(60.0)
    _, deployment = deploy_config(config, lambda robot: UnitreeDriver(robot.joint_names, "lo", domain), tmp_path)
    thread.join()
    assert (deployment.ticks, deployment.missing, deployment.misdated) == (100, 0, 0)
    assert served[0].max_tilt_deg < 0.5 and deployment.ending.name == "DURATION"
