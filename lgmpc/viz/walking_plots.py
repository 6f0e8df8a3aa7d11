"""Figures of a walking run: velocity against command, the gait diagram, the heights of the feet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lgmpc.runs import RunLog, push_intervals
from lgmpc.runs.intervals import intervals
from lgmpc.runs.log import CONTACT_STATES
from lgmpc.runs.walking import body_velocity, stride_mean
from lgmpc.typing import BoolArray
from lgmpc.viz.figure_files import legend_above
from lgmpc.viz.series import finish, label_pushes
from lgmpc.viz.style import EXTRA, INK, LIMIT, SOFT, X, Y, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_contact_rows", "draw_feet", "draw_gait", "draw_velocity"]

_DETAIL_STRIDES = 6.0
"""Number of gait cycles in the detailed views."""

_STATE_COLORS = {"stance": X, "early": Z, "late": Y, "missing": EXTRA, "lost": LIMIT}
"""Colours of the contact states in the gait diagram; swings are blank."""


def draw_velocity(figure: Figure, log: RunLog) -> bool:
    """Draw velocity and yaw rate: the command, the mean over each gait cycle, and the instantaneous value."""
    if log.command is None or log.gait_period_s is None or not log.commanded:
        return False
    figure.set_size_inches(9.6, 6.4)
    rows = figure.subplots(3, 1, sharex=True)
    velocity, dt = body_velocity(log), float(np.median(np.diff(log.time)))
    window = max(1, min(round(float(log.gait_period_s.min()) / dt), log.ticks))
    mean = stride_mean(velocity, window)
    middle = log.time[: len(mean)] + 0.5 * (window - 1) * dt
    labels = (("Velocity ahead", "m/s", X), ("Velocity to the left", "m/s", Y), ("Yaw rate", "rad/s", Z))
    for column, (axes, (title, unit, color)) in enumerate(zip(rows, labels, strict=True)):
        axes.plot(log.time, velocity[:, column], color=color, lw=0.6, alpha=0.45, label="instantaneous")
        axes.plot(middle, mean[:, column], color=color, label="mean over a gait cycle")
        axes.plot(log.time, log.command[:, column], color=INK, lw=1.0, ls="--", label="limited command")
        axes.set(title=title, ylabel=unit)
        finish(log, axes, span=0.1)
    rows[-1].set_xlabel("time, s")
    label_pushes(log, rows[:1])
    legend_above(rows[0])
    return True


def draw_gait(figure: Figure, log: RunLog) -> bool:
    """Draw a bar for each stance of each foot, coloured by its contact state, above the measured contact."""
    if log.contact_states is None or log.ticks < 2 or not log.stepped:
        return False
    figure.set_size_inches(9.6, 1.6 + 0.62 * len(log.contact_frames) * 2)
    whole, detail = figure.subplots(2, 1)
    for axes in (whole, detail):
        draw_contact_rows(axes, log)
        finish(log, axes)
    whole.set_title("Stances, and below each the measured contact")
    detail.set(title="Detail", xlabel="time, s", xlim=_detail(log))
    legend_above(whole)
    return True


def draw_feet(figure: Figure, log: RunLog) -> bool:
    """Draw the height above ground of each foot's contact point and of its target, for some gait cycles."""
    if log.swing_targets is None or log.ticks < 2 or not log.stepped:
        return False
    feet = log.contact_frames.tolist()
    figure.set_size_inches(9.6, 1.0 + 1.4 * len(feet))
    rows = figure.subplots(len(feet), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    begin, end = _detail(log)
    shown = (log.time >= begin) & (log.time <= end)
    time, height = log.time[shown], log.contact_clearance[shown]
    rise = np.einsum("nki,nki->nk", log.swing_targets[shown] - log.contact_points[shown], log.contact_normals[shown])
    for k, (axes, name) in enumerate(zip(rows, feet, strict=True)):
        axes.plot(time, 1e3 * (height + rise)[:, k], color=INK, lw=1.0, ls="--", label="target")
        axes.plot(time, 1e3 * height[:, k], color=X, label="contact point")
        touching = log.closed[shown, k]
        axes.fill_between(time, 0.0, 1.0, touching, transform=axes.get_xaxis_transform(), color=SOFT, alpha=0.15, lw=0)
        axes.set_ylabel(f"{name}, mm")
        finish(log, axes, span=10.0)
        axes.set_xlim(begin, end)
    rows[0].set_title("Height of the feet, shaded during contact")
    rows[-1].set_xlabel("time, s")
    legend_above(rows[0])
    return True


def _detail(log: RunLog) -> tuple[float, float]:
    """Return an interval of some gait cycles: from before the first push while stepping, or from the first swing."""
    assert log.stance is not None and log.gait_period_s is not None
    lifted = np.flatnonzero(~log.stance.all(axis=1))
    stride = float(log.gait_period_s[lifted[0]])
    begin = float(log.time[lifted[0]])
    pushes = [push.start for push in push_intervals(log) if push.start > begin]
    begin = max(float(log.time[0]), (pushes[0] if pushes else begin) - stride)
    return begin, min(begin + _DETAIL_STRIDES * stride, float(log.time[-1]))


def draw_contact_rows(axes: Axes, log: RunLog) -> None:
    """Draw a row for each foot: bars coloured by its contact state, if recorded, above the measured contact."""
    feet = log.contact_frames.tolist()
    touching = log.closed
    states = np.full(touching.shape, -1) if log.contact_states is None else log.contact_states
    for k in range(len(feet)):
        row = len(feet) - 1 - k
        for name, color in _STATE_COLORS.items():
            flags: BoolArray = states == CONTACT_STATES.index(name)
            label = name if k == 0 and flags.any() else None
            axes.broken_barh(_stretches(log, flags[:, k]), (row - 0.22, 0.56), facecolors=color, label=label)
        axes.broken_barh(_stretches(log, touching[:, k]), (row - 0.4, 0.12), facecolors=SOFT)
    axes.set_yticks(range(len(feet)), feet[::-1])
    axes.set_ylim(-0.6, len(feet) - 0.4)
    axes.grid(visible=False, axis="y")


def _stretches(log: RunLog, flags: BoolArray) -> list[tuple[float, float]]:
    """Return start and duration of the intervals of ticks with a flag, s."""
    times = np.append(log.time, log.time[-1] + np.median(np.diff(log.time)))
    return [(float(times[a]), float(times[b] - times[a])) for a, b in intervals(flags)]
