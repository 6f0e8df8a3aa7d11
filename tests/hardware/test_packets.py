"""Packets of the link between robot and controller."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lgmpc.control import Command, Measurement
from lgmpc.hardware.packets import Layout

NU = 3


def reading(rng: np.random.Generator) -> Measurement:
    return Measurement(float(rng.normal()), *(rng.normal(size=3) for _ in range(2)), *rng.normal(size=(3, NU)))


def test_a_measurement_arrives_as_it_was_sent() -> None:
    layout, m = Layout(NU), reading(np.random.default_rng(1))
    found = layout.read_measurement(layout.measurement(7, m))
    assert found is not None
    number, other = found
    assert number == 7
    for name, value in m._asdict().items():
        np.testing.assert_array_equal(getattr(other, name), value)


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
    packet = b"LGMm" + struct.pack("<HHQ", 2, NU, 5) + values.tobytes()
    found = Layout(NU).read_measurement(packet)
    assert found is not None
    number, m = found
    assert (number, m.time) == (5, 0.0)
    np.testing.assert_array_equal(np.concatenate([m.gyro, m.accelerometer, m.joints, m.speeds, m.torques]), values[1:])
    answer = Layout(NU).command(5, Command(*np.arange(5 * NU, dtype=float).reshape(5, NU)))
    assert answer == b"LGMc" + struct.pack("<HHQ15d", 2, NU, 5, *range(15))


@pytest.mark.parametrize("broken", ["kind", "version", "joints", "short", "long", "nan"])
def test_what_is_no_packet_of_this_robot_is_none(broken: str) -> None:
    layout, m = Layout(NU), reading(np.random.default_rng(3))
    good = layout.measurement(1, m)
    changed = {
        "kind": b"LGMx" + good[4:],
        "version": good[:4] + b"\x01" + good[5:],
        "joints": Layout(NU + 1).measurement(1, Measurement(0.0, *np.zeros((2, 3)), *np.zeros((3, NU + 1)))),
        "short": good[:-1],
        "long": good + b"\0",
        "nan": good[:-8] + struct.pack("<d", float("nan")),
    }
    assert layout.read_measurement(good) is not None
    assert layout.read_measurement(changed[broken]) is None
    assert layout.read_command(good) is None


@given(st.binary(max_size=200))
def test_any_bytes_are_read_without_an_exception(packet: bytes) -> None:
    layout = Layout(NU)
    for found in (layout.read_measurement(packet), layout.read_command(packet)):
        assert found is None or np.isfinite(found[0])
