"""Both ends of a link over UDP: the controller's driver, and the robot."""

import errno
import logging
import math
import secrets
import select
import socket
from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np

from lgmpc.control.interface import Command, Measurement
from lgmpc.errors import InputError
from lgmpc.hardware.packets import (
    ANOTHER_ROBOT,
    ANOTHER_SECRET,
    NONCE,
    OCCUPIED,
    VERSION,
    PacketLayout,
    read_secret,
    warn_of_network,
)

_LOG = logging.getLogger(__name__)
LOCALHOST = "127.0.0.1"

_LOST = (errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, errno.ENETDOWN)
"""Errors that UDP reports for a packet, this one or an earlier one, that did not arrive."""
_RESEND_S = 0.02
"""Time without an answer after which a packet is repeated."""
_FREE_S = 1.0
"""Time without a command after which another controller may connect, s."""
_MOST_PACKETS = 500
"""Packets read at once, so that a flood of them does not stop a loop."""


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of ``host:port``.

    Raises:
        InputError: if the text is not an address.
    """
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdecimal() and 0 < int(port) < 65536):
        raise InputError("robot", text, "host:port, as in 127.0.0.1:47800")
    return host, int(port)


class UdpDriver:
    """A :class:`lgmpc.hardware.Driver` of a robot at the other end of a link.

    It sends hello packets until the first measurement arrives, and again while none arrive. Packets of other senders
    are ignored by the operating system; those without the tag of this connection, and measurements older than one
    received before, are ignored here.

    Args:
        address: host and port of the robot.
        nu: number of joints.
        secret: shared with the robot; :func:`lgmpc.hardware.packets.read_secret` unless given.
        robot: for which robot, see :class:`lgmpc.hardware.packets.PacketLayout`.

    Attributes:
        ignored: number of packets that were not a measurement.

    Raises:
        InputError: if the address cannot be used, or (in ``read``) the robot refuses this controller.
    """

    def __init__(self, address: tuple[str, int], nu: int, secret: bytes | None = None, robot: str = "") -> None:
        self._layout = PacketLayout(nu, read_secret() if secret is None else secret, robot)
        self._nu, self._number, self._commands, self.ignored = nu, -1, 0, 0
        self._nonce, self._silent, self._met = secrets.token_bytes(NONCE), True, False
        self._answered, self._command = -1, Command.damping(np.zeros(nu), np.zeros(nu), 0.0)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(address)
        except (OSError, UnicodeError) as error:  # UnicodeError: a name that no host can have
            self._socket.close()
            raise InputError("robot", "{}:{}".format(*address), f"an address that can be reached ({error})") from error
        self._socket.setblocking(False)
        warn_of_network(address[0])

    def read(self, timeout_s: float) -> list[Measurement]:
        """Return the measurements that have arrived; see :meth:`lgmpc.hardware.Driver.read`."""
        if self._silent:
            _send(self._socket.send, self._layout.hello(self._nonce))
        readings = self._arrived()
        end = perf_counter() + timeout_s
        while not readings and (left := end - perf_counter()) > 0.0:
            select.select([self._socket], [], [], left)
            readings = self._arrived()
        if readings:
            self._silent = False
        elif not self._silent:  # a robot that has restarted needs a hello, with a nonce of its own
            self._silent, self._nonce = True, secrets.token_bytes(NONCE)
        return readings

    def write(self, command: Command) -> None:
        """Send the command for the newest measurement; nothing before the first one."""
        if self._number >= 0:
            self._answered, self._command = self._number, command
            _send(self._socket.send, self._layout.command(self._commands, self._number, command))
            self._commands += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _arrived(self) -> list[Measurement]:
        readings = []
        for packet, _ in _packets(self._socket, self._layout.longest):
            found = self._layout.read_measurement(packet)
            if found is None:
                self._connect(packet)
            elif found[0] > self._number:
                self._number = found[0]
                readings.append(found[1])
            elif found[0] == self._number == self._answered:  # the robot repeats it: the answer was lost
                self.write(self._command)
        return readings

    def _connect(self, packet: bytes) -> None:
        """Take the key of a new connection from the robot's welcome; raise where it refuses this controller."""
        robot = self._layout.read_welcome(packet, self._nonce) if self._silent else None
        if robot is not None:
            if self._layout.connect(self._nonce, robot):
                if self._met:
                    _LOG.warning("the robot is connected anew: it has restarted, or received no command for a second")
                self._met, self._number, self._commands, self._answered = True, -1, 0, -1
            return
        self.ignored += 1
        if self._met:
            return
        other, refused = PacketLayout.other_version(packet), self._layout.read_refusal(packet)
        if other is not None:
            raise InputError("robot", f"packets of version {other}", f"packets of version {VERSION}")
        if refused is not None:
            reason, nu = refused
            if reason == OCCUPIED:
                raise InputError("robot", "a robot to which a controller is connected", "a robot without one")
            if reason == ANOTHER_ROBOT:
                got = "another robot" if nu == self._nu else f"a robot with {nu} joints"
                raise InputError("robot", got, f"the config's, with {self._nu} joints")
            raise InputError("secret", "another one than the robot's", "a copy of the robot's file (option --secret)")


class UdpRobot:
    """The robot's end: it sends measurements to the controller that has connected, and receives its commands.

    A controller connects by a hello that has the tag of the secret, and keeps the connection until it has been silent
    for a second; others are refused. Commands have to be newer than the one before, and computed from a measurement
    that was sent.

    Args:
        nu: number of joints.
        host: address to listen at.
        port: port to listen at; 0 takes any free one.
        secret: shared with the controllers; :func:`lgmpc.hardware.packets.read_secret` unless given.
        robot: which robot it is, see :class:`lgmpc.hardware.packets.PacketLayout`.

    Attributes:
        place: host and port, as text.
        forged: number of packets without a valid tag, or with an old number.

    Raises:
        InputError: if the address cannot be used.
    """

    def __init__(
        self, nu: int, host: str = LOCALHOST, port: int = 0, secret: bytes | None = None, robot: str = ""
    ) -> None:
        self._layout = PacketLayout(nu, read_secret() if secret is None else secret, robot)
        self._number = self._last = -1
        self.forged = 0
        self._measurement: Measurement | None = None
        self._peer: Any = None
        self._nonces, self._heard = (b"", b""), -math.inf  # of the connection; when its last command came
        self._refused: set[int] = set()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError, UnicodeError) as error:
            self._socket.close()
            raise InputError("address", f"{host}:{port}", f"a free one of this machine ({error})") from error
        self._socket.setblocking(False)
        self.place = "{}:{}".format(*self.address)
        warn_of_network(host)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the socket."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def wait_for_controller(self, timeout_s: float) -> bool:
        """Wait for the hello of a controller, and return whether one came."""
        end = perf_counter() + timeout_s
        while self._peer is None and (left := end - perf_counter()) > 0.0:
            select.select([self._socket], [], [], min(left, 1.0))
            list(self._commands())
        return self._peer is not None

    def send(self, measurement: Measurement) -> None:
        """Send the next measurement."""
        self._number += 1
        self._measurement = measurement
        self._repeat()

    def receive(self) -> tuple[int, Command] | None:
        """Return the newest command that has arrived, if any, and how many measurements ago its own was sent."""
        newest = None
        for answered, command in self._commands():
            newest = self._number - answered, command
        return newest

    def receive_answer(self, timeout_s: float) -> Command | None:
        """Wait for the command to the last measurement, which is repeated; None if it does not arrive."""
        begun = repeated = perf_counter()
        while (now := perf_counter()) - begun < timeout_s:
            for number, command in self._commands():
                if number == self._number:
                    return command
            if now - repeated >= _RESEND_S:
                repeated = now
                self._repeat()
            select.select([self._socket], [], [], min(_RESEND_S, begun + timeout_s - now))
        return None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _repeat(self) -> None:
        if self._peer is not None and self._measurement is not None:
            self._post(self._layout.measurement(self._number, self._measurement), self._peer)

    def _post(self, packet: bytes, to: Any) -> None:
        _send(lambda data: self._socket.sendto(data, to), packet)

    def _commands(self) -> Iterator[tuple[int, Command]]:
        for packet, sender in _packets(self._socket, self._layout.longest):
            hello = self._layout.read_hello(packet)
            if hello is not None:
                self._greet(hello, sender)
                continue
            found = self._layout.read_command(packet) if sender == self._peer else None
            if found is not None and found[0] > self._last and found[1] <= self._number:
                self._last, self._heard = found[0], perf_counter()
                yield found[1:]
                continue
            self.forged += 1
            other = PacketLayout.other_version(packet)
            if other is not None and other not in self._refused:
                self._refused.add(other)
                _LOG.warning("a controller is refused: its packets are of version %d, not %d", other, VERSION)

    def _greet(self, hello: bytes | int, sender: Any) -> None:
        """Connect with the sender of a hello, or refuse it; the log names each reason and host once."""
        if isinstance(hello, bytes) and (hello, sender) == (self._nonces[0], self._peer):
            self._post(self._layout.welcome(*self._nonces), sender)  # the first one was lost
            self._repeat()
        elif isinstance(hello, bytes) and perf_counter() - self._heard >= _FREE_S:
            self._nonces, self._peer = (hello, secrets.token_bytes(NONCE)), sender
            self._layout.connect(*self._nonces)
            self._last = -1
            self._post(self._layout.welcome(*self._nonces), sender)
            self._repeat()
        else:
            reason = hello if isinstance(hello, int) else OCCUPIED
            self._post(self._layout.refusal(reason), sender)
            if -reason not in self._refused and sender != self._peer:
                self._refused.add(-reason)
                why = {OCCUPIED: "another one is connected", ANOTHER_SECRET: "it has another secret"}
                _LOG.warning("a controller is refused: %s", why.get(reason, "it is for another robot"))


def _packets(link: socket.socket, longest: int) -> Iterator[tuple[bytes, Any]]:
    """Yield the packets that have arrived and their senders, without waiting."""
    for _ in range(_MOST_PACKETS):
        try:
            yield link.recvfrom(longest + 1)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in _LOST:
                raise


def _send(send: Any, packet: bytes) -> None:
    try:
        send(packet)
    except BlockingIOError:
        pass  # counts as a lost packet
    except OSError as error:
        if error.errno not in _LOST:
            raise
