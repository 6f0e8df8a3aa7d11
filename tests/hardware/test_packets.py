"""Packets of the link between robot and controller."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lgmpc.control import Command, Measurement
from lgmpc.hardware.packets import Layout

NU = 3


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
    layout = Layout(NU)
    m = reading(np.random.default_rng(1), **{name: OPTIONAL[name] for name in names})
    packet = layout.measurement(7, m)
    found = layout.read_measurement(packet)
    assert found is not None and found[0] == 7 and len(packet) <= layout.longest
    for name, value in m._asdict().items():
        other = getattr(found[1], name)
        assert type(other) is type(value)
        np.testing.assert_array_equal(other, value)


def test_a_command_arrives_as_it_was_sent() -> None:
    layout, rng = Layout(NU), np.random.default_rng(2)
    command = Command(*rng.normal(size=(5, NU)))
    found = layout.read_command(layout.command(2**40, command))
    assert found is not None and found[0] == 2**40
    for name, value in command._asdict().items():
        np.testing.assert_array_equal(getattr(found[1], name), value)


def test_the_layout_is_the_documented_one() -> None:
    """Written by hand from the module's table, as the driver of a robot would be."""
    values = np.arange(7 + 3 * NU, dtype="<f8")
    packet = b"LGMm" + struct.pack("<HHHHIQ", 2, NU, 0, 0, 0, 5) + values.tobytes()
    found = Layout(NU).read_measurement(packet)
    assert found is not None
    number, m = found
    assert (number, m.time) == (5, 0.0)
    np.testing.assert_array_equal(np.concatenate([m.gyro, m.accelerometer, m.joints, m.speeds, m.torques]), values[1:])
    extended = b"LGMm" + struct.pack("<HHHHIQ", 2, NU, 2, 0b100010, 0, 6) + values.tobytes()
    found = Layout(NU).read_measurement(extended + struct.pack("<3d", 7.0, 8.0, 24.0))
    assert found is not None and found[0] == 6 and found[1].supply_voltage == 24.0 and found[1].attitude is None
    np.testing.assert_array_equal(found[1].foot_forces, [7.0, 8.0])
    answer = Layout(NU).command(5, Command(*np.arange(5 * NU, dtype=float).reshape(5, NU)))
    assert answer == b"LGMc" + struct.pack("<HHHHIQ15d", 2, NU, 0, 0, 0, 5, *range(15))


@pytest.mark.parametrize("broken", ["kind", "version", "joints", "short", "long", "nan", "bits", "feet", "unknown bit"])
def test_what_is_no_packet_of_this_robot_is_none(broken: str) -> None:
    layout, m = Layout(NU), reading(np.random.default_rng(3))
    good = layout.measurement(1, m)
    changed = {
        "kind": b"LGMx" + good[4:],
        "version": good[:4] + b"\x01" + good[5:],
        "joints": Layout(NU + 1).measurement(1, Measurement(0.0, *np.zeros((2, 3)), *np.zeros((3, NU + 1)))),
        "short": good[:-1],
        "long": good + b"\0",
        "bits": good[:10] + b"\x20" + good[11:],
        "unknown bit": good[:11] + b"\x01" + good[12:],
        "feet": good[:8] + b"\xff\xff" + good[10:],
        "nan": good[:-8] + struct.pack("<d", float("nan")),
    }
    assert layout.read_measurement(good) is not None
    assert layout.read_measurement(changed[broken]) is None
    assert layout.read_command(good) is None


def test_packets_of_another_version_are_recognised() -> None:
    layout = Layout(NU)
    old = b"LGMh" + struct.pack("<HHQ", 1, NU, 0)
    assert Layout.other_version(old) == 1 and not layout.is_hello(old)
    assert Layout.other_version(layout.hello()) is None and Layout.other_version(b"LGM") is None


@given(st.binary(max_size=200))
def test_any_bytes_are_read_without_an_exception(packet: bytes) -> None:
    layout = Layout(NU)
    for found in (layout.read_measurement(packet), layout.read_command(packet)):
        assert found is None or np.isfinite(found[0])
