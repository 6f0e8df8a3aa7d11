"""The recorder of a closed loop, without allocation at every tick."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.runs.log import CHANNELS, ESTIMATE_CHANNELS, FRICTION_CHANNELS, MPC_CHANNELS, STEP_CHANNELS, Channel, RunLog
from lgmpc.settings import Positive, Settings
from lgmpc.typing import Array

__all__ = ["LogSettings", "Recorder"]


class LogSettings(Settings):
    """Settings of the saved log."""

    rate_hz: Positive = Field(default=500.0, description="Recorded ticks per second, Hz; divides wbc.rate_hz.")


class Recorder:
    """Buffers for every channel of a run's log.

    :meth:`record` costs one row assignment per channel. The buffers double when a run is longer than expected;
    :meth:`log` may be called at any time, also after an interruption.

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
        mpc_period_s: time between two MPC updates, s (0 = no MPC).
        mpc_updates: expected number of MPC updates.
        floating_base: whether ``q`` begins with a base pose.
        joint_names: (nu,) names of the actuated joints; numbered unless given.
        estimated: whether the controller receives an estimate, recorded by :meth:`record_estimate`.
        stepping: whether commands and steps are recorded, by :meth:`record_steps`.
        friction_estimated: whether estimated joint friction is recorded, by :meth:`record_friction`.
        mass: of the simulated robot, kg; NaN if unknown.

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
        mpc_period_s: float = 0.0,
        mpc_updates: int = 0,
        floating_base: bool = True,
        joint_names: Sequence[str] | None = None,
        estimated: bool = False,
        stepping: bool = False,
        friction_estimated: bool = False,
        mass: float = math.nan,
    ) -> None:
        for name, value in (("ticks", ticks), ("mpc_nodes", mpc_nodes), ("mpc_updates", mpc_updates)):
            if value < 0:
                raise InputError(name, value, "a number that is not negative")
        if not control_period_s > 0.0:
            raise InputError("control_period_s", control_period_s, "a positive time in seconds")
        self._effort_limit = np.array(effort_limit, dtype=np.float64)
        joints = [f"joint {k + 1}" for k in range(len(self._effort_limit))] if joint_names is None else joint_names
        if len(joints) != len(self._effort_limit):
            raise InputError(
                "joint_names", f"{len(joints)} names", f"one for each of {len(self._effort_limit)} torques"
            )
        self._joint_names = np.array(list(joints), dtype=np.str_)
        self._contact_frames = np.array(list(contact_frames), dtype=np.str_)
        self._friction = float(friction)
        self._contact_radius = float(contact_radius)
        self._control_period_s = float(control_period_s)
        self._mpc_period_s = float(mpc_period_s)
        self._floating_base = floating_base
        self._mass = float(mass)
        sizes = {
            "nq": nq,
            "nv": nv,
            "nu": len(self._effort_limit),
            "nc": len(self._contact_frames),
            "nodes": mpc_nodes + 1,
        }
        self._rows = _Rows(CHANNELS, sizes, ticks)
        self._mpc_rows = _Rows(MPC_CHANNELS, sizes, mpc_updates)
        self._estimate_rows = _Rows(ESTIMATE_CHANNELS, sizes, ticks) if estimated else None
        self._step_rows = _Rows(STEP_CHANNELS, sizes, ticks) if stepping else None
        self._friction_rows = _Rows(FRICTION_CHANNELS, sizes, ticks) if friction_estimated else None

    @property
    def ticks(self) -> int:
        """Number of control ticks recorded so far."""
        return self._rows.count

    @property
    def mpc_updates(self) -> int:
        """Number of MPC updates recorded so far."""
        return self._mpc_rows.count

    def record(self, **channels: ArrayLike) -> None:
        """Copy one control tick.

        Args:
            channels: a value for each of :data:`~lgmpc.runs.log.CHANNELS`; shapes and units as in
                :class:`~lgmpc.runs.log.RunLog`, without the first axis.

        Raises:
            InputError: a channel is missing or unknown.
        """
        self._rows.append_all(channels)

    def record_mpc(self, time: float, horizon_com: Array, forces: Array, status: int, ms: float) -> None:
        """Copy one MPC update.

        Args:
            time: of the update, s.
            horizon_com: (N+1, 3) predicted centre of mass, m.
            forces: (nc, 3) contact forces of the first node, N.
            status: 0 = solved.
            ms: its duration, ms.
        """
        self._mpc_rows.append(dict(zip(MPC_CHANNELS, (time, horizon_com, forces, status, ms), strict=True)))

    def record_estimate(self, q: Array, v: Array, contacts: ArrayLike, ms: float) -> None:
        """Copy the estimate that the controller received at a control tick; call it before :meth:`record`.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            contacts: (nc,) the estimated contacts; 2 of those whose measurement was rejected.
            ms: duration of the estimation, ms.

        Raises:
            InputError: the recorder has no channels for estimates.
        """
        if self._estimate_rows is None:
            raise InputError("estimated", False, "True, for recording estimates")
        self._estimate_rows.append(dict(zip(ESTIMATE_CHANNELS, (q, v, contacts, ms), strict=True)))

    def record_steps(self, **channels: ArrayLike) -> None:
        """Copy command and steps of a control tick; call it before :meth:`record`.

        Args:
            channels: a value for each of :data:`~lgmpc.runs.log.STEP_CHANNELS`, as in :meth:`record`.

        Raises:
            InputError: a channel is missing or unknown, or the recorder has no channels for steps.
        """
        if self._step_rows is None:
            raise InputError("stepping", False, "True, for recording steps")
        self._step_rows.append_all(channels)

    def take_over(self, old: Recorder) -> None:
        """Begin with what another recorder of the same robot holds, which is of no use afterwards.

        Raises:
            InputError: it has updates of an MPC with another number of nodes.
        """
        self._rows, self._step_rows, self._estimate_rows = old._rows, old._step_rows, old._estimate_rows
        if self._friction_rows is not None and old._friction_rows is not None:
            self._friction_rows = old._friction_rows
        elif self._friction_rows is not None:
            for _ in range(old.ticks):  # nothing was estimated
                self._friction_rows.append({"joint_friction": 0.0})
        if not old.mpc_updates:
            return
        nodes, before = (rows.buffers["mpc_horizon_com"].shape[1] - 1 for rows in (self._mpc_rows, old._mpc_rows))
        if nodes and nodes != before:
            raise InputError("mpc.nodes", nodes, f"{before}, because a log has horizons of one length")
        self._mpc_rows = old._mpc_rows
        self._mpc_period_s = self._mpc_period_s or old._mpc_period_s

    def record_friction(self, friction: Array) -> None:
        """Copy the estimated friction (nu,) of the joints at a control tick, N.m; call it before :meth:`record`.

        Raises:
            InputError: the recorder has no channel for it.
        """
        if self._friction_rows is None:
            raise InputError("friction_estimated", False, "True, for recording estimated friction")
        self._friction_rows.append({"joint_friction": friction})

    def log_bytes(self, every: int = 1) -> int:
        """Return the expected size of the log's arrays with one of ``every`` ticks, B."""
        optional = (self._estimate_rows, self._step_rows, self._friction_rows)
        ticks = self._rows.bytes + sum(rows.bytes for rows in optional if rows)
        return -(-ticks // every) + self._mpc_rows.bytes

    def log(self) -> RunLog:
        """Return a copy of all that has been recorded."""
        estimate = {} if self._estimate_rows is None else self._estimate_rows.copies(self.ticks)
        steps = {} if self._step_rows is None else self._step_rows.copies(self.ticks)
        friction = {} if self._friction_rows is None else self._friction_rows.copies(self.ticks)
        return RunLog(
            **self._rows.copies(),
            **estimate,
            **steps,
            **friction,
            **self._mpc_rows.copies(),
            contact_frames=self._contact_frames.copy(),
            joint_names=self._joint_names.copy(),
            effort_limit=self._effort_limit.copy(),
            friction=self._friction,
            contact_radius=self._contact_radius,
            control_period_s=self._control_period_s,
            mpc_period_s=self._mpc_period_s,
            floating_base=self._floating_base,
            mass_kg=self._mass,
        )


class _Rows:
    """Growing buffers of one table of channels."""

    def __init__(self, table: Mapping[str, Channel], sizes: Mapping[str, int], capacity: int) -> None:
        self.count = 0
        self.capacity = max(capacity, 1)
        self.buffers: dict[str, NDArray[Any]] = {}
        for name, channel in table.items():
            tail = tuple(axis if isinstance(axis, int) else sizes[axis] for axis in channel.axes)
            self.buffers[name] = np.zeros((self.capacity, *tail), dtype=channel.dtype)

    def append_all(self, values: Mapping[str, ArrayLike]) -> None:
        """Append a row, which must have every channel."""
        if values.keys() != self.buffers.keys():
            odd = sorted(values.keys() ^ self.buffers.keys())
            raise InputError("channels", ", ".join(odd), "every channel of a tick, and no other")
        self.append(values)

    def append(self, values: Mapping[str, ArrayLike]) -> None:
        i = self.count
        if i == self.capacity:
            self._grow()
        for name, buffer in self.buffers.items():
            buffer[i] = values[name]
        # Counted last: an interrupted row is not part of the log.
        self.count = i + 1

    @property
    def bytes(self) -> int:
        return sum(buffer.nbytes for buffer in self.buffers.values())

    def _grow(self) -> None:
        self.buffers = {name: np.concatenate([buffer, np.zeros_like(buffer)]) for name, buffer in self.buffers.items()}
        self.capacity *= 2

    def copies(self, count: int | None = None) -> dict[str, Any]:
        return {name: buffer[: self.count if count is None else count].copy() for name, buffer in self.buffers.items()}
