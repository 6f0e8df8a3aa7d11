"""Packets between a robot and its controller: little-endian, 64-bit floats, authenticated; their shared secret.

=========== ========================================================================================================
bytes       content
=========== ========================================================================================================
0-3         ``LGMh`` (hello, sent by a controller to connect), ``LGMw`` (welcome, the robot's answer), ``LGMm``
            (measurement), ``LGMc`` (command) or ``LGMr`` (refusal of a hello)
4-5         version of this layout, 3
6-7         nu, number of joints
8-9         nc, number of feet with a measured force; 0 in other packets
10-11       bits of the optional quantities in a measurement; in a refusal its reason (1: another controller is
            connected, 2: another secret, 3: another robot); 0 in other packets
12-15       hello: which robot the controller is for, the first 4 bytes of SHA-256 over its name and those of its
            joints, with blanks between; 0: unknown. 0 in other packets
16-23       number of the measurement, or of the command; each sender counts its own. 0 in other packets
24-         hello: the controller's nonce (16). welcome: that nonce (16), the robot's nonce (16)
24-         measurement: time, gyro (3), accelerometer (3), joints (nu), speeds (nu), torques (nu), then those optional
            quantities whose bit is set: attitude (4; bit 0), foot forces (nc; 1), external pose (7; 2), external
            velocity (6; 3), external age (1; 4), supply voltage (1; 5), motor temperature (nu; 6), error flags (nu; 7)
24-         command: number of the measurement from which it was computed, tau (nu), q_des (nu), v_des (nu), kp (nu),
            kd (nu)
last 16     tag: the first 16 bytes of HMAC-SHA256 over all bytes before, keyed by the secret that both ends share in
            hello, welcome and refusal, and by the connection's key in measurements and commands. That key is
            HMAC-SHA256(secret, controller's nonce + robot's nonce)
=========== ========================================================================================================

Units are those of :class:`lgmpc.control.Measurement` and :class:`lgmpc.control.Command`.
"""

import hmac
import ipaddress
import logging
import os
import secrets
import stat
import struct
from collections.abc import Iterator
from hashlib import sha256
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.control.interface import Command, Measurement
from lgmpc.errors import InputError
from lgmpc.typing import IntArray

_LOG = logging.getLogger(__name__)
_LEAST = 16  # B, of a secret

_HEAD = struct.Struct("<4sHHHHIQ")
VERSION = 3
"""Version of the packets."""
_MEASUREMENT, _COMMAND, _WELCOME, _REFUSAL = b"LGMm", b"LGMc", b"LGMw", b"LGMr"
HELLO = b"LGMh"
"""First bytes of the packet by which a controller connects."""
NONCE = 16
"""Length of a nonce, B."""
OCCUPIED, ANOTHER_SECRET, ANOTHER_ROBOT = 1, 2, 3
"""Reasons of a refusal."""
_TAG, _MOST_FEET = 16, 64


class PacketLayout:
    """Packets of a robot with ``nu`` joints.

    Packets of another layout, of another number of joints, with numbers that are not finite, or with a tag of another
    key are rejected.

    Args:
        nu: number of joints.
        secret: shared by both ends.
        robot: names of the robot and of its joints, with blanks between; without, controllers of any robot connect.

    Attributes:
        longest: length of the longest packet, B.
        key: of the connection, for measurements and commands; None before there is one.
    """

    def __init__(self, nu: int, secret: bytes, robot: str = "") -> None:
        self._nu, self._secret = nu, secret
        self._robot = int.from_bytes(sha256(robot.encode()).digest()[:4], "little") if robot else 0
        self.longest = _HEAD.size + 8 * (26 + 5 * nu + _MOST_FEET) + _TAG
        self.key: bytes | None = None

    def connect(self, controller: bytes, robot: bytes) -> bool:
        """Use the key that follows from the nonces of both ends, and return whether it is another one."""
        before, self.key = self.key, hmac.digest(self._secret, controller + robot, "sha256")
        return self.key != before

    def hello(self, nonce: bytes) -> bytes:
        """Return the packet by which a controller connects."""
        return self._pack(HELLO, self._secret, nonce, robot=self._robot)

    def read_hello(self, packet: bytes) -> bytes | int | None:
        """Return a controller's nonce, or the reason for which it is refused; None if the packet is no hello."""
        if len(packet) != _HEAD.size + NONCE + _TAG or packet[:6] != HELLO + struct.pack("<H", VERSION):
            return None
        if not self._authentic(packet, self._secret):
            return ANOTHER_SECRET
        _, _, nu, _, _, robot, _ = _HEAD.unpack_from(packet)
        same = nu == self._nu and (robot == self._robot or not robot or not self._robot)
        return packet[_HEAD.size : -_TAG] if same else ANOTHER_ROBOT

    def welcome(self, controller: bytes, robot: bytes) -> bytes:
        """Return the answer to a hello, from the nonces of both ends."""
        return self._pack(_WELCOME, self._secret, controller + robot)

    def read_welcome(self, packet: bytes, controller: bytes) -> bytes | None:
        """Return the robot's nonce in the answer to the hello with the nonce ``controller``; None if it is none."""
        if len(packet) != _HEAD.size + 2 * NONCE + _TAG or packet[: _HEAD.size] != self._head(_WELCOME):
            return None
        first, second = packet[_HEAD.size : _HEAD.size + NONCE], packet[_HEAD.size + NONCE : -_TAG]
        return second if first == controller and self._authentic(packet, self._secret) else None

    def refusal(self, reason: int) -> bytes:
        """Return the packet that refuses a hello."""
        return self._pack(_REFUSAL, self._secret, b"", present=reason)

    def read_refusal(self, packet: bytes) -> tuple[int, int] | None:
        """Return the reason of a refusal and the robot's number of joints; None if the packet is none."""
        if len(packet) != _HEAD.size + _TAG or packet[:6] != _REFUSAL + struct.pack("<H", VERSION):
            return None
        _, _, nu, _, reason, _, _ = _HEAD.unpack_from(packet)
        return (reason, nu) if reason == ANOTHER_SECRET or self._authentic(packet, self._secret) else None

    def measurement(self, number: int, m: Measurement) -> bytes:
        """Return the packet of measurement ``number``."""
        given = [None if value is None else np.atleast_1d(value) for value in m[6:]]
        present = sum(1 << bit for bit, value in enumerate(given) if value is not None)
        values = np.concatenate([np.atleast_1d(m.time), *m[1:6], *(value for value in given if value is not None)])
        feet = 0 if m.foot_forces is None else m.foot_forces.size
        return self._pack(_MEASUREMENT, self.key, values.astype("<f8").tobytes(), number, feet, present)

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
        parts: Iterator[Any] = (values[end - size : end] for size, end in zip(sizes, accumulate(sizes), strict=True))
        time, *own = (next(parts) for _ in range(6))
        given: list[Any] = [next(parts) if present & 1 << bit else None for bit in range(len(optional))]
        given[4:6] = [None if value is None else float(value[0]) for value in given[4:6]]
        if given[7] is not None:
            flags: IntArray = given[7].astype(np.int64)
            given[7] = flags
        return number, Measurement(float(time[0]), *own, *given)

    def command(self, number: int, answered: int, c: Command) -> bytes:
        """Return the packet of command ``number``, computed from the measurement of number ``answered``."""
        return self._pack(_COMMAND, self.key, np.concatenate([[answered], *c]).astype("<f8").tobytes(), number)

    def read_command(self, packet: bytes) -> tuple[int, int, Command] | None:
        """Return the command's number, that of its measurement, and the command; None if it is not a valid one."""
        found = self._unpack(_COMMAND, packet)
        if found is None or found[1] or found[2] or found[3].size != 1 + 5 * self._nu:
            return None
        answered = found[3][0]
        if not (answered.is_integer() and 0.0 <= answered < 2.0**53):
            return None
        return found[0], int(answered), Command(*found[3][1:].reshape(5, -1))

    @staticmethod
    def other_version(packet: bytes) -> int | None:
        """Return the version of a packet of lgmpc that has another one, else None."""
        if len(packet) < 6 or packet[:4] not in (_MEASUREMENT, _COMMAND, HELLO):
            return None
        version: int = struct.unpack_from("<H", packet, 4)[0]
        return None if version == VERSION else version

    def _head(self, kind: bytes, number: int = 0, nc: int = 0, present: int = 0, robot: int = 0) -> bytes:
        return _HEAD.pack(kind, VERSION, self._nu, nc, present, robot, number)

    def _pack(self, kind: bytes, key: bytes | None, content: bytes, *numbers: int, **named: int) -> bytes:
        assert key is not None, "no connection"
        packet = self._head(kind, *numbers, **named) + content
        return packet + hmac.digest(key, packet, "sha256")[:_TAG]

    @staticmethod
    def _authentic(packet: bytes, key: bytes) -> bool:
        return hmac.compare_digest(hmac.digest(key, packet[:-_TAG], "sha256")[:_TAG], packet[-_TAG:])

    def _unpack(self, kind: bytes, packet: bytes) -> tuple[int, int, int, np.ndarray] | None:
        size = len(packet) - _HEAD.size - _TAG
        if self.key is None or size < 0 or size % 8 or len(packet) > self.longest:
            return None
        first, version, nu, nc, present, _, number = _HEAD.unpack_from(packet)
        if (first, version, nu) != (kind, VERSION, self._nu) or nc > _MOST_FEET:
            return None
        if not self._authentic(packet, self.key):
            return None
        values = np.frombuffer(packet, "<f8", size // 8, _HEAD.size).astype(np.float64)
        return (number, nc, present, values) if np.isfinite(values).all() else None


def read_secret(path: str | Path | None = None) -> bytes:
    """Return the content of a secret's file, without white space at its ends.

    Args:
        path: file that no other user can read (mode 0600), of at least 16 bytes. Unless given, the user's own
            ``link.secret`` beside other programs' settings, which is made at its first use; programs of one user on one
            machine need no other.

    Raises:
        InputError: if the file cannot be read or made, is short, or can be read by others.
    """
    own = path is None
    file = _own_file() if path is None else Path(path)
    try:
        if own and not file.exists():
            _make(file)
        descriptor = os.open(file, os.O_RDONLY)
        with open(descriptor, "rb") as opened:
            mode, content = os.fstat(descriptor).st_mode, opened.read(4096).strip()
    except OSError as error:
        raise InputError("secret", str(file), f"a file that can be read ({error.strerror or error})") from error
    if not stat.S_ISREG(mode) or mode & 0o077:
        raise InputError("secret", f"{file}, of mode {mode & 0o777:o}", f"a file of mode 600 (chmod 600 {file})")
    if len(content) < _LEAST:
        raise InputError("secret", f"{file}, {len(content)} bytes", f"at least {_LEAST} bytes: openssl rand -hex 32")
    return content


def warn_of_network(host: str) -> None:
    """Log a warning if an address is not that of this machine alone."""
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if not local:
        _LOG.warning(
            "the link uses a network (%s): its packets can be read and held up by others there, but not forged without"
            " the secret; use a network of the robot's own",
            host,
        )


def _own_file() -> Path:
    from platformdirs import user_config_path

    return user_config_path("lgmpc") / "link.secret"


def _make(file: Path) -> None:
    """Make the file with a random content, unless another process does so at the same time."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.{os.getpid()}")
    with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
        opened.write(secrets.token_hex(32) + "\n")
    try:
        os.link(draft, file)
    except FileExistsError:
        pass
    finally:
        draft.unlink()
