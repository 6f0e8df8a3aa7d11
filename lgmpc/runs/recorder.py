"""The recorder of a closed loop, without allocation at every tick."""

import math
import mmap
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.runs.channels import Channel, channels_of
from lgmpc.runs.ground import friction_channel, ground_channels
from lgmpc.runs.log import CHANNELS, GROUND_CHANNELS, MPC_CHANNELS, OPTIONAL, RunLog, feet_of
from lgmpc.settings import Positive, Settings, key
from lgmpc.typing import Array
from lgmpc.world import World


class LogSettings(Settings):
    """Settings of the saved log."""

    rate_hz: Positive = key(
        500.0,
        "Saved ticks per second, Hz; divides wbc.rate_hz. Every tick is judged: of simulations they are until then in a"
        " file without a name in the run folder, at 1 kHz 85 MB a simulated minute of Solo12, 195 of Talos on sensors.",
    )


class Recorder:
    """Buffers for every channel of a run's log.

    A tick is one row of numbers, written by one call. The rows double when a run is longer than expected; :meth:`log`
    may be called at any time, also after an interruption.

    Args:
        nq: size of the configuration.
        nv: size of the velocity.
        effort_limit: (nu,) torque limits that the plant clips at, N.m.
        contact_frames: names of the contact frames.
        friction: friction coefficient of the plant's floor.
        contact_radius: radius of the spherical feet, m.
        control_period_s: time between two control ticks, s.
        ticks: expected number of control ticks.
        mpc_nodes: N, the horizon's number of intervals (0 = no MPC).
        mpc_updates: expected number of MPC updates.
        joint_names: (nu,) names of the actuated joints; numbered unless given.
        optional: names of the optional tables that are recorded: estimate, fault, friction, forecast, hand.
        hands: number of hands.
        mass: of the simulated robot, kg; NaN if unknown.
        world: the world relative to whose ground the run is judged; a level floor unless given.
        entries: further single values of :class:`~lgmpc.runs.log.RunLog`: mpc_period_s, floating_base, upright_axis.

    Attributes:
        world: as given.

    Raises:
        InputError: if a size, a period or the friction is not valid.
    """

    def __init__(
        self,
        *,
        nq: int,
        nv: int,
        effort_limit: ArrayLike,
        contact_frames: Sequence[str],
        friction: float,
        contact_radius: float,
        control_period_s: float,
        ticks: int,
        mpc_nodes: int = 0,
        mpc_updates: int = 0,
        joint_names: Sequence[str] | None = None,
        optional: Collection[str] = (),
        mass: float = math.nan,
        world: World | None = None,
        hands: int = 0,
        **entries: Any,
    ) -> None:
        self.world = World() if world is None else world
        self._worlds = [(0, self.world)]
        for name, value in (("ticks", ticks), ("mpc_nodes", mpc_nodes), ("mpc_updates", mpc_updates)):
            if value < 0:
                raise InputError(name, value, "a number that is not negative")
        if not control_period_s > 0.0:
            raise InputError("control_period_s", control_period_s, "a positive time in seconds")
        effort = np.array(effort_limit, dtype=np.float64)
        joints = [f"joint {k + 1}" for k in range(len(effort))] if joint_names is None else list(joint_names)
        if len(joints) != len(effort):
            raise InputError("joint_names", f"{len(joints)} names", f"one for each of {len(effort)} torques")
        self._limits = [(0, float(friction), effort)]  # first tick, friction of the floor, torque limits
        self._entries: dict[str, Any] = {
            "mpc_period_s": 0.0,
            "floating_base": True,
            "upright_axis": np.array([0.0, 0.0, 1.0]),
        } | entries
        self._entries |= {
            "joint_names": np.array(joints, dtype=np.str_),
            "contact_frames": np.array(list(contact_frames), dtype=np.str_),
            "contact_radius": float(contact_radius),
            "control_period_s": float(control_period_s),
            "mass_kg": float(mass),
        }
        sizes = {"nq": nq, "nv": nv, "nu": len(effort), "nc": len(contact_frames), "nodes": mpc_nodes + 1, "nh": hands}
        sizes["nf"] = len(feet_of(contact_frames))
        channels = dict(CHANNELS)
        for table in OPTIONAL:
            channels |= channels_of(RunLog, table) if table in optional else {}
        self._ticks = _Rows(channels, sizes, ticks)
        self._updates = _Rows(MPC_CHANNELS, sizes, mpc_updates)

    @property
    def channels(self) -> frozenset[str]:
        """Names of the channels of a control tick."""
        return frozenset(self._ticks.shapes)

    @property
    def ticks(self) -> int:
        """Number of control ticks recorded so far."""
        return self._ticks.count

    def append(self, channels: Mapping[str, ArrayLike]) -> None:
        """Copy one control tick.

        Args:
            channels: a value for each of :data:`~lgmpc.runs.log.CHANNELS`, and for each of the optional channels that
                are recorded, fastest in their order; shapes and units as in :class:`~lgmpc.runs.log.RunLog`, without
                the first axis. The contact points may be those for other normals than the ground's, given with them.

        Raises:
            InputError: a channel is missing or unknown.
            ValueError: a value does not have the channel's shape.
        """
        self._ticks.append(channels)

    def record_mpc(self, time: float, horizon_com: Array, forces: Array, status: int, ms: float) -> None:
        """Copy one MPC update.

        Args:
            time: of the update, s.
            horizon_com: (N+1, 3) predicted centre of mass, m.
            forces: (nc, 3) contact forces of the first node, N.
            status: 0 = solved.
            ms: its duration, ms.
        """
        self._updates.append(dict(zip(MPC_CHANNELS, (time, horizon_com, forces, status, ms), strict=True)))

    @property
    def rows(self) -> tuple[Array, Array]:
        """The last control tick and the last MPC update as vectors of all their channels; live views."""
        return self._ticks.row, self._updates.row

    def load(self, ticks: Array, updates: Array) -> None:
        """Replace all records by rows (n, ...) of another recorder with the same channels: see :attr:`rows`."""
        self._ticks.load(ticks)
        self._updates.load(updates)

    def set_limits(self, *, friction: float, effort_limit: ArrayLike, mass: float, world: World | None = None) -> None:
        """Change floor, torque limits and mass from the next tick on; units as in the constructor."""
        self._limits.append((self.ticks, friction, np.array(effort_limit, dtype=np.float64)))
        self._worlds.append((self.ticks, self.world if world is None else world))
        self._entries["mass_kg"] = mass

    def spill(self, folder: Path, log_bytes: int) -> None:
        """Keep what is recorded from now on in a file without a name; in memory, if the disk has too little space.

        Args:
            folder: of the file, which exists as long as the arrays of the log.
            log_bytes: space that is left for other files, B.
        """
        for rows in (self._ticks, self._updates):
            with suppress(OSError):
                rows.spill(folder, log_bytes)

    def log_bytes(self, every: int = 1) -> int:
        """Return the expected size of the log's arrays with one of ``every`` ticks, B."""
        ground = sum(math.prod(self._ticks.shape_of(channel)) for channel in GROUND_CHANNELS.values()) * 8
        return -(-(self._ticks.log_bytes + ground * self._ticks.capacity) // every) + self._updates.log_bytes

    def log(self) -> RunLog:
        """Return all that has been recorded, relative to the ground of the world; channels are views of the buffers."""
        ticks = self._ticks.columns()
        base = ticks["q"][:, :3] if self._entries["floating_base"] else np.zeros((self.ticks, 3))
        points, normals = ticks["contact_points"], ticks["contact_normals"]
        radius, forces = self._entries["contact_radius"], ticks["contact_forces"]
        ticks |= ground_channels(self.world, radius, base, points, normals, forces)
        friction = friction_channel(self._worlds, ticks["contact_points"])
        ticks |= {} if friction is None else {"contact_friction": friction}
        _, mu, effort = self._limits[-1]
        if any(each != mu or not np.array_equal(limit, effort) for _, each, limit in self._limits):
            ticks |= {"floor_friction": np.empty(self.ticks), "torque_limits": np.empty((self.ticks, len(effort)))}
            for first, each, limit in self._limits:
                ticks["floor_friction"][first:], ticks["torque_limits"][first:] = each, limit
        entries: dict[str, Any] = deepcopy(self._entries | {"friction": mu, "effort_limit": effort})
        return RunLog(**ticks, **self._updates.columns(), **entries)


class _Rows:
    """A growing table of numbers: a row for each record, and in it the channels one after the other.

    Attributes:
        count: rows that are complete.
        shapes: of one value of each channel.
        row: the last one, in memory of its own.
    """

    def __init__(self, channels: Mapping[str, Channel], sizes: Mapping[str, int], capacity: int) -> None:
        self.count, self._sizes = 0, sizes
        self.shapes = {name: self.shape_of(channel) for name, channel in channels.items()}
        self._channels = channels
        self._names = tuple(channels)
        ends = accumulate(math.prod(shape) for shape in self.shapes.values())
        self._places = {
            name: slice(end - math.prod(self.shapes[name]), end) for name, end in zip(self._names, ends, strict=True)
        }
        width = self._places[self._names[-1]].stop
        self.row = np.zeros(width)
        self._values = [self.row[self._places[name]].reshape(shape) for name, shape in self.shapes.items()]
        self._table = np.zeros((max(capacity, 1), width))

    @property
    def capacity(self) -> int:
        """Number of rows that there is memory for."""
        return len(self._table)

    def shape_of(self, channel: Channel) -> tuple[int, ...]:
        """Return the shape of one value of a channel."""
        return tuple(axis if isinstance(axis, int) else self._sizes[axis] for axis in channel.axes)

    def append(self, values: Mapping[str, ArrayLike]) -> None:
        """Append a row.

        Raises:
            InputError: a channel is missing or unknown.
            ValueError: a value does not have the channel's shape.
        """
        if tuple(values) != self._names:
            values = self._in_order(values)
        i = self.count
        if i == len(self._table):
            self._table = np.concatenate([self._table, np.zeros_like(self._table)])
        for place, value in zip(self._values, values.values(), strict=True):
            place[...] = value
        self._table[i] = self.row  # one copy into memory that is in no cache yet
        # Counted last: an interrupted row is not part of the log.
        self.count = i + 1

    def spill(self, folder: Path, spare: int) -> None:
        """Move the table to a file that has no name; see :meth:`Recorder.spill`.

        Raises:
            OSError: the disk has less space than the table and ``spare`` (B) take.
        """
        with TemporaryFile(dir=folder) as file:
            # Space that is not reserved would be missed where the memory is written: a signal, and no log.
            os.posix_fallocate(file.fileno(), 0, self._table.nbytes + spare)
            file.truncate(self._table.nbytes)
            mapped = np.frombuffer(mmap.mmap(file.fileno(), self._table.nbytes)).reshape(self._table.shape)
        mapped[: self.count] = self._table[: self.count]
        self._table = mapped

    def load(self, rows: Array) -> None:
        """Replace all rows."""
        self._table, self.count = rows, len(rows)

    def columns(self) -> dict[str, Any]:
        """Return each channel, with its own axes and type: a view of the table, whose rows are not written again."""
        rows = self._table[: self.count]
        return {
            name: rows[:, self._places[name]].reshape(self.count, *shape).astype(self._channels[name].dtype, copy=False)
            for name, shape in self.shapes.items()
        }

    @property
    def log_bytes(self) -> int:
        """Size of the channels' arrays if the table is filled as far as it was expected to be, B."""
        sizes = (
            math.prod(self.shapes[name]) * np.dtype(channel.dtype).itemsize for name, channel in self._channels.items()
        )
        return self.capacity * sum(sizes)

    def _in_order(self, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """Return the values in the order of the channels."""
        odd = sorted(values.keys() ^ self.shapes.keys())
        if odd:
            raise InputError("channels", ", ".join(odd), "every channel of a tick, and no other")
        return {name: values[name] for name in self._names}
