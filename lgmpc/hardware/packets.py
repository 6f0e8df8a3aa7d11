"""Packets between a robot and its controller: little-endian, 64-bit floats.

=========== ========================================================================================================
bytes       content
=========== ========================================================================================================
0-3         ``LGMm`` (measurement), ``LGMc`` (command) or ``LGMh`` (hello, sent by a controller to connect)
4-5         version of this layout, 2
6-7         nu, number of joints
8-9         nc, number of feet with a measured force; 0 in other packets
10-11       bits of the optional quantities in a measurement; 0 in other packets
12-15       0
16-23       number of the measurement; in a command, of the measurement from which it was computed
24-         measurement: time, gyro (3), accelerometer (3), joints (nu), speeds (nu), torques (nu), then those optional
            quantities whose bit is set: attitude (4; bit 0), foot forces (nc; 1), external pose (7; 2), external
            velocity (6; 3), external age (1; 4), supply voltage (1; 5), motor temperature (nu; 6), error flags (nu; 7)
24-         command: tau (nu), q_des (nu), v_des (nu), kp (nu), kd (nu)
=========== ========================================================================================================

Units are those of :class:`lgmpc.control.Measurement` and :class:`lgmpc.control.Command`. Version 1 had one gain for
all joints, and no optional quantities.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from lgmpc.control.interface import Command, Measurement
from lgmpc.typing import IntArray

__all__ = ["HELLO", "VERSION", "Layout"]

_HEAD = struct.Struct("<4sHHHHIQ")
VERSION = 2
"""Version of the packets."""
_MEASUREMENT, _COMMAND = b"LGMm", b"LGMc"
HELLO = b"LGMh"
"""First bytes of the packet by which a controller connects."""
_MOST_FEET = 64


class Layout:
    """Packets of a robot with ``nu`` joints.

    Packets of another layout, of another number of joints, or with numbers that are not finite are rejected.

    Args:
        nu: number of joints.

    Attributes:
        longest: length of the longest packet, B.
    """

    def __init__(self, nu: int) -> None:
        self._nu = nu
        self.longest = _HEAD.size + 8 * (26 + 5 * nu + _MOST_FEET)

    def hello(self) -> bytes:
        """Return the packet by which a controller connects."""
        return self._pack(HELLO, 0, np.empty(0))

    def is_hello(self, packet: bytes) -> bool:
        """Return whether a packet is the hello of a controller of this robot."""
        return packet == self.hello()

    def measurement(self, number: int, m: Measurement) -> bytes:
        """Return the packet of measurement ``number``."""
        given = [None if value is None else np.atleast_1d(value) for value in m[6:]]
        present = sum(1 << bit for bit, value in enumerate(given) if value is not None)
        values = np.concatenate([np.atleast_1d(m.time), *m[1:6], *(value for value in given if value is not None)])
        return self._pack(_MEASUREMENT, number, values, 0 if m.foot_forces is None else m.foot_forces.size, present)

    def read_measurement(self, packet: bytes) -> tuple[int, Measurement] | None:
        """Return the number and the measurement of a packet; None if it is not a valid measurement."""
        found = self._unpack(_MEASUREMENT, packet)
        if found is None:
            return None
        number, nc, present, values = found
        nu = self._nu
        sizes = [1, 3, 3, nu, nu, nu]
        optional = (4, nc, 7, 6, 1, 1, nu, nu)
        sizes += [size for bit, size in enumerate(optional) if present & 1 << bit]
        if present >> len(optional) or values.size != sum(sizes):
            return None
        parts: Iterator[Any] = iter(np.split(values, np.cumsum(sizes[:-1])))
        time, *own = (next(parts) for _ in range(6))
        given: list[Any] = [next(parts) if present & 1 << bit else None for bit in range(len(optional))]
        given[4:6] = [None if value is None else float(value[0]) for value in given[4:6]]
        if given[7] is not None:
            flags: IntArray = given[7].astype(np.int64)
            given[7] = flags
        return number, Measurement(float(time[0]), *own, *given)

    def command(self, number: int, c: Command) -> bytes:
        """Return the packet of the command for measurement ``number``."""
        return self._pack(_COMMAND, number, np.concatenate(c))

    def read_command(self, packet: bytes) -> tuple[int, Command] | None:
        """Return the number of the measurement and the command for it; None if it is not a valid command."""
        found = self._unpack(_COMMAND, packet)
        if found is None or found[1] or found[2] or found[3].size != 5 * self._nu:
            return None
        return found[0], Command(*found[3].reshape(5, -1))

    @staticmethod
    def other_version(packet: bytes) -> int | None:
        """Return the version of a packet of lgmpc that has another one, else None."""
        if len(packet) < 6 or packet[:4] not in (_MEASUREMENT, _COMMAND, HELLO):
            return None
        version: int = struct.unpack_from("<H", packet, 4)[0]
        return None if version == VERSION else version

    def _pack(self, kind: bytes, number: int, values: np.ndarray, nc: int = 0, present: int = 0) -> bytes:
        return _HEAD.pack(kind, VERSION, self._nu, nc, present, 0, number) + values.astype("<f8").tobytes()

    def _unpack(self, kind: bytes, packet: bytes) -> tuple[int, int, int, np.ndarray] | None:
        if len(packet) < _HEAD.size or (len(packet) - _HEAD.size) % 8 or len(packet) > self.longest:
            return None
        first, version, nu, nc, present, _, number = _HEAD.unpack_from(packet)
        if (first, version, nu) != (kind, VERSION, self._nu) or nc > _MOST_FEET:
            return None
        values = np.frombuffer(packet, "<f8", offset=_HEAD.size).astype(np.float64)
        return (number, nc, present, values) if np.isfinite(values).all() else None
