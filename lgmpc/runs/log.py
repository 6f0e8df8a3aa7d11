"""The arrays of a run's log: the channels, their shapes, and their checks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError
from lgmpc.runs.intervals import intervals
from lgmpc.typing import Array

__all__ = [
    "CHANNELS",
    "CONTACT_STATES",
    "ESTIMATE_CHANNELS",
    "FORECAST_CHANNELS",
    "FRICTION_CHANNELS",
    "LIMIT_CHANNELS",
    "MODES",
    "MPC_CHANNELS",
    "STEP_CHANNELS",
    "Channel",
    "PushInterval",
    "RunLog",
    "push_intervals",
]

StatusArray = NDArray[np.int8]

CONTACT_STATES = ("stance", "swing", "early", "late", "missing", "lost")
"""Contact states of a foot relative to the schedule; the channel ``contact_states`` consists of indices into this."""

MODES = ("lie", "rise", "stand", "locomote", "recover", "sit", "damp")
"""Modes of the controller; the channel ``mode`` consists of indices into this."""


@dataclass(frozen=True)
class Channel:
    """Shape and type of one logged quantity; the first axis is the tick.

    Attributes:
        axes: names of the axes after the tick ("nq", "nc", ...) or their fixed lengths.
        dtype: NumPy type of the entries.
    """

    axes: tuple[str | int, ...] = ()
    dtype: type[np.generic] = np.float64


def single(name: str, array: NDArray[Any], kinds: str) -> Any:
    """Return the single value of an entry of a log file.

    Args:
        name: name of the entry.
        array: the entry.
        kinds: NumPy's kind letters of the allowed types.

    Raises:
        RunFolderError: the entry has several values, or another type.
    """
    if array.shape != () or array.dtype.kind not in kinds:
        raise RunFolderError(f"entry '{name}' has shape {array.shape} and holds {array.dtype}, expected one value")
    return array.item()


class _Table:
    """A table of channels: its call declares one of them as a field of :class:`RunLog`.

    Args:
        name: name of the table.
        optional: whether some runs lack its channels, which are ``None`` then.
    """

    def __init__(self, name: str, *, optional: bool = False) -> None:
        self._name, self._optional = name, optional

    def __call__(self, *axes: str | int, dtype: type[np.generic] = np.float64) -> Any:
        metadata = {self._name: Channel(axes, dtype)}
        return field(default=None, metadata=metadata) if self._optional else field(metadata=metadata)


_tick, _update = _Table("tick"), _Table("update")  # the axis "nodes" counts the horizon's states, N + 1
_estimate, _step, _friction, _forecast, _limit = (
    _Table(name, optional=True) for name in ("estimate", "step", "friction", "forecast", "limit")
)


@dataclass(frozen=True, kw_only=True)
class RunLog:
    """The log of one run: n control ticks, m MPC updates, nc contacts. World axes, SI units, read-only arrays.

    Attributes:
        time: (n,) s since the start, strictly increasing.
        q: (n, nq) configuration.
        v: (n, nv) velocity.
        tau: (n, nu) torque applied by the plant, after clipping, N.m.
        tau_command: (n, nu) torque that the controller commanded, N.m.
        contact_forces: (n, nc, 3) forces on the robot, measured by the plant, N.
        contact_forces_desired: (n, nc, 3) forces of the whole-body QP, N.
        contact_points: (n, nc, 3) positions of the contact points, m.
        com: (n, 3) centre of mass, m.
        com_reference: (n, 3) its target, m.
        momentum: (n, 6) centroidal momentum [linear; angular].
        base_reference: (n, 7) target base pose [position, quaternion x y z w].
        push: (n, 6) disturbance wrench applied [force; torque], N and N.m.
        push_point: (n, 3) its point of application, m.
        wbc_status: (n,) 0 = solved; a fallback command otherwise: 1 = the QP failed, 2 = the command was not finite.
        wbc_ms: (n,) duration of the whole-body controller's tick, ms.
        mpc_time: (m,) time of each MPC update, s.
        mpc_horizon_com: (m, N+1, 3) predicted centre of mass, m.
        mpc_forces: (m, nc, 3) forces of the first node, N.
        mpc_status: (m,) 0 = solved.
        mpc_ms: (m,) duration of each update, ms.
        contact_frames: (nc,) names of the contact frames.
        joint_names: (nu,) names of the actuated joints.
        forecast_ms: (n,) duration of forecasts of steps against a push, ms; None without such steps.
        floor_friction: (n,) friction coefficient of the plant's floor; None, like the torque limits, if neither changed
            during the run.
        torque_limits: (n, nu) torque limits that the plant clips at, N.m.
        effort_limit: (nu,) torque limits that the plant clips at, at the end, N.m.
        friction: friction coefficient of the plant's floor at the end.
        contact_radius: radius of the spherical feet, m (0 = point feet).
        control_period_s: time between two control ticks, s.
        mpc_period_s: time between two MPC updates, s (0 = no MPC).
        floating_base: whether ``q`` begins with a base pose.
        mass_kg: mass of the simulated robot; NaN where it was not recorded.
        estimate_q: (n, nq) configuration that the controller received; None, like all of the estimate, if it was the
            true one.
        estimate_v: (n, nv) velocity that it received.
        estimate_contacts: (n, nc) 1 = the estimator classified the foot as standing, 2 = and rejected its measurement,
            because it slides.
        estimate_ms: (n,) duration of the estimator's tick, ms.
        command: (n, 3) limited motion command [velocity ahead, to the left, m/s; yaw rate, rad/s] in the horizontal
            frame that turns with the base; None, like all of the steps, if they were not recorded.
        mode: (n,) mode of the controller, as index into :data:`MODES`.
        gait_period_s: (n,) duration of one cycle of the gait that the schedule follows, s.
        stance: (n, nc) 1 = the controller assumes that the foot is in contact.
        contact_states: (n, nc) state of each foot, as index into :data:`CONTACT_STATES`.
        swing_targets: (n, nc, 3) reference of a foot in the air, contact point of one in stance, m.
        footholds: (n, nc, 3) current or next foothold of each foot, m.
        joint_friction: (n, nu) estimated friction that the torques overcome, N.m; None if it was not estimated.
    """

    time: Array = _tick()
    q: Array = _tick("nq")
    v: Array = _tick("nv")
    tau: Array = _tick("nu")
    tau_command: Array = _tick("nu")
    contact_forces: Array = _tick("nc", 3)
    contact_forces_desired: Array = _tick("nc", 3)
    contact_points: Array = _tick("nc", 3)
    com: Array = _tick(3)
    com_reference: Array = _tick(3)
    momentum: Array = _tick(6)
    base_reference: Array = _tick(7)
    push: Array = _tick(6)
    push_point: Array = _tick(3)
    wbc_status: StatusArray = _tick(dtype=np.int8)
    wbc_ms: Array = _tick()
    mpc_time: Array = _update()
    mpc_horizon_com: Array = _update("nodes", 3)
    mpc_forces: Array = _update("nc", 3)
    mpc_status: StatusArray = _update(dtype=np.int8)
    mpc_ms: Array = _update()
    estimate_q: Array | None = _estimate("nq")
    estimate_v: Array | None = _estimate("nv")
    estimate_contacts: StatusArray | None = _estimate("nc", dtype=np.int8)
    estimate_ms: Array | None = _estimate()
    command: Array | None = _step(3)
    mode: StatusArray | None = _step(dtype=np.int8)
    gait_period_s: Array | None = _step()
    stance: StatusArray | None = _step("nc", dtype=np.int8)
    contact_states: StatusArray | None = _step("nc", dtype=np.int8)
    swing_targets: Array | None = _step("nc", 3)
    footholds: Array | None = _step("nc", 3)
    joint_friction: Array | None = _friction("nu")
    forecast_ms: Array | None = _forecast()
    floor_friction: Array | None = _limit()
    torque_limits: Array | None = _limit("nu")
    contact_frames: NDArray[np.str_]
    joint_names: NDArray[np.str_]
    effort_limit: Array
    friction: float
    contact_radius: float
    control_period_s: float
    mpc_period_s: float
    floating_base: bool = True
    mass_kg: float = math.nan

    def __post_init__(self) -> None:
        for name, kind in (("contact_frames", "U"), ("joint_names", "U"), ("effort_limit", "f")):
            array = getattr(self, name)
            if array.ndim != 1 or array.dtype.kind != kind:
                raise RunFolderError(f"log entry '{name}' has shape {array.shape} and holds {array.dtype}")
        for name in ("time", "mpc_time"):
            if getattr(self, name).ndim != 1:
                raise RunFolderError(f"log channel '{name}' has {getattr(self, name).ndim} axes, expected 1")
        dims: dict[str, int] = {"nc": len(self.contact_frames), "nu": len(self.effort_limit)}
        for table, length in ((CHANNELS, len(self.time)), (MPC_CHANNELS, len(self.mpc_time))):
            for name, channel in table.items():
                self._check(name, getattr(self, name), channel, length, dims)
        for table in self._optional_tables():
            missing = [name for name in table if getattr(self, name) is None]
            if missing:
                raise RunFolderError(f"log lacks {', '.join(missing)}")
            for name, channel in table.items():
                self._check(name, getattr(self, name), channel, len(self.time), dims)
        for array in (self.contact_frames, self.joint_names, self.effort_limit):
            array.setflags(write=False)
        if self.joint_names.shape != (dims["nu"],):
            raise RunFolderError(
                f"log entry 'joint_names' has shape {self.joint_names.shape}, expected {(dims['nu'],)}"
            )
        if len(self.time) and not (np.all(np.isfinite(self.time)) and np.all(np.diff(self.time) > 0.0)):
            raise RunFolderError("log channel 'time' does not increase strictly")
        if self.floating_base and dims["nq"] < 7:
            raise RunFolderError(f"log channel 'q' has {dims['nq']} columns, too few for a floating base (7 or more)")

    @staticmethod
    def _check(name: str, array: NDArray[Any], channel: Channel, length: int, dims: dict[str, int]) -> None:
        if array.ndim != 1 + len(channel.axes):
            raise RunFolderError(f"log channel '{name}' has {array.ndim} axes, expected {1 + len(channel.axes)}")
        wanted = [length]
        for axis, size in zip(channel.axes, array.shape[1:], strict=True):
            wanted.append(axis if isinstance(axis, int) else dims.setdefault(axis, size))
        if array.shape != tuple(wanted):
            raise RunFolderError(f"log channel '{name}' has shape {array.shape}, expected {tuple(wanted)}")
        if array.dtype != channel.dtype:
            raise RunFolderError(f"log channel '{name}' holds {array.dtype}, expected {np.dtype(channel.dtype)}")
        array.setflags(write=False)

    @property
    def ticks(self) -> int:
        """Number of logged control ticks n."""
        return len(self.time)

    @property
    def finite_ticks(self) -> int:
        """Number of ticks before the first one with a state that is not finite."""
        finite = np.isfinite(self.q).all(axis=1) & np.isfinite(self.v).all(axis=1)
        return self.ticks if finite.all() else int(np.argmin(finite))

    @property
    def estimated(self) -> bool:
        """Whether the controller received an estimate."""
        return any(getattr(self, name) is not None for name in ESTIMATE_CHANNELS)

    @property
    def commanded(self) -> bool:
        """Whether the robot was commanded to move at some time."""
        return self.command is not None and bool(self.command.any())

    @property
    def stepped(self) -> bool:
        """Whether a foot swung at some time."""
        return self.stance is not None and not bool(self.stance.all())

    def _optional_tables(self) -> list[Mapping[str, Channel]]:
        """The optional tables of channels that this log has."""
        tables = (ESTIMATE_CHANNELS, STEP_CHANNELS, FRICTION_CHANNELS, FORECAST_CHANNELS, LIMIT_CHANNELS)
        return [table for table in tables if any(getattr(self, name) is not None for name in table)]

    @property
    def base_pose(self) -> Array:
        """(n, 7) base pose [position, quaternion x y z w]; the identity where the base is fixed."""
        if self.floating_base:
            return self.q[:, :7]
        return np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (self.ticks, 1))

    @property
    def friction_over_time(self) -> Array:
        """(n,) friction coefficient of the plant's floor."""
        return np.full(self.ticks, self.friction) if self.floor_friction is None else self.floor_friction

    @property
    def effort_limit_over_time(self) -> Array:
        """(n, nu) torque limits that the plant clips at, N.m."""
        return np.tile(self.effort_limit, (self.ticks, 1)) if self.torque_limits is None else self.torque_limits

    @property
    def joint_velocity(self) -> Array:
        """(n, nu) velocity of the actuated joints, rad/s."""
        return self.v[:, 6:] if self.floating_base else self.v

    def decimated(self, every: int) -> RunLog:
        """Return the log with one of ``every`` ticks.

        A controller status that is not 0 is moved to the kept tick of its window, so that the file contains every
        failure. MPC channels are unchanged.
        """
        if every <= 1 or self.ticks == 0:
            return self
        starts = np.arange(0, self.ticks, every)
        names = [name for table in (CHANNELS, *self._optional_tables()) for name in table]
        kept: dict[str, Any] = {name: np.ascontiguousarray(getattr(self, name)[::every]) for name in names}
        worst = np.maximum.reduceat(np.abs(self.wbc_status.astype(np.int16)), starts)
        kept["wbc_status"] = worst.astype(np.int8)
        return replace(self, **kept)

    def until(self, end: int) -> RunLog:
        """Return the log of the first ``end`` ticks, and the MPC updates before the next one."""
        return self._part(slice(end), slice(self._updates_before(end)))

    def since(self, start: int) -> RunLog:
        """Return the log from tick ``start`` on, and the MPC updates from then on."""
        return self._part(slice(start, None), slice(self._updates_before(start), None)) if start else self

    def _updates_before(self, tick: int) -> int:
        return int(np.searchsorted(self.mpc_time, self.time[tick])) if tick < self.ticks else len(self.mpc_time)

    def _part(self, ticks: slice, updates: slice) -> RunLog:
        names = [name for table in (CHANNELS, *self._optional_tables()) for name in table]
        kept: dict[str, Any] = {name: getattr(self, name)[ticks].copy() for name in names}
        kept |= {name: getattr(self, name)[updates].copy() for name in MPC_CHANNELS}
        return replace(self, **kept)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, as stored in ``log.npz``."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: np.asarray(value) for name, value in values.items() if value is not None}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> RunLog:
        """Return the log of the arrays of ``log.npz``.

        Raises:
            RunFolderError: if a channel is missing or has the wrong shape or type.
        """
        tables = ESTIMATE_CHANNELS, STEP_CHANNELS, FRICTION_CHANNELS, FORECAST_CHANNELS, LIMIT_CHANNELS
        optional = [*(name for table in tables for name in table), "mass_kg"]
        absent = [name for name in optional if name not in arrays]
        names = [each.name for each in fields(cls) if each.name not in absent]
        missing = [name for name in names if name not in arrays]
        if missing:
            raise RunFolderError(f"log lacks {', '.join(missing)}")
        values: dict[str, Any] = {name: arrays[name] for name in names}
        for name in {"friction", "contact_radius", "control_period_s", "mpc_period_s", "mass_kg"} & values.keys():
            values[name] = single(name, values[name], "f")
        values["floating_base"] = single("floating_base", values["floating_base"], "b")
        return cls(**values)


def _channels(name: str) -> Mapping[str, Channel]:
    return {each.name: each.metadata[name] for each in fields(RunLog) if name in each.metadata}


CHANNELS, MPC_CHANNELS, ESTIMATE_CHANNELS, STEP_CHANNELS, FRICTION_CHANNELS, FORECAST_CHANNELS, LIMIT_CHANNELS = map(
    _channels, ("tick", "update", "estimate", "step", "friction", "forecast", "limit")
)
"""Channels by table, one entry per MPC update or per logged control tick; the last five tables are those of runs with
an estimator, of runs whose steps are recorded, of runs that estimate joint friction, of runs that forecast steps
against pushes, and of continued runs whose floor or torque limits changed."""


@dataclass(frozen=True)
class PushInterval:
    """One push of a log.

    Attributes:
        start: time of its first tick, s.
        end: time of its end, s.
        impulse: (3,) integral of its force, N.s, world axes.
    """

    start: float
    end: float
    impulse: Array


def push_intervals(log: RunLog) -> tuple[PushInterval, ...]:
    """Return the pushes of a run: the intervals in which the applied wrench is not zero."""
    if log.ticks < 2:
        return ()
    active = np.any(log.push != 0.0, axis=1)
    period = float(np.median(np.diff(log.time)))
    return tuple(
        PushInterval(float(log.time[a]), float(log.time[b - 1]) + period, log.push[a:b, :3].sum(axis=0) * period)
        for a, b in intervals(active)
    )
