"""Unitree's robots over DDS (``rt/lowcmd``, ``rt/lowstate``): a driver, and a simulated robot that speaks the same.

Requires the extra ``unitree`` (Cyclone DDS). Nobody is authenticated on these topics: whoever reaches the robot's
network can command it.
"""

import json
import logging
from collections.abc import Sequence
from time import perf_counter, sleep
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from lgmpc.control.interface import Command, Measurement
from lgmpc.errors import InputError
from lgmpc.hardware.unitree_messages import COMMANDS, REQUEST, RESPONSE, STATES, Codec, Struct, idl_type
from lgmpc.typing import Array, IntArray

_LOG = logging.getLogger(__name__)
_QUADRUPED = [f"{leg}_{joint}_joint" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")]
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_HUMANOID = [
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _LEG),
    *(f"waist_{part}_joint" for part in ("yaw", "roll", "pitch")),
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _ARM),
]
_MOTORS = {"go": _QUADRUPED, "hg": _HUMANOID}
"""Joints in the order of the motors, by family of messages; G1's joints at the waist and ankles are pitch and roll."""

_DOMAIN = {"lo": 1}
"""Domain by interface: that of unitree_mujoco on the loopback, 0 on robots."""
_KEPT = 64
"""Messages kept for a reader that is late."""
_CHECK_MODE, _RELEASE_MODE = 1001, 1003
_SERVICE_S = 2.0
_CONFIG = (
    '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="{}"/></Interfaces></General></Domain>'
    "</CycloneDDS>"
)


class _Network:
    """A participant of a DDS domain on one interface; a process has at most one of each domain."""

    _present: "WeakValueDictionary[int, _Network]" = WeakValueDictionary()

    @classmethod
    def of(cls, interface: str, domain: int | None) -> "_Network":
        """Return the present participant of a domain, or a new one."""
        number = _DOMAIN.get(interface, 0) if domain is None else domain
        network = cls._present.get(number)
        if network is None:
            network = cls._present[number] = cls(interface, number)
        return network

    def __init__(self, interface: str, number: int) -> None:
        try:
            from cyclonedds.core import DDSException
            from cyclonedds.domain import Domain, DomainParticipant
        except ImportError as error:
            raise InputError("driver", "unitree", 'the extra unitree: pip install "lgmpc[unitree]"') from error
        try:
            self._domain = Domain(number, _CONFIG.format(interface))
            self.participant = DomainParticipant(number)
        except DDSException as error:
            import socket

            names = tuple(name for _, name in socket.if_nameindex())
            raise InputError("interface", interface, f"an interface of this machine ({error.msg})", names) from error
        self.place = f"{interface}, domain {number}"

    def _endpoint(self, kind: str, topic: str, struct: Struct) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        plain = Policy.DataRepresentation(use_cdrv0_representation=True)
        named = Topic(self.participant, topic, idl_type(struct), Qos(plain))
        if kind == "reader":
            return DataReader(self.participant, named, Qos(plain, Policy.History.KeepLast(_KEPT)))
        return DataWriter(self.participant, named, Qos(plain, Policy.Reliability.BestEffort))

    def reader(self, topic: str, struct: Struct) -> Any:
        """Return a reader."""
        return self._endpoint("reader", topic, struct)

    def writer(self, topic: str, struct: Struct) -> Any:
        """Return a writer."""
        return self._endpoint("writer", topic, struct)


class _Channel:
    """One reader and one writer of messages of fixed size, in CDR bytes."""

    def __init__(self, network: _Network, read: tuple[str, Struct], write: tuple[str, Struct]) -> None:
        from cyclonedds import _clayer
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet

        self._network = network  # the domain ends with it
        self._mask = SampleState.Any | ViewState.Any | InstanceState.Any
        self._take, self._put = _clayer.ddspy_take, _clayer.ddspy_write
        self.reader, self._writer = network.reader(*read), network.writer(*write)
        self._condition = ReadCondition(self.reader, self._mask)
        self._waits = WaitSet(network.participant)
        self._waits.attach(self._condition)
        self.codec, self._out = Codec(read[1]), Codec(write[1])

    def arrived(self, timeout_s: float) -> list[tuple[Any, float]]:
        """Return the records that have arrived, after waiting for the first one, and when each was written, s."""
        found = self._taken()
        if not found and timeout_s > 0.0:
            self._waits.wait(round(1e9 * timeout_s))
            found = self._taken()
        return found

    def send(self, record: Any) -> None:
        """Write a record, with its checksum."""
        self._put(self._writer._ref, self._out.encode(record))

    def _taken(self) -> list[tuple[Any, float]]:
        taken = self._take(self.reader._ref, self._mask, _KEPT)
        if isinstance(taken, int):
            return []
        valid = ((self.codec.decode(data), 1e-9 * info.source_timestamp) for data, info in taken if info.valid_data)
        return [each for each in valid if each[0] is not None]


def _order(joints: Sequence[str]) -> tuple[str, IntArray]:
    """Return the family of messages of a robot, and the motor of each of its joints."""
    for family, motors in _MOTORS.items():
        if set(joints) <= set(motors):
            return family, np.array([motors.index(name) for name in joints])
    raise InputError("joints", ", ".join(joints[:3]) + ", ...", "the joints of a Go2, B2 or G1, as in their URDF")


class UnitreeDriver:
    """A :class:`lgmpc.hardware.Driver` of a Go2, B2 or G1.

    The robot's own motion service is released first, so that it sends no commands beside these. Measurements are those
    of the robot's state messages, at its rate (500 Hz) and by its clock, which counts milliseconds; where it has none,
    by the times at which they were written.

    Args:
        joints: names of the joints, in the order of measurements and commands.
        interface: network interface at which the robot is: ``eth0``; ``lo`` for a simulated one.
        domain: number of the DDS domain; 0, or that of unitree_mujoco on ``lo``.

    Raises:
        InputError: if the package, the interface or the robot's motors are not there, or the robot does not release
            its own service.
    """

    def __init__(self, joints: Sequence[str], interface: str, domain: int | None = None) -> None:
        family, self._motor = _order(joints)
        network = _Network.of(interface, domain)
        self._channel = _Channel(network, ("rt/lowstate", STATES[family]), ("rt/lowcmd", COMMANDS[family]))
        self._family = family
        self._record = Codec(COMMANDS[family]).record()
        motors = self._record["motor_cmd"]
        motors["mode"][self._motor] = 1  # of those with a joint; others are off
        if family == "go":
            self._record["head"], self._record["level_flag"] = (0xFE, 0xEF), 0xFF
            motors["q"], motors["dq"] = 2.146e9, 16000.0  # their values for no target
        _release(network)

    def read(self, timeout_s: float) -> list[Measurement]:
        """Return the measurements that have arrived; see :meth:`lgmpc.hardware.Driver.read`."""
        return [self._measurement(*each) for each in self._channel.arrived(timeout_s)]

    def write(self, command: Command) -> None:
        """Send the command."""
        motors, motor = self._record["motor_cmd"], self._motor
        for name, values in zip(("tau", "q", "dq", "kp", "kd"), command, strict=True):
            motors[name][motor] = values
        self._channel.send(self._record)

    def close(self) -> None:
        """Leave the topics."""
        del self._channel

    def _measurement(self, state: Any, written: float) -> Measurement:
        imu, motors = state["imu_state"], state["motor_state"][self._motor]
        tick = int(state["tick"])
        hot, w, volts, flags = motors["temperature"], imu["quaternion"], None, None
        if self._family == "hg":
            self._record["mode_machine"] = state["mode_machine"]
            hot, flags = hot[:, 0], motors["motorstate"].astype(np.int64)
        else:
            volts = float(state["power_v"]) or None
        return Measurement(
            1e-3 * tick if tick else written,  # the Python unitree_mujoco has no clock
            _wide(imu["gyroscope"]),
            _wide(imu["accelerometer"]),
            _wide(motors["q"]),
            _wide(motors["dq"]),
            _wide(motors["tau_est"]),
            attitude=_wide(w[[1, 2, 3, 0]]),
            supply_voltage=volts,
            motor_temperature=_wide(hot),
            error_flags=flags,
        )


class UnitreeRobot:
    """The robot's end: it publishes states, and takes commands whose checksum is right.

    Commands do not say from which measurement they were computed: each counts as that of the newest one.

    Args:
        joints: names of the joints, in the order of measurements and commands.
        interface: network interface.
        domain: number of the DDS domain.

    Attributes:
        place: where it is, in words.
        forged: number of commands without the right checksum.
    """

    def __init__(self, joints: Sequence[str], interface: str, domain: int | None = None) -> None:
        family, self._motor = _order(joints)
        network = _Network.of(interface, domain)
        self._channel = _Channel(network, ("rt/lowcmd", COMMANDS[family]), ("rt/lowstate", STATES[family]))
        self.place, self.forged = f"rt/lowcmd at {network.place}", 0
        self._record = Codec(STATES[family]).record()
        self._record["motor_state"]["mode"][self._motor] = 1

    def wait_for_controller(self, timeout_s: float) -> bool:
        """Wait for a program that publishes commands, and return whether one came."""
        end = perf_counter() + timeout_s
        while not (found := bool(self._channel.reader.get_matched_publications())) and perf_counter() < end:
            sleep(0.01)
        return found

    def send(self, measurement: Measurement) -> None:
        """Publish the state."""
        record, m, motor = self._record, measurement, self._motor
        record["tick"] = round(1e3 * m.time) + 1  # 0 says that there is no clock
        imu, motors = record["imu_state"], record["motor_state"]
        imu["gyroscope"], imu["accelerometer"] = m.gyro, m.accelerometer
        if m.attitude is not None:
            imu["quaternion"] = m.attitude[[3, 0, 1, 2]]
        for name, values in zip(("q", "dq", "tau_est"), (m.joints, m.speeds, m.torques), strict=True):
            motors[name][motor] = values
        self._channel.send(record)

    def receive(self) -> tuple[int, Command] | None:
        """Return the newest command that has arrived, if any; its measurement is assumed to be the newest one."""
        found = self._commands(0.0)
        return (0, found[-1]) if found else None

    def receive_answer(self, timeout_s: float) -> Command | None:
        """Wait for a command; None if none arrives."""
        found = self._commands(timeout_s)
        return found[-1] if found else None

    def close(self) -> None:
        """Leave the topics."""
        del self._channel

    def _commands(self, timeout_s: float) -> list[Command]:
        commands = []
        for record, _ in self._channel.arrived(timeout_s):
            if not self._channel.codec.intact(record):
                self.forged += 1
                continue
            motors = record["motor_cmd"][self._motor]
            on = motors["mode"] == 1
            values = (np.where(on, motors[name], 0.0) for name in ("tau", "q", "dq", "kp", "kd"))
            command = Command(*(each.astype(np.float64) for each in values))
            if not command.fault:
                commands.append(command)
        return commands


def _wide(values: Any) -> Array:
    return np.asarray(values, dtype=np.float64)


def _release(network: _Network) -> None:
    """Release the robot's own motion service, if there is one: it would send commands too."""
    requests = network.writer("rt/api/motion_switcher/request", REQUEST)
    answers = network.reader("rt/api/motion_switcher/response", RESPONSE)
    end = perf_counter() + _SERVICE_S
    while not requests.get_matched_subscriptions():
        if perf_counter() > end:
            _LOG.info("no motion service at %s: nothing to release", network.place)
            return
        sleep(0.02)
    name = "without an answer"
    for _ in range(5):
        answer = _call(requests, answers, _CHECK_MODE)
        if answer:  # the first one may be sent before the service has found this program
            name = json.loads(answer).get("name", "")
            if not name:
                return
            _LOG.info("releasing the robot's own motion service (%s)", name)
            _call(requests, answers, _RELEASE_MODE)
    raise InputError("robot", f"its motion service runs ({name})", "a robot that releases it: stand it down by its app")


def _call(requests: Any, answers: Any, api: int) -> str:
    """Call a method of the motion service, and return its answer; empty if there is none."""
    types, number = idl_type(REQUEST), int(1e9 * perf_counter())
    header, identity, lease, policy = (
        idl_type(each) for each in (REQUEST.fields[0][1], *(part for _, part, _ in REQUEST.fields[0][1].fields))
    )
    requests.write(types(header(identity(number, api), lease(0), policy(0, False)), "{}", []))
    end = perf_counter() + _SERVICE_S
    while perf_counter() < end:
        for answer in answers.take(N=_KEPT):
            if getattr(answer, "header", None) is not None and answer.header.identity.id == number:
                return str(answer.data)
        sleep(0.005)
    return ""
