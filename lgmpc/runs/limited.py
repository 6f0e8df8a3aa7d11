"""Quantities of a run with limits, over time: margins, shares of the limit used, and their extremes."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lgmpc.runs.atomic import Number
from lgmpc.runs.figures import figure_of, figure_words, short_number
from lgmpc.runs.gate import Gate, measured
from lgmpc.runs.log import CONTACT_FORCE_N, MODES, RunLog
from lgmpc.runs.metrics import Metrics, slide
from lgmpc.runs.modes import FALL_HEIGHT_FRACTION, FALL_TILT_DEG, LOW_MODES
from lgmpc.support import capture_point, support_margin
from lgmpc.typing import Array

_SLID_M = 0.01
"""Displacement since the start of its stance, m, beyond which a foot has slid, if the gate has no limit on slip."""
_OVER_TIME = ("max_tilt_deg", "max_displacement_m", "max_slip_m", "min_base_height_m", "min_base_height_fraction")
"""Limits of the gate that are examined at each tick."""
_ROUNDING = 1e-9
_WHOLE = ("",)
"""Subjects of a quantity of the whole robot."""
_LOWEST = 0.02  # m; at lower heights the pendulum does not model the robot
_LOADED = 0.02
"""Share of the robot's weight above which the friction of a foot is evaluated."""


class DriveLine(NamedTuple):
    """The torque-speed line of a drive at the voltage of its supply: the torque falls linearly with the speed.

    Attributes:
        stall: torque at rest, N.m.
        no_load: speed without torque, rad/s.
    """

    stall: float
    no_load: float

    def torque(self, driving: Array) -> Array:
        """Return the largest torque, N.m, at speeds in its direction, rad/s; the stall torque at opposite ones."""
        return self.stall * np.clip(1.0 - driving / self.no_load, 0.0, 1.0)

    def power(self, effort: Array) -> Array:
        """Return the largest mechanical power on the line, below torque limits, W.

        That is at half of the no-load speed, or where the line meets the limit if that is faster.
        """
        torque = np.minimum(effort, 0.5 * self.stall)
        return torque * self.no_load * (1.0 - torque / self.stall)


class UnloggedLimits(NamedTuple):
    """Limits of the joints that the log does not contain.

    Attributes:
        lower: (nu,) lowest positions, rad; -inf where there is none.
        upper: (nu,) highest positions, rad.
        speed: (nu,) highest speeds, rad/s.
        line: torque-speed line of the drives; ``None`` if the plant has none: their power then has no limit.
    """

    lower: Array
    upper: Array
    speed: Array
    line: DriveLine | None = None


@dataclass(frozen=True)
class Nearest:
    """The tick at which a quantity came nearest to its limit.

    Attributes:
        name: name of the quantity.
        subject: joint or foot; empty for a quantity of the robot.
        time_s: time of the tick, s; ``None`` for a figure of the whole run.
        value: value at this time.
        unit: unit of value, limit and margin.
        limit: limit at this time; inf for the largest value of a quantity without one.
        margin: distance to the limit, negative beyond it.
        used: share of the limit used, 1 at the limit; quantities of different units are ordered by it.
        judged: whether the limit is one of the gate's: beyond it the run fails.
    """

    name: str
    subject: str
    time_s: float | None
    value: Number
    unit: str
    limit: Number = math.inf
    margin: Number = math.inf
    used: Number = 0.0
    judged: bool = False

    @property
    def kept(self) -> bool:
        """Whether the limit was kept throughout, up to rounding; not by what is not a number."""
        return self.margin >= 0.0

    @property
    def broken(self) -> bool:
        """Whether the run failed because of it."""
        return self.judged and self.margin < 0.0

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        where = f" of {self.subject}" if self.subject else ""
        when = "" if self.time_s is None else f" at {self.time_s:.3f} s"
        if self.limit == math.inf:
            return f"{self.name}{where}: {self.value:.3g}{unit}{when}"
        shown, limit = short_number(self.value, self.limit)
        return f"{self.name}{where}: {shown}{unit}{when}, limit {limit}{unit}"


@dataclass(frozen=True)
class Limited:
    """A quantity with a limit, at n ticks, of k joints or feet.

    Attributes:
        name: name in words.
        unit: unit of values, limits and margins.
        subjects: (k,) joints or feet; one empty name for a quantity of the robot.
        values: (n, k) values.
        limits: (n, k) limits; these, margins and scale are broadcast.
        margins: (n, k) distances to the limits, negative beyond; NaN where the limit does not apply.
        scale: (n, k) margins at which the share used is 0.
        judged: whether the limit is one of the gate's: beyond it the run fails.
    """

    name: str
    unit: str
    subjects: tuple[str, ...]
    values: Array
    limits: Array
    margins: Array
    scale: Array
    judged: bool = False

    def __post_init__(self) -> None:
        for name in ("limits", "margins", "scale"):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, np.broadcast_to(array, self.values.shape))

    @property
    def used(self) -> Array:
        """(n, k) share of the limit that is used: 1 at the limit; NaN where it does not apply."""
        with np.errstate(invalid="ignore", divide="ignore"):
            share: Array = 1.0 - self.margins / self.scale
        return share

    def at(self, ticks: slice) -> "Limited":
        """Return the quantity at some of the ticks."""
        return replace(self, **{name: getattr(self, name)[ticks] for name in ("values", "limits", "margins", "scale")})

    def nearest(self, time: Array) -> Nearest | None:
        """Return the tick of the largest share of the limit used; ``None`` if the limit never applied.

        Args:
            time: (n,) times of the ticks, s.
        """
        used = self.used
        used[~np.isfinite(used)] = -np.inf
        return self._at(int(np.argmax(used)), time) if used.max(initial=-np.inf) > -np.inf else None

    def smallest(self, time: Array) -> Nearest | None:
        """Return the tick of the smallest margin, as :meth:`nearest`; a value that is not a number is beyond all."""
        margins = np.where(np.isnan(self.margins), np.inf, self.margins)
        margins[np.isnan(self.values)] = -np.inf
        return self._at(int(np.argmin(margins)), time) if margins.min(initial=np.inf) < np.inf else None

    def _at(self, index: int, time: Array) -> Nearest:
        at = np.unravel_index(index, self.values.shape)
        value, limit, margin = float(self.values[at]), float(self.limits[at]), float(self.margins[at])
        margin = 0.0 if abs(margin) < _ROUNDING * max(1.0, abs(value), abs(limit)) else margin
        subject, used = self.subjects[int(at[1])], float(self.at(slice(at[0], at[0] + 1)).used[0, at[1]])
        return Nearest(self.name, subject, float(time[at[0]]), value, self.unit, limit, margin, used, self.judged)


def joint_power(log: RunLog) -> Array:
    """Return (n, nu) mechanical power of the drives on the joints, negative where they brake, W.

    The torque logged at a tick acted in the plant's last step before it, which began at a speed between those of the
    previous and of this tick: the smaller of the two powers is returned. It is 0 at ticks whose predecessor was missed.
    """
    power, gaps = np.zeros_like(log.tau), np.diff(log.time)
    before, after = log.tau[1:] * log.joint_velocity[:-1], log.tau[1:] * log.joint_velocity[1:]
    consecutive = gaps < 1.5 * gaps.min(initial=np.inf)
    np.minimum(before, after, out=power[1:])
    power[1:][~consecutive] = 0.0
    return power


def hardware_quantities(log: RunLog, joints: UnloggedLimits | None) -> Iterator[Limited]:
    """Yield torques and, with their limits, speeds, positions and mechanical powers of the joints."""
    names = tuple(log.joint_names.tolist())
    if not names:
        return
    yield highest("torque", "N.m", names, np.abs(log.tau), log.effort_limit_over_time)
    if joints is None:
        return
    yield highest("joint speed", "rad/s", names, np.abs(log.joint_velocity), joints.speed)
    angles = log.q[:, 7 if log.floating_base else 0 :]
    if angles.shape[1] == len(names):
        yield _positions(names, angles, joints)
    if joints.line is not None:
        yield highest("power", "W", names, joint_power(log), joints.line.power(log.effort_limit_over_time))


def limited_quantities(log: RunLog, gate: Gate, joints: UnloggedLimits | None = None) -> Iterator[Limited]:
    """Yield the quantities of a run with limits: joints, friction cones, capture point, attitude, gated figures.

    Args:
        log: log, finite throughout.
        gate: limits on tilt, displacement, height and slip; where it has none, those that define a fall.
        joints: limits of positions and speeds; without them these are left out.
    """
    yield from hardware_quantities(log, joints)
    feet = tuple(log.contact_frames.tolist())
    if feet:
        yield _friction(log, feet)
        slip, given = gate.max_slip_m, gate.max_slip_m is not None
        slid = 1e3 * log.of_feet(np.maximum, slide(log))
        yield highest("slip", "mm", tuple(log.feet), slid, 1e3 * (_SLID_M if slip is None else slip), given)
    if feet and np.isfinite(log.mass_kg):
        margin = 1e3 * capture_margin(log)[:, None]
        # At rest the capture point is the centre of mass: the margin at the start is that of the nominal stance.
        scale = np.array(np.max(margin[np.isfinite(margin)][:1], initial=1.0))
        yield Limited("capture point", "mm", _WHOLE, margin, np.zeros(1), margin, scale)
    if log.floating_base:
        base, tilt = log.base_pose, gate.max_tilt_deg
        given = tilt is not None
        yield highest("tilt", "deg", _WHOLE, log.tilt_deg[:, None], FALL_TILT_DEG if tilt is None else tilt, given)
        height = 1e3 * log.base_height[:, None]
        fraction = max(gate.min_base_height_fraction or 0.0, FALL_HEIGHT_FRACTION)
        low = np.maximum(fraction * height[0], 1e3 * (gate.min_base_height_m or 0.0))
        given = gate.min_base_height_fraction is not None or gate.min_base_height_m is not None
        yield Limited("base height", "mm", _WHOLE, height, low, height - low, height[0] - low, given)
        if gate.max_displacement_m is not None:
            home = log.base_reference[:, :3] if log.commanded else base[:1, :3]
            moved = 1e3 * np.linalg.norm(base[:, :3] - home, axis=1)[:, None]
            yield highest("displacement", "mm", _WHOLE, moved, 1e3 * gate.max_displacement_m, True)


def gate_figures(metrics: Metrics, gate: Gate) -> Iterator[Nearest]:
    """Yield the margins of the gate's limits on figures of the whole run: final errors, RMS values, fractions."""
    for key, limit in gate.limits.items():
        value = measured(metrics, key)
        if key not in _OVER_TIME and value is not None and not (limit == 0.0 and value == 0.0):
            yield figure_margin(key, value, limit)


def figure_margin(key: str, value: float, limit: float) -> Nearest:
    """Return the margin of a gate's limit: ``max_`` or ``min_`` and a figure's name, and the figure's value."""
    highest = key.startswith("max_")
    words, unit, scale = figure_words(figure_of(key), value, limit)
    over, under = (value, limit) if highest else (limit, value)
    if under > 0.0:
        used = over / under
    else:  # a negative lower limit is used in proportion to a negative value
        used = value / limit if limit < 0.0 else math.inf
    margin = scale * (limit - value if highest else value - limit)
    return Nearest(words, "", None, scale * value, unit, scale * limit, margin, used, judged=True)


def highest(
    name: str, unit: str, subjects: tuple[str, ...], values: Array, limit: Array | float, judged: bool = False
) -> Limited:
    """Return a quantity with an upper limit; arguments as the attributes of :class:`Limited`."""
    limits = np.asarray(limit, dtype=np.float64)
    return Limited(name, unit, subjects, values, limits, limits - values, limits, judged)


def _positions(names: tuple[str, ...], angles: Array, joints: UnloggedLimits) -> Limited:
    below, margins = angles - joints.lower, joints.upper - angles
    limits = np.where(below < margins, joints.lower, joints.upper)
    np.minimum(below, margins, out=margins)
    del below
    margins[np.isinf(margins)] = np.nan
    return Limited("joint position", "rad", names, angles, limits, margins, 0.5 * (joints.upper - joints.lower))


def _friction(log: RunLog, feet: tuple[str, ...]) -> Limited:
    """Return the tangential forces of loaded feet with the limits of their friction cones; NaN margins of others."""
    normal, tangential, limit = log.normal_forces, log.tangential_forces, log.friction_limits
    weight = log.weight_n if np.isfinite(log.mass_kg) else float(np.median(normal.sum(axis=1)))
    loaded = normal > max(_LOADED * weight, CONTACT_FORCE_N)
    return Limited("friction", "N", feet, tangential, limit, np.where(loaded, limit - tangential, np.nan), limit)


def capture_margin(log: RunLog) -> Array:
    """Return the (n,) distance of the capture point from the edge of the support, m; negative outside.

    The support is the convex hull of the feet that touch the ground and of the footholds of those that swing. NaN in
    flight, where the mass was not recorded, and while the robot lies, rises or lies down: its body may carry it.
    """
    swinging = (log.stance == 0)[:, log.foot_of]
    points = np.where(swinging[:, :, None], log.footholds[:, :, :2], log.contact_points[:, :, :2])
    height = np.maximum(log.above_ground(log.com) / log.ground_normal[:, 2], _LOWEST)
    place = capture_point(log.com, log.momentum / log.mass_kg, height)
    margin = support_margin(points, log.closed | swinging, place)
    margin[np.isin(log.mode, [MODES.index(mode) for mode in LOW_MODES])] = np.nan
    return margin
