"""The arrays of a run's log: the channels, their shapes, and their checks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError
from lgmpc.lie import quaternion
from lgmpc.runs.channels import ArrayFile, Channel, channel, channels_of, described
from lgmpc.runs.ground import along_ground, foot_centres
from lgmpc.typing import GRAVITY, Array, BoolArray, IntArray

StatusArray = NDArray[np.int8]

CONTACT_STATES = ("stance", "swing", "early", "late", "missing", "lost")
"""Contact states of a foot relative to the schedule; the channel ``contact_states`` consists of indices into this."""

SENSOR_FAULTS = ("gyro", "accelerometer", "joints", "speeds", "torques", "external_pose", "external_velocity")
"""Quantities of a measurement; bit k of the channel ``sensor_faults`` says that the k-th was replaced or left out."""

MODES = ("lie", "rise", "stand", "locomote", "recover", "sit", "damp", "maneuver")
"""Modes of the controller; the channel ``mode`` consists of indices into this."""


CONTACT_FORCE_N = 0.1
"""Normal force above which a foot is in contact, N: about 1/60 of that of a foot of Solo12 at rest."""


_tick, _ground, _update = (partial(channel, name) for name in ("tick", "ground", "update"))  # axis "nodes": N + 1
OPTIONAL = ("belief", "estimate", "fault", "friction", "motor", "forecast", "hand", "limit", "surface")
"""Tables of runs on ground that is no level floor, with an estimator, with monitored sensors, with estimated joint
friction, with motors that fail, with forecasts of steps against pushes, with hands that are held or moved, of continued
runs whose floor or torque limits changed, of ground with several coefficients of friction."""
_belief, _estimate, _fault, _friction, _motor, _forecast, _hand, _limit, _surface = (
    partial(channel, name, optional=True) for name in OPTIONAL
)
_entry = partial(channel, "entry")


@described
@dataclass(frozen=True, kw_only=True)
class RunLog(ArrayFile):
    """The log of one run: n control ticks, m MPC updates, nf feet with nc contact points. World axes, read-only arrays.

    Attributes:
        friction: friction coefficient of the plant's floor at the end.
        contact_radius: radius of the spherical feet, m (0 = point feet).
        control_period_s: time between two control ticks, s.
        mpc_period_s: time between two MPC updates, s (0 = no MPC).
        floating_base: whether ``q`` begins with a base pose.
        mass_kg: mass of the simulated robot; NaN where it was not recorded.
    """

    time: Array = _tick("since the start, strictly increasing", unit="s")
    q: Array = _tick("configuration", "nq", unit="m m m 1 1 1 1 rad", frame="world")
    v: Array = _tick("velocity, of the base in its own axes", "nv", unit="m/s m/s m/s rad/s", frame="base")
    tau: Array = _tick("torques applied by the plant, after clipping", "nu", unit="N.m")
    tau_command: Array = _tick("torques that the controller commanded", "nu", unit="N.m")
    contact_forces: Array = _tick("forces on the robot, measured by the plant", "nc", 3, unit="N", frame="world")
    contact_forces_desired: Array = _tick("forces of the whole-body QP", "nc", 3, unit="N", frame="world")
    contact_points: Array = _tick(
        "contact points; of spherical feet, the points nearest to the ground", "nc", 3, unit="m", frame="world"
    )
    contact_normals: Array = _tick("unit normals of the ground at the contact points", "nc", 3, frame="world")
    com: Array = _tick("centre of mass", 3, unit="m", frame="world")
    com_reference: Array = _tick("target of the centre of mass", 3, unit="m", frame="world")
    momentum: Array = _tick("centroidal momentum [linear; angular]", 6, unit="N.s N.s N.s N.m.s", frame="world")
    base_reference: Array = _tick("target base pose [position, quaternion x y z w]", 7, unit="m m m 1", frame="world")
    push: Array = _tick("disturbance wrench applied [force; torque]", 6, unit="N N N N.m", frame="world")
    push_point: Array = _tick("point of application of the push", 3, unit="m", frame="world")
    wbc_status: StatusArray = _tick(
        "0 = solved; a fallback command otherwise: 1 = the QP failed, 2 = the command was not finite", dtype=np.int8
    )
    wbc_ms: Array = _tick("duration of the whole-body controller's tick", unit="ms")
    contact_clearance: Array = _ground(
        "distances of the contact points from the ground, negative below it", "nc", unit="m"
    )
    ground_height: Array = _ground("height of the ground below the base", unit="m", frame="world")
    ground_normal: Array = _ground("unit normal of the ground below the base", 3, frame="world")
    mpc_time: Array = _update("of each MPC update", unit="s")
    mpc_horizon_com: Array = _update("predicted centre of mass", "nodes", 3, unit="m", frame="world")
    mpc_forces: Array = _update("forces of the first node", "nc", 3, unit="N", frame="world")
    mpc_status: StatusArray = _update("0 = solved", dtype=np.int8)
    mpc_ms: Array = _update("duration of each update", unit="ms")
    estimate_q: Array | None = _estimate(
        "configuration that the controller received; not recorded, like all of the estimate, if it was the true one",
        "nq",
        unit="m m m 1 1 1 1 rad",
        frame="world",
    )
    estimate_v: Array | None = _estimate(
        "velocity that the controller received", "nv", unit="m/s m/s m/s rad/s", frame="base"
    )
    estimate_contacts: StatusArray | None = _estimate(
        "1 = the estimator classified the foot as standing, 2 = and rejected its measurement, because it slides",
        "nf",
        dtype=np.int8,
    )
    estimate_ms: Array | None = _estimate("duration of the estimator's tick", unit="ms")
    command: Array = _tick(
        "limited motion command [velocity ahead, to the left; yaw rate], in axes that turn with the base",
        3,
        unit="m/s m/s rad/s",
        frame="horizontal",
    )
    mode: StatusArray = _tick("mode of the controller, as index into MODES", dtype=np.int8)
    gait_period_s: Array = _tick("duration of one cycle of the gait that the schedule follows", unit="s")
    stance: StatusArray = _tick("1 = the controller assumes that the foot is in contact", "nf", dtype=np.int8)
    contact_states: StatusArray = _tick("state of each foot, as index into CONTACT_STATES", "nf", dtype=np.int8)
    swing_targets: Array = _tick(
        "references of the points of feet in the air, contact points of feet in stance",
        "nc",
        3,
        unit="m",
        frame="world",
    )
    footholds: Array = _tick("current or next places of the contact points", "nc", 3, unit="m", frame="world")
    joint_friction: Array | None = _friction("estimated friction that the torques overcome", "nu", unit="N.m")
    motor_shares: Array | None = _motor("share of its torque that each motor gives, as detected", "nu")
    sensor_faults: NDArray[np.uint8] | None = _fault(
        "quantities whose readings could not be true and were replaced: bits of SENSOR_FAULTS", dtype=np.uint8
    )
    forecast_ms: Array | None = _forecast("duration of forecasts of steps against a push", unit="ms")
    believed_ground: Array | None = _belief(
        "plane that the controller takes the ground under the robot for [depth below the base; rise along x, y]; not"
        " recorded on level floors",
        3,
        unit="m 1 1",
        frame="world",
    )
    hand_poses: Array | None = _hand(
        "poses of the hands [position, quaternion x y z w]", "nh", 7, unit="m m m 1", frame="world"
    )
    hand_targets: Array | None = _hand("targets of the hands", "nh", 7, unit="m m m 1", frame="world")
    floor_friction: Array | None = _limit(
        "friction coefficient of the plant's floor; not recorded, like the torque limits, if neither changed"
    )
    torque_limits: Array | None = _limit("torque limits that the plant clips at", "nu", unit="N.m")
    contact_friction: Array | None = _surface(
        "friction coefficients of the ground at the contact points; not recorded if all of it has one", "nc"
    )
    contact_frames: NDArray[np.str_] = _entry("names of the contact frames", "nc", dtype=np.str_)
    effort_limit: Array = _entry("torque limits that the plant clips at, at the end", "nu", unit="N.m")
    joint_names: NDArray[np.str_] = _entry("names of the actuated joints", "nu", dtype=np.str_)
    friction: float
    contact_radius: float
    control_period_s: float
    mpc_period_s: float
    floating_base: bool = True
    mass_kg: float = math.nan
    upright_axis: Array = _entry("axis of the base that is vertical in the robot's posture", 3, frame="base")

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, each in channels_of(RunLog, "entry").items():
            each.check(name, getattr(self, name), sizes)
        sizes["nf"] = len(self.feet)  # of names whose shape is right
        for table in (*self._tick_tables(), MPC_CHANNELS):
            missing = [name for name in table if getattr(self, name) is None]
            if missing:
                raise RunFolderError(f"log lacks {', '.join(missing)}")
            for name, each in table.items():
                each.check(name, getattr(self, name), sizes, "updates" if table is MPC_CHANNELS else "ticks")
        if not (np.all(np.isfinite(self.time)) and np.all(np.diff(self.time) > 0.0)):
            raise RunFolderError("'time' does not increase strictly")
        if self.floating_base and sizes["nq"] < 7:
            raise RunFolderError(f"'q' has {sizes['nq']} columns, too few for a floating base (7 or more)")

    @property
    def ticks(self) -> int:
        """Number of logged control ticks n."""
        return len(self.time)

    def tables(self) -> dict[str, list[str]]:
        """Return the channels that this log has: of its ticks and of the updates of the MPC, each with its time."""
        return {"ticks": [name for table in self._tick_tables() for name in table], "mpc": list(MPC_CHANNELS)}

    def names_along(self) -> dict[str, list[str]]:
        """Return the names of entries along the axes nq, nv, nu, nc and nf."""
        joints = self.joint_names.tolist()
        base = ("x y z qx qy qz qw", "vx vy vz wx wy wz") if self.floating_base else ("", "")
        names = {f"n{axis}": [*words.split(), *joints] for axis, words in zip("qv", base, strict=True)}
        return names | {"nu": joints, "nc": self.contact_frames.tolist(), "nf": [*self.feet]}

    @property
    def finite_ticks(self) -> int:
        """Number of ticks before the first one with a state that is not finite."""
        finite = np.isfinite(self.q).all(axis=1) & np.isfinite(self.v).all(axis=1)
        return self.ticks if finite.all() else int(np.argmin(finite))

    @property
    def commanded(self) -> bool:
        """Whether the robot was commanded to move at some time."""
        return bool(self.command.any())

    @property
    def stepped(self) -> bool:
        """Whether a foot swung at some time."""
        return not bool(self.stance.all())

    def _tick_tables(self) -> list[Mapping[str, Channel]]:
        """Return the tables of channels per tick that this log has."""
        optional = (channels_of(RunLog, table) for table in OPTIONAL)
        present = [table for table in optional if any(getattr(self, name) is not None for name in table)]
        return [CHANNELS, GROUND_CHANNELS, *present]

    def __repr__(self) -> str:
        last = f", {self.time[0]:g} to {self.time[-1]:g} s" if self.ticks else ""
        return (
            f"RunLog of {self.ticks} ticks{last}, {len(self.mpc_time)} MPC updates, {len(self.joint_names)} joints,"
            f" contacts {', '.join(self.contact_frames)}\nchannels (shapes and units in .channels): "
            + ", ".join(self.channels)
        )

    @cached_property
    def normal_forces(self) -> Array:
        """(n, nc) parts of the contact forces along the ground's normals, N."""
        return np.einsum("nki,nki->nk", self.contact_forces, self.contact_normals)

    @cached_property
    def tangential_forces(self) -> Array:
        """(n, nc) norms of the parts along the ground, N."""
        return along_ground(self.contact_forces, self.contact_normals)

    @cached_property
    def friction_limits(self) -> Array:
        """(n, nc) largest parts along the ground within the friction cones, N."""
        return self.friction_of_feet * np.maximum(self.normal_forces, 0.0)

    @cached_property
    def friction_of_feet(self) -> Array:
        """(n, nc) friction coefficients of the ground at the feet."""
        if self.contact_friction is not None:
            return self.contact_friction
        return np.broadcast_to(self.friction_over_time[:, None], (self.ticks, len(self.contact_frames)))

    @cached_property
    def foot_centres(self) -> Array:
        """(n, nc, 3) centres of the spherical feet, m. They do not jump where a foot touches another surface."""
        return foot_centres(self.contact_points, self.contact_normals, self.contact_radius)

    @cached_property
    def feet(self) -> Mapping[str, int]:
        """Numbers of contact points of the nf feet, by their names."""
        return feet_of(self.contact_frames.tolist())

    @cached_property
    def foot_of(self) -> IntArray:
        """(nc,) foot of each contact point."""
        return np.repeat(np.arange(len(self.feet)), list(self.feet.values()))

    def of_feet(self, combination: np.ufunc, values: NDArray[Any]) -> NDArray[Any]:
        """Return (n, nf) combinations, such as sums, over the points of each foot of values (n, nc)."""
        return _combined(combination, values, self.feet)

    @property
    def closed(self) -> BoolArray:
        """(n, nc) flags of the contact points with a force."""
        return self.normal_forces > CONTACT_FORCE_N

    @property
    def touching(self) -> BoolArray:
        """(n, nf) flags of the feet with a force at any point."""
        return self.of_feet(np.logical_or, self.closed)

    @property
    def weight_n(self) -> float:
        """Weight of the simulated robot, N; NaN where its mass was not recorded."""
        return GRAVITY * self.mass_kg

    @cached_property
    def tilt_deg(self) -> Array:
        """(n,) angle between the base's upright axis and the normal of the ground below it, in [0, 180], degrees."""
        return tilt_deg(self.base_pose[:, 3:], self.upright_axis, self.ground_normal)

    @cached_property
    def base_height(self) -> Array:
        """(n,) distance of the base from the ground below it, along the ground's normal, m."""
        return self.above_ground(self.base_pose[:, :3])

    def above_ground(self, points: Array) -> Array:
        """Return (n,) the distances of (n, 3) points from the plane of the ground below the base at each tick, m."""
        below = np.column_stack((self.base_pose[:, :2], self.ground_height))
        return np.einsum("ni,ni->n", points - below, self.ground_normal)

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
        limits = self.effort_limit if self.torque_limits is None else self.torque_limits
        return np.broadcast_to(limits, (self.ticks, len(self.effort_limit)))

    @property
    def joint_velocity(self) -> Array:
        """(n, nu) velocity of the actuated joints, rad/s."""
        return self.v[:, 6:] if self.floating_base else self.v

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> RunLog:
        """Return the contents of a file; flags with an entry for each corner of a sole, as once saved, become its own.

        Raises:
            RunFolderError: if a channel is missing or has the wrong shape or type.
        """
        feet = feet_of(map(str, np.ravel(arrays.get("contact_frames", ()))))
        numbers = [name for name in _OF_FEET if name in arrays and arrays[name].dtype.kind in "biuf"]
        corners = [name for name in numbers if arrays[name].shape[1:] == (sum(feet.values()),)]
        return super().from_arrays({**arrays, **{k: _combined(np.maximum, arrays[k], feet) for k in corners}})

    def decimated(self, every: int) -> RunLog:
        """Return the log with one of ``every`` ticks.

        A controller status that is not 0, and faults of sensors, are moved to the kept tick of their window: the
        file contains every failure. MPC channels are unchanged.
        """
        if every <= 1 or self.ticks == 0:
            return self
        starts = np.arange(0, self.ticks, every)
        names = [name for table in self._tick_tables() for name in table]
        kept: dict[str, Any] = {name: np.ascontiguousarray(getattr(self, name)[::every]) for name in names}
        worst = np.maximum.reduceat(np.abs(self.wbc_status.astype(np.int16)), starts)
        kept["wbc_status"] = worst.astype(np.int8)
        if self.sensor_faults is not None:
            kept["sensor_faults"] = np.bitwise_or.reduceat(self.sensor_faults, starts)
        return replace(self, **kept)

    def until(self, end: int) -> RunLog:
        """Return the log of the first ``end`` ticks, and the MPC updates before the next one."""
        return self if end >= self.ticks else self._part(slice(end), slice(self._updates_before(end)))

    def since(self, start: int) -> RunLog:
        """Return the log from tick ``start`` on, and the MPC updates from then on."""
        return self._part(slice(start, None), slice(self._updates_before(start), None)) if start else self

    def _updates_before(self, tick: int) -> int:
        return int(np.searchsorted(self.mpc_time, self.time[tick])) if tick < self.ticks else len(self.mpc_time)

    def _part(self, ticks: slice, updates: slice) -> RunLog:
        names = [name for table in self._tick_tables() for name in table]
        kept: dict[str, Any] = {name: getattr(self, name)[ticks] for name in names}
        kept |= {name: getattr(self, name)[updates] for name in MPC_CHANNELS}
        return replace(self, **kept)


CHANNELS, GROUND_CHANNELS, MPC_CHANNELS = (channels_of(RunLog, table) for table in ("tick", "ground", "update"))
"""Channels of a control tick, those of the ground, computed when the log is made, and those of an MPC update."""

_OF_FEET = [name for t in ("tick", "estimate") for name, each in channels_of(RunLog, t).items() if "nf" in each.axes]


def feet_of(contact_frames: Iterable[str]) -> Mapping[str, int]:
    """Return the number of points of each foot by its name: those of a sole are ``frame/1``, ``frame/2``, ..."""
    parts = [(name, *name.rpartition("/")[::2]) for name in contact_frames]
    return Counter(frame if frame and k.isdigit() else name for name, frame, k in parts)


def _combined(combination: np.ufunc, values: NDArray[Any], feet: Mapping[str, int]) -> NDArray[Any]:
    ends = np.cumsum([*feet.values()])
    return values if len(feet) == values.shape[1] else combination.reduceat(values, [0, *ends[:-1]], axis=1)


_UP = np.array([0.0, 0.0, 1.0])


def tilt_deg(orientations: Array, upright: Array = _UP, vertical: Array = _UP) -> Array:
    """Return (n,) the angles between an axis of the base and the vertical, in [0, 180], degrees.

    Args:
        orientations: (n, 4) quaternions of the base, x y z w.
        upright: (3,) the axis, base axes; z unless given.
        vertical: (3,) or (n, 3) unit vectors of the world; z unless given.
    """
    axis = quaternion.act.unchecked(orientations, np.broadcast_to(upright, (len(orientations), 3)))
    # atan2 of sine and cosine: arccos loses half of the digits near zero.
    sine, cosine = np.linalg.norm(np.cross(axis, vertical), axis=1), np.sum(axis * vertical, axis=1)
    return np.degrees(np.arctan2(sine, cosine))
