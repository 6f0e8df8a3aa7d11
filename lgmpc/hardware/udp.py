"""Both ends of a link over UDP: the controller's driver, and the robot."""

from __future__ import annotations

import errno
import logging
import select
import socket
from collections.abc import Iterator
from time import perf_counter

from lgmpc.control.interface import Command, Measurement
from lgmpc.errors import InputError
from lgmpc.hardware.packets import VERSION, Layout

__all__ = ["LOCALHOST", "UdpDriver", "UdpRobot", "parse_address"]

_LOG = logging.getLogger(__name__)
LOCALHOST = "127.0.0.1"

_LOST = (errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, errno.ENETDOWN)
"""Errors that UDP reports for a packet, this one or an earlier one, that did not arrive."""


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

    It sends hello packets until the first measurement arrives. Packets of other senders are ignored by the operating
    system; packets that are not a measurement of this robot, and measurements older than one received before, are
    ignored here.

    Args:
        address: host and port of the robot.
        nu: number of joints.

    Attributes:
        ignored: number of packets that were not a measurement.

    Raises:
        InputError: if the address cannot be used, or the first packets are of another version.
    """

    def __init__(self, address: tuple[str, int], nu: int) -> None:
        self._layout, self._number, self.ignored = Layout(nu), -1, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(address)
        except (OSError, UnicodeError) as error:  # UnicodeError: a name that no host can have
            self._socket.close()
            raise InputError("robot", "{}:{}".format(*address), f"an address that can be reached ({error})") from error
        self._socket.setblocking(False)

    def read(self, timeout_s: float) -> list[Measurement]:
        """Return the measurements that have arrived; see :meth:`lgmpc.hardware.Driver.read`."""
        if self._number < 0:
            _send(self._socket, self._layout.hello())
        readings = self._arrived()
        end = perf_counter() + timeout_s
        while not readings and (left := end - perf_counter()) > 0.0:
            select.select([self._socket], [], [], left)
            readings = self._arrived()
        return readings

    def write(self, command: Command) -> None:
        """Send the command for the newest measurement."""
        _send(self._socket, self._layout.command(max(self._number, 0), command))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _arrived(self) -> list[Measurement]:
        readings = []
        for packet in _packets(self._socket, self._layout.longest):
            found = self._layout.read_measurement(packet)
            if found is None:
                self.ignored += 1
                other = Layout.other_version(packet)
                if other is not None and self._number < 0:
                    raise InputError("robot", f"packets of version {other}", f"packets of version {VERSION}")
            elif found[0] > self._number:
                self._number = found[0]
                readings.append(found[1])
        return readings


class UdpRobot:
    """The robot's end: it sends measurements to the controller that has connected, and receives its commands.

    Args:
        nu: number of joints.
        host: address to listen at.
        port: port to listen at; 0 takes any free one.

    Raises:
        InputError: if the port cannot be used.
    """

    def __init__(self, nu: int, host: str = LOCALHOST, port: int = 0) -> None:
        self._layout, self._number = Layout(nu), -1
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError, UnicodeError) as error:
            self._socket.close()
            raise InputError("port", port, f"a free port of {host} ({error})") from error
        self._socket.setblocking(False)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the socket."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def wait_for_controller(self, timeout_s: float) -> bool:
        """Wait for the hello of a controller, return whether one came, and ignore all others from then on."""
        end, refused = perf_counter() + timeout_s, False
        while (left := end - perf_counter()) > 0.0:
            select.select([self._socket], [], [], min(left, 1.0))
            try:
                packet, sender = self._socket.recvfrom(self._layout.longest + 1)
            except (BlockingIOError, ConnectionError):
                continue
            if self._layout.is_hello(packet):
                self._socket.connect(sender)
                return True
            other = Layout.other_version(packet)
            if other is not None and not refused:
                refused = True
                _LOG.warning("a controller is refused: its packets are of version %d, not %d", other, VERSION)
        return False

    def send(self, measurement: Measurement) -> None:
        """Send the next measurement."""
        self._number += 1
        _send(self._socket, self._layout.measurement(self._number, measurement))

    def receive(self) -> Command | None:
        """Return the newest command that has arrived, if any."""
        commands = list(self._commands())
        return max(commands, key=lambda found: found[0])[1] if commands else None

    def receive_answer(self, timeout_s: float) -> Command | None:
        """Wait for the command to the last measurement; None if it does not arrive."""
        end = perf_counter() + timeout_s
        while (left := end - perf_counter()) > 0.0:
            for number, command in self._commands():
                if number == self._number:
                    return command
            select.select([self._socket], [], [], left)
        return None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _commands(self) -> Iterator[tuple[int, Command]]:
        for packet in _packets(self._socket, self._layout.longest):
            found = self._layout.read_command(packet)
            if found is not None:
                yield found


def _packets(link: socket.socket, longest: int) -> Iterator[bytes]:
    """Yield the packets that have arrived, without waiting."""
    while True:
        try:
            yield link.recv(longest + 1)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in _LOST:
                raise


def _send(link: socket.socket, packet: bytes) -> None:
    try:
        link.send(packet)
    except BlockingIOError:
        pass  # counts as a lost packet
    except OSError as error:
        if error.errno not in _LOST:
            raise
