"""Packets of the link between robot and controller."""

import hashlib
import hmac
import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.control import Command, Measurement
from lgmpc.hardware.packets import ANOTHER_ROBOT, ANOTHER_SECRET, PacketLayout

NU = 3
SECRET, NONCES = b"sixteen bytes or more", (b"c" * 16, b"r" * 16)
KEY = hmac.new(SECRET, b"".join(NONCES), hashlib.sha256).digest()


def connected(nu: int = NU) -> PacketLayout:
    layout = PacketLayout(nu, SECRET)
    layout.connect(*NONCES)
    return layout


def signed(packet: bytes, key: bytes = KEY) -> bytes:
    return packet + hmac.new(key, packet, hashlib.sha256).digest()[:16]


def reading(rng: np.random.Generator, **optional: object) -> Measurement:
    own = (rng.normal(size=3) for _ in range(2))
    return Measurement(float(rng.normal()), *own, *rng.normal(size=(3, NU)), **optional)  # type: ignore[arg-type]


OPTIONAL = {
    "attitude": np.array([0.0, 0.6, 0.0, 0.8]),
    "foot_forces": np.array([1.0, 2.0]),
    "external_pose": np.arange(7.0),
    "external_velocity": np.arange(6.0),
    "external_age": 0.004,
    "supply_voltage": 24.5,
    "motor_temperature": np.array([30.0, 31.0, 32.0]),
    "error_flags": np.array([0, 0x80000001, 2]),
}


@pytest.mark.parametrize("names", [(), *((name,) for name in OPTIONAL), ("attitude", "external_age"), tuple(OPTIONAL)])
def test_a_measurement_arrives_as_it_was_sent(names: tuple[str, ...]) -> None:
    layout = connected()
    m = reading(np.random.default_rng(1), **{name: OPTIONAL[name] for name in names})
    packet = layout.measurement(7, m)
    found = layout.read_measurement(packet)
    assert found is not None and found[0] == 7 and len(packet) <= layout.longest
    for name, value in m._asdict().items():
        other = getattr(found[1], name)
        assert type(other) is type(value)
        np.testing.assert_array_equal(other, value)


def test_a_command_arrives_as_it_was_sent() -> None:
    layout, rng = connected(), np.random.default_rng(2)
    command = Command(*rng.normal(size=(5, NU)))
    found = layout.read_command(layout.command(2**40, 2**50, command))
    assert found is not None and found[:2] == (2**40, 2**50)
    for name, value in command._asdict().items():
        np.testing.assert_array_equal(getattr(found[2], name), value)


def test_the_layout_is_the_documented_one() -> None:
    """Written by hand from the module's table, as the driver of a robot would be."""
    layout, values = connected(), np.arange(7 + 3 * NU, dtype="<f8")
    packet = b"LGMm" + struct.pack("<HHHHIQ", 3, NU, 0, 0, 0, 5) + values.tobytes()
    found = layout.read_measurement(signed(packet))
    assert found is not None
    number, m = found
    assert (number, m.time) == (5, 0.0)
    np.testing.assert_array_equal(np.concatenate([m.gyro, m.accelerometer, m.joints, m.speeds, m.torques]), values[1:])
    extended = b"LGMm" + struct.pack("<HHHHIQ", 3, NU, 2, 0b100010, 0, 6) + values.tobytes()
    found = layout.read_measurement(signed(extended + struct.pack("<3d", 7.0, 8.0, 24.0)))
    assert found is not None and found[0] == 6 and found[1].supply_voltage == 24.0 and found[1].attitude is None
    np.testing.assert_array_equal(found[1].foot_forces, [7.0, 8.0])
    answer = layout.command(9, 5, Command(*np.arange(5 * NU, dtype=float).reshape(5, NU)))
    assert answer == signed(b"LGMc" + struct.pack("<HHHHIQ16d", 3, NU, 0, 0, 0, 9, 5, *range(15)))
    empty = struct.pack("<HHHHIQ", 3, NU, 0, 0, 0, 0)
    assert layout.hello(NONCES[0]) == signed(b"LGMh" + empty + NONCES[0], SECRET)
    assert layout.welcome(*NONCES) == signed(b"LGMw" + empty + b"".join(NONCES), SECRET)


def test_who_is_greeted() -> None:
    layout = connected()
    assert layout.read_hello(layout.hello(NONCES[0])) == NONCES[0]
    assert layout.read_hello(PacketLayout(NU, b"another secret").hello(NONCES[0])) == ANOTHER_SECRET
    assert layout.read_hello(PacketLayout(NU + 1, SECRET).hello(NONCES[0])) == ANOTHER_ROBOT
    assert layout.read_welcome(layout.welcome(*NONCES), NONCES[0]) == NONCES[1]
    assert layout.read_welcome(layout.welcome(*NONCES), NONCES[1]) is None  # the answer to another hello
    assert layout.read_refusal(PacketLayout(NU + 1, SECRET).refusal(ANOTHER_ROBOT)) == (ANOTHER_ROBOT, NU + 1)
    assert layout.read_refusal(PacketLayout(NU, b"another secret").refusal(ANOTHER_SECRET)) == (ANOTHER_SECRET, NU)
    assert layout.read_refusal(PacketLayout(NU, b"another secret").refusal(ANOTHER_ROBOT)) is None


@pytest.mark.parametrize(
    "broken", ["kind", "version", "joints", "short", "long", "nan", "bits", "feet", "unknown bit", "key", "forged"]
)
def test_what_is_no_packet_of_this_robot_is_none(broken: str) -> None:
    layout, m = connected(), reading(np.random.default_rng(3))
    good = layout.measurement(1, m)
    plain = good[:-16]
    changed = {
        "kind": signed(b"LGMx" + plain[4:]),
        "version": signed(plain[:4] + b"\x01" + plain[5:]),
        "joints": connected(NU + 1).measurement(1, Measurement(0.0, *np.zeros((2, 3)), *np.zeros((3, NU + 1)))),
        "short": signed(plain[:-1]),
        "long": signed(plain + b"\0"),
        "bits": signed(plain[:10] + b"\x20" + plain[11:]),
        "unknown bit": signed(plain[:11] + b"\x01" + plain[12:]),
        "feet": signed(plain[:8] + b"\xff\xff" + plain[10:]),
        "nan": signed(plain[:-8] + struct.pack("<d", float("nan"))),
        "key": signed(plain, SECRET),
        "forged": good[:60] + bytes([good[60] ^ 1]) + good[61:],
    }
    assert layout.read_measurement(good) is not None
    assert layout.read_measurement(changed[broken]) is None
    assert layout.read_command(good) is None


def test_packets_of_another_version_are_recognised() -> None:
    layout = connected()
    old = b"LGMh" + struct.pack("<HHQ", 1, NU, 0)
    assert PacketLayout.other_version(old) == 1 and layout.read_hello(old) is None
    assert PacketLayout.other_version(layout.hello(NONCES[0])) is None and PacketLayout.other_version(b"LGM") is None


@given(st.binary(max_size=200))
def test_any_bytes_are_read_without_an_exception(packet: bytes) -> None:
    layout = connected()
    for each in (packet, signed(packet), signed(packet, SECRET)):
        for found in (layout.read_measurement(each), layout.read_command(each)):
            assert found is None or np.isfinite(found[0])
        assert layout.read_welcome(each, NONCES[0]) is None
        assert layout.read_hello(each) in (None, ANOTHER_SECRET) or len(each) > 56
        assert layout.read_refusal(each) is None or len(each) == 40
