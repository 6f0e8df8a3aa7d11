"""The certificate of a run: physics and hardware limits, checked on the simulated motion, not on its estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from lgmpc.runs.atomic import json_values
from lgmpc.runs.limited import DriveLine, JointLimits, hardware_quantities, joint_power
from lgmpc.runs.log import CONTACT_FORCE_N, MODES, RunLog
from lgmpc.runs.modes import LOW_MODES, fallen_ticks
from lgmpc.typing import Array, IntArray

__all__ = ["Balances", "Certificate", "Check", "Peak", "certify", "window_edges"]

WINDOW_S = 0.05
"""Balances are those of impulses and works over windows of this length."""
_FORCE_SHARE, _ENERGY_SHARE = 0.02, 0.01
"""Allowed residuals: share of the weight, and of the weight times the largest height of the base. The integration error
is 0.2 % of the weight in a trot and 1.2 % in fast recovery steps with a step of 1 ms, half of that with 0.5 ms."""
_SUNK_M = 0.005
"""Allowed penetration of soft ground by a foot, m."""
_ROUNDING = 1e-9
_LYING = (*LOW_MODES, "damp")
"""Modes in which the body may lie on the ground; the contact force on the body is not measured."""


@dataclass(frozen=True)
class Check:
    """One row of a certificate: the tick at which a quantity came nearest to its limit.

    Attributes:
        name: name of the quantity.
        subject: joint or foot; empty for a quantity of the robot.
        time_s: time of the tick, s.
        value: value at this time.
        limit: limit of the value.
        margin: distance from the limit, negative beyond it.
        unit: unit of value, limit and margin.
        kept: whether the limit was kept throughout, up to rounding.
    """

    name: str
    subject: str
    time_s: float
    value: float
    limit: float
    margin: float
    unit: str
    kept: bool

    def __str__(self) -> str:
        where = f" of {self.subject}" if self.subject else ""
        value, limit = f"{self.value:.3g} {self.unit}", f"{self.limit:.3g} {self.unit}"
        return f"{self.name}{where}: {value} at {self.time_s:.3f} s, limit {limit}"


@dataclass(frozen=True)
class Peak:
    """The largest value of a quantity without a limit: measured, not certified.

    Attributes:
        name: name of the quantity.
        subject: joint or foot; empty for a quantity of the robot.
        time_s: time of the largest value, s.
        value: the largest value.
        unit: unit of the value.
    """

    name: str
    subject: str
    time_s: float
    value: float
    unit: str

    def __str__(self) -> str:
        where = f" of {self.subject}" if self.subject else ""
        return f"{self.name}{where}: {self.value:.3g} {self.unit} at {self.time_s:.3f} s"


@dataclass(frozen=True)
class Certificate:
    """The checks of a run, up to its first fall.

    Attributes:
        checks: in order of display; without those for which the log has no data.
        peaks: largest values of the quantities for which the config has no limit.
    """

    checks: tuple[Check, ...]
    peaks: tuple[Peak, ...] = ()

    @property
    def certified(self) -> bool:
        """Whether every limit was kept."""
        return all(each.kept for each in self.checks)

    @property
    def broken(self) -> tuple[Check, ...]:
        """The checks whose limit was not kept."""
        return tuple(each for each in self.checks if not each.kept)

    def content(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        checks, peaks = (json_values([asdict(each) for each in rows]) for rows in (self.checks, self.peaks))
        return {"certified": self.certified, "checks": checks, "without_limit": peaks}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Certificate:
        """Return the certificate from plain values, as returned by :meth:`content`.

        Raises:
            KeyError, TypeError, ValueError: an entry is missing or has another type.
        """
        checks = (_read(row, Check) for row in content["checks"])
        peaks = (_read(row, Peak) for row in content.get("without_limit", ()))  # not in older files
        return cls(tuple(Check(**row) for row in checks), tuple(Peak(**row) for row in peaks))


@dataclass(frozen=True)
class Balances:
    """Momentum and energy of the simulated robot at the edges of windows.

    Attributes:
        ticks: (k,) ticks of the edges.
        momentum: (k, 3) linear, N.s, world axes.
        energy: (k,) kinetic and potential, J.
        weight: (3,) of the simulated robot, N, world axes.
    """

    ticks: IntArray
    momentum: Array
    energy: Array
    weight: Array


def window_edges(log: RunLog) -> IntArray:
    """Return (k,) the ticks at which a certificate needs momentum and energy."""
    return np.arange(0, log.ticks, max(1, round(WINDOW_S / log.control_period_s)))


def certify(log: RunLog, joints: JointLimits, balances: Balances | None = None) -> Certificate:
    """Check a run, up to its first fall.

    Normal forces are positive, contact forces in their friction cones, penetrations of the ground small; joints stay
    within their limits of torque, speed and position; with a torque-speed line, torques are on or below it and powers
    below the largest that it allows; the change of momentum is the impulse of all forces, and that of energy at most
    their work. Forces on other parts of the body than the feet are not measured: a knee that strikes the ground changes
    the momentum without an impulse. Power is the mechanical output of the drives: a config has no data on currents and
    losses.

    Args:
        log: log at the full control rate; finite throughout.
        joints: limits of the joints.
        balances: momentum and energy; without them these are not checked. They require a log of every force: one plant
            step per tick.
    """
    if log.floating_base:
        fallen = fallen_ticks(log)
        if fallen.any():
            log = log.until(int(np.argmax(fallen)))
    if log.ticks < 2:
        return Certificate(())
    return Certificate(tuple(_checks(log, joints, balances)), tuple(_peaks(log, joints)))


def _checks(log: RunLog, joints: JointLimits, balances: Balances | None) -> Iterator[Check]:
    feet = tuple(log.contact_frames.tolist())
    if feet:
        normal, tangential, limit = log.normal_forces, log.tangential_forces, log.friction_limits
        yield _smallest("normal force", feet, log.time, normal, 0.0, normal, "N")
        opened = normal <= CONTACT_FORCE_N  # a force that is not a number is not
        if not opened.all():
            margin = np.where(opened, np.inf, limit - tangential)
            yield _smallest("friction", feet, log.time, tangential, limit, margin, "N")
        depth = -1e3 * log.contact_clearance
        yield _smallest("floor penetration", feet, log.time, depth, 1e3 * _SUNK_M, 1e3 * _SUNK_M - depth, "mm")
    for each in hardware_quantities(log, joints):
        margin = np.where(np.isfinite(each.margins), each.margins, np.inf)
        if np.isfinite(margin).any():
            yield _smallest(each.name, each.subjects, log.time, each.values, each.limits, margin, each.unit)
    if joints.line is not None and log.joint_names.size:
        yield _on_line(log, joints.line)
    if balances is not None:
        yield from _balanced(log, balances)


def _on_line(log: RunLog, line: DriveLine) -> Check:
    """Return the check of the torques against the torque-speed line at the joints' driving speeds."""
    torque = np.abs(log.tau)
    driving = np.maximum(joint_power(log), 0.0) / np.where(torque > 0.0, torque, 1.0)
    available = line.torque(driving)
    names = tuple(log.joint_names.tolist())
    return _smallest("torque at its speed", names, log.time, torque, available, available - torque, "N.m")


def _peaks(log: RunLog, joints: JointLimits) -> Iterator[Peak]:
    """Yield the largest powers that have no limit: of a joint without a torque-speed line, and of all joints."""
    names = tuple(log.joint_names.tolist())
    if not names:
        return
    power = joint_power(log)
    if joints.line is None:
        tick, joint = np.unravel_index(int(np.argmax(power)), power.shape)
        yield Peak("power", names[int(joint)], float(log.time[tick]), float(power[tick, joint]), "W")
    total = np.maximum(power, 0.0).sum(axis=1)  # no regeneration: braking joints do not supply others
    tick = np.argmax(total)
    yield Peak("total power", "", float(log.time[tick]), float(total[tick]), "W")


def _smallest(
    name: str, subjects: tuple[str, ...], time: Array, values: Array, limits: Array | float, margins: Array, unit: str
) -> Check:
    """Return the check of the smallest of (n, k) margins; NaN counts as smaller than any number."""
    margins = np.where(np.isnan(margins), -np.inf, margins)
    tick, subject = np.unravel_index(int(np.argmin(margins)), margins.shape)
    at = (int(tick), int(subject))
    limit = float(np.broadcast_to(limits, margins.shape)[at])
    value, margin = float(values[at]), float(margins[at])
    rounding = _ROUNDING * max(1.0, abs(value), abs(limit))
    margin = 0.0 if abs(margin) < rounding else margin
    return Check(name, subjects[at[1]], float(time[at[0]]), value, limit, margin, unit, margin >= 0.0)


def _balanced(log: RunLog, balances: Balances) -> Iterator[Check]:
    """Yield the checks of momentum and energy: their changes over windows against impulses and works."""
    inside = balances.ticks < log.ticks
    edges = balances.ticks[inside]
    low = np.zeros(log.ticks, dtype=bool)
    if log.mode is not None:
        low = np.isin(log.mode, [MODES.index(mode) for mode in _LYING])
    count = np.concatenate(([0], np.cumsum(low)))
    used = count[edges[1:] + 1] == count[edges[:-1]]
    if not used.any():
        return
    dt = log.control_period_s
    lasts = dt * np.diff(edges)
    weight = float(np.linalg.norm(balances.weight))
    # What is logged at a tick acted in the step before; a push acts in the step after.
    forces = log.contact_forces[1:].sum(axis=1) + log.push[:-1, :3] + balances.weight
    change = np.diff(balances.momentum[inside], axis=0) - np.diff(_integral(dt * forces)[edges], axis=0)
    residual = np.where(used, np.linalg.norm(change, axis=1) / lasts, 0.0)[:, None]
    limit = _FORCE_SHARE * weight
    yield _smallest("momentum balance", ("",), log.time[edges[1:]], residual, limit, limit - residual, "N")
    speeds = 0.5 * (log.joint_velocity[1:] + log.joint_velocity[:-1])
    work = dt * (log.tau[1:] * speeds).sum(axis=1) + _push_work(log)
    gain = np.where(used, np.diff(balances.energy[inside]) - np.diff(_integral(work)[edges]), 0.0)[:, None]
    allowed = _ENERGY_SHARE * weight * float(log.base_height.max())
    yield _smallest("energy balance", ("",), log.time[edges[1:]], gain, allowed, allowed - gain, "J")


def _push_work(log: RunLog) -> Array:
    """Return (n - 1,) work of the push in each step, J.

    In its last step the point of application is extrapolated: its displacement is that of the step before.
    """
    pushed = np.any(log.push[:, :3] != 0.0, axis=1)
    moved = np.diff(log.push_point, axis=0)
    last = np.flatnonzero(pushed[:-1] & ~pushed[1:])
    moved[last] = moved[np.maximum(last - 1, 0)]
    work: Array = np.where(pushed[:-1], (moved * log.push[:-1, :3]).sum(axis=1), 0.0)
    return work


def _integral(steps: Array) -> Array:
    """Return (n, ...) the sums of (n - 1, ...) steps up to each tick."""
    return np.concatenate((np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)))


def _read(row: Mapping[str, Any], kind: type[Check | Peak]) -> dict[str, Any]:
    """Return the values of a row by field."""
    kinds = {"name": str, "subject": str, "unit": str, "kept": bool}
    return {each.name: kinds.get(each.name, _number)(row[each.name]) for each in fields(kind)}


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
