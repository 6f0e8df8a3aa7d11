"""Packets between a robot and its controller: fixed size, little-endian, 64-bit floats.

=========== ========================================================================================================
bytes       content
=========== ========================================================================================================
0-3         ``LGMm`` (measurement), ``LGMc`` (command) or ``LGMh`` (hello, sent by a controller to connect)
4-5         version of this layout, 2
6-7         nu, number of joints
8-15        number of the measurement; in a command, of the measurement from which it was computed
16-         measurement: time, gyro (3), accelerometer (3), joints (nu), speeds (nu), torques (nu)
16-         command: tau (nu), q_des (nu), v_des (nu), kp (nu), kd (nu)
=========== ========================================================================================================

Units are those of :class:`lgmpc.control.Measurement` and :class:`lgmpc.control.Command`.
"""

from __future__ import annotations

import struct

import numpy as np

from lgmpc.control.interface import Command, Measurement

__all__ = ["HELLO", "Layout"]

_HEAD = struct.Struct("<4sHHQ")
_VERSION = 2
_MEASUREMENT, _COMMAND = b"LGMm", b"LGMc"
HELLO = b"LGMh"
"""First bytes of the packet by which a controller connects."""


class Layout:
    """Packets of a robot with ``nu`` joints.

    Packets of another layout, of another number of joints, or with numbers that are not finite are rejected.

    Args:
        nu: number of joints.
    """

    def __init__(self, nu: int) -> None:
        self._nu = nu
        self.longest = _HEAD.size + 8 * (7 + 5 * nu)

    def hello(self) -> bytes:
        """Return the packet by which a controller connects."""
        return _HEAD.pack(HELLO, _VERSION, self._nu, 0)

    def is_hello(self, packet: bytes) -> bool:
        """Return whether a packet is the hello of a controller of this robot."""
        return packet == self.hello()

    def measurement(self, number: int, m: Measurement) -> bytes:
        """Return the packet of measurement ``number``."""
        values = np.concatenate(([m.time], m.gyro, m.accelerometer, m.joints, m.speeds, m.torques))
        return self._pack(_MEASUREMENT, number, values)

    def read_measurement(self, packet: bytes) -> tuple[int, Measurement] | None:
        """Return the number and the measurement of a packet; None if it is not a valid measurement."""
        found = self._unpack(_MEASUREMENT, packet, 7 + 3 * self._nu)
        if found is None:
            return None
        number, values = found
        joints, speeds, torques = values[7:].reshape(3, -1)
        return number, Measurement(float(values[0]), values[1:4], values[4:7], joints, speeds, torques)

    def command(self, number: int, c: Command) -> bytes:
        """Return the packet of the command for measurement ``number``."""
        return self._pack(_COMMAND, number, np.concatenate(c))

    def read_command(self, packet: bytes) -> tuple[int, Command] | None:
        """Return the number of the measurement and the command for it; None if it is not a valid command."""
        found = self._unpack(_COMMAND, packet, 5 * self._nu)
        if found is None:
            return None
        number, values = found
        return number, Command(*values.reshape(5, -1))

    def _pack(self, kind: bytes, number: int, values: np.ndarray) -> bytes:
        return _HEAD.pack(kind, _VERSION, self._nu, number) + values.astype("<f8").tobytes()

    def _unpack(self, kind: bytes, packet: bytes, count: int) -> tuple[int, np.ndarray] | None:
        if len(packet) != _HEAD.size + 8 * count:
            return None
        first, version, nu, number = _HEAD.unpack_from(packet)
        if (first, version, nu) != (kind, _VERSION, self._nu):
            return None
        values = np.frombuffer(packet, "<f8", offset=_HEAD.size).astype(np.float64)
        return (number, values) if np.isfinite(values).all() else None
