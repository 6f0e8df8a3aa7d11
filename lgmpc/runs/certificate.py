"""The certificate of a run: physics and hardware limits, checked on the simulated motion, not on its estimate."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lgmpc.runs.limited import Limited, Nearest, UnloggedLimits, hardware_quantities, highest, joint_power
from lgmpc.runs.log import CONTACT_FORCE_N, MODES, RunLog
from lgmpc.runs.metrics import LinkDistances
from lgmpc.runs.modes import LOW_MODES, fallen_ticks
from lgmpc.typing import Array, IntArray

WINDOW_S = 0.05
"""Balances are those of impulses and works over windows of this length."""
_FORCE_SHARE, _ENERGY_SHARE = 0.02, 0.01
"""Allowed residuals: share of the weight, and of the weight times the largest height of the base. The integration error
is 0.2 % of the weight in a trot and 1.2 % in fast recovery steps with a step of 1 ms, half of that with 0.5 ms."""
_SUNK_M = 0.005
"""Allowed penetration of hard ground by a foot, or of two links of the robot, m."""
_LYING = (*LOW_MODES, "damp")
"""Modes in which the body may lie on the ground; the contact force on the body is not measured."""


@dataclass(frozen=True)
class Certificate:
    """The checks of a run, up to its first fall.

    Attributes:
        checks: the smallest margins, in order of display; without those for which the log has no data.
    """

    checks: tuple[Nearest, ...]

    @property
    def certified(self) -> bool:
        """Whether every limit was kept."""
        return not self.broken

    @property
    def broken(self) -> tuple[Nearest, ...]:
        """The checks whose limit was not kept."""
        return tuple(each for each in self.checks if not each.kept)

    def content(self) -> dict[str, Any]:
        """Return it as plain values."""
        checks = [asdict(each) | {"kept": each.kept} for each in self.checks]
        return {"certified": self.certified, "checks": checks}


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


def certify(
    log: RunLog, joints: UnloggedLimits, balances: Balances | None = None, stiffness: float = math.inf,
    distances: LinkDistances | None = None,
) -> Certificate:  # fmt: skip
    """Check a run, up to its first fall.

    Normal forces are positive, contact forces in their friction cones, penetrations of the ground and overlaps of links
    small; joints stay within their limits of torque, speed and position; with a torque-speed line, torques are on or
    below it and powers below the largest that it allows; the change of momentum is the impulse of all forces, and that
    of energy at most their work. Forces on other parts of the body than the feet are not measured: a knee that strikes
    the ground changes the momentum without an impulse. Power is the mechanical output of the drives: a config has no
    data on currents and losses.

    Args:
        log: log at the full control rate; finite throughout.
        joints: limits of the joints.
        balances: momentum and energy; without them these are not checked. They require a log of every force: one plant
            step per tick.
        stiffness: of soft ground, N/m, in which feet sink by their force over it.
        distances: of links; while the robot lies its legs may be folded against each other.
    """
    if log.floating_base:
        fallen = fallen_ticks(log)
        if fallen.any():
            log = log.until(int(np.argmax(fallen)))
    if log.ticks < 2:
        return Certificate(())
    checks = [quantity.smallest(time) for quantity, time in _quantities(log, joints, balances, stiffness)]
    checks += [] if distances is None else [_overlap(log, distances)]
    return Certificate(tuple(each for each in checks if each is not None))


def _quantities(
    log: RunLog, joints: UnloggedLimits, balances: Balances | None, stiffness: float
) -> Iterator[tuple[Limited, Array]]:
    """Yield the checked quantities and the times of their values."""
    feet = tuple(log.contact_frames.tolist())
    if feet:
        normal, tangential, limit = log.normal_forces, log.tangential_forces, log.friction_limits
        weight = np.full((), log.weight_n)
        yield Limited("normal force", "N", feet, normal, np.zeros(()), normal, weight), log.time
        margin = np.where(normal <= CONTACT_FORCE_N, np.nan, limit - tangential)
        yield Limited("friction", "N", feet, tangential, limit, margin, limit), log.time
        sunk = _SUNK_M + float(normal.max(initial=0.0)) / stiffness
        yield highest("floor penetration", "mm", feet, -1e3 * log.contact_clearance, 1e3 * sunk), log.time
    for each in hardware_quantities(log, joints):
        yield each, log.time
    if joints.line is not None and log.joint_names.size:
        torque = np.abs(log.tau)
        driving = np.maximum(joint_power(log), 0.0) / np.where(torque > 0.0, torque, 1.0)
        names = tuple(log.joint_names.tolist())
        yield highest("torque at its speed", "N.m", names, torque, joints.line.torque(driving)), log.time
    if balances is not None:
        yield from _balanced(log, balances)


def _overlap(log: RunLog, distances: LinkDistances) -> Nearest | None:
    """Return the largest overlap of two links."""
    at = np.minimum(np.searchsorted(log.time, distances.time), log.ticks - 1)
    used = (log.time[at] == distances.time) & ~np.isin(log.mode[at], [MODES.index(mode) for mode in _LYING])
    depths = np.where(used, np.maximum(-1e3 * distances.least, 0.0), 0.0)
    subject = distances.links[int(np.argmax(depths))] if depths.any() else ""
    return highest("self-penetration", "mm", (subject,), depths[:, None], 1e3 * _SUNK_M).smallest(distances.time)


def _balanced(log: RunLog, balances: Balances) -> Iterator[tuple[Limited, Array]]:
    """Yield the residuals of momentum and energy: their changes over windows against impulses and works."""
    inside = balances.ticks < log.ticks
    edges = balances.ticks[inside]
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
    time = log.time[edges[1:]]
    yield highest("momentum balance", "N", ("",), residual, _FORCE_SHARE * weight), time
    speeds = 0.5 * (log.joint_velocity[1:] + log.joint_velocity[:-1])
    work = dt * (log.tau[1:] * speeds).sum(axis=1) + _push_work(log)
    gain = np.where(used, np.diff(balances.energy[inside]) - np.diff(_integral(work)[edges]), 0.0)[:, None]
    allowed = _ENERGY_SHARE * weight * float(log.base_height.max())
    yield highest("energy balance", "J", ("",), gain, allowed), time


def _push_work(log: RunLog) -> Array:
    """Return (n - 1,) work of the push in each step, J.

    In its last step the point of application is extrapolated: its displacement is that of the step before.
    """
    pushed = np.any(log.push[:, :3] != 0.0, axis=1)
    moved = np.diff(log.push_point, axis=0)
    last = np.flatnonzero(pushed[:-1] & ~pushed[1:])
    moved[last] = moved[np.maximum(last - 1, 0)]
    return np.where(pushed[:-1], (moved * log.push[:-1, :3]).sum(axis=1), 0.0)


def _integral(steps: Array) -> Array:
    """Return (n, ...) the sums of (n - 1, ...) steps up to each tick."""
    return np.concatenate((np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)))
