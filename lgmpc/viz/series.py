"""Drawings over time of runs and trajectories: vectors, forces and friction, joints and limits; pushes, modes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lgmpc.runs import RunLog, push_intervals
from lgmpc.runs.log import MODES
from lgmpc.typing import Array, IntArray
from lgmpc.viz.figure_files import EXTRA, LIMIT, PUSH, SOFT, X, Y, Z, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MODE_COLORS = {"lie": SOFT, "rise": Z, "locomote": X, "recover": Y, "sit": EXTRA, "damp": LIMIT}
"""Colours of the modes; standing has none."""

_NARROWEST = 0.035
"""Share of the time axis above which an interval of a mode is labelled."""

_LABEL_BAND = 0.16
"""Fraction of an axes' height reserved for the pushes' labels."""


def stacked(figure: Figure, size: tuple[float, float], *headings: tuple[str, str]) -> NDArray[Any]:
    """Return axes over the same time, one below the other.

    Args:
        figure: empty figure.
        size: width and height, inches.
        headings: title and label of the vertical axis of each.
    """
    figure.set_size_inches(*size)
    rows: NDArray[Any] = figure.subplots(len(headings), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (title, label) in zip(rows, headings, strict=True):
        axes.set(title=title, ylabel=label)
    rows[-1].set_xlabel("time, s")
    return rows


def draw_xyz(axes: Axes, time: Array, values: Array, names: Sequence[str] = ("x", "y", "z"), **style: Any) -> None:
    """Draw the components of vectors (n, 3), or the first two."""
    for component, color, name in zip(values.T, (X, Y, Z), names, strict=False):
        axes.plot(time, component, color=color, label=name, **style)


def draw_forces(
    figure: Figure,
    names: Sequence[str],
    time: Array,
    normal: Array,
    tangential: Array,
    limit: Array | None,
    friction: str,
    *,
    planned: Array | None = None,
    steps: bool = False,
) -> NDArray[Any]:
    """Draw each contact's normal force, and its tangential one over the friction limit.

    Args:
        figure: empty figure.
        names: of the nc contacts.
        time: (n,) s.
        normal: (n, nc) normal forces, N.
        tangential: (n, nc) norms of the tangential forces, N.
        limit: (n, nc) friction limits, N; ``None`` if there are none.
        friction: coefficients in words.
        planned: (n, nc) planned normal forces, N.
        steps: whether forces are constant until the next time.

    Returns:
        (nc, 2) the axes.
    """
    figure.set_size_inches(9.6, 1.0 + 1.7 * len(names))
    rows: NDArray[Any] = figure.subplots(len(names), 2, sharex=True, sharey="col", squeeze=False)
    style = _drawn(steps)
    for k, (name, (left, right)) in enumerate(zip(names, rows, strict=True)):
        if planned is not None:
            left.plot(time, planned[:, k], color=EXTRA, lw=1.0, label="planned", **style)
        left.plot(time, normal[:, k], color=X, label="measured" if planned is not None else "normal force", **style)
        left.set_ylabel(f"{name}, N")
        if limit is not None:
            at = _extremes(limit[:, k])
            post = "post" if steps else None
            right.fill_between(time[at], 0.0, limit[at, k], color=Z, alpha=0.18, lw=0.0, step=post)
            right.plot(time, limit[:, k], color=Z, lw=1.0, label=f"{friction} × normal force", **style)
        right.plot(time, tangential[:, k], color=LIMIT, label="tangential force", **style)
    rows[0, 0].set_title("Normal force")
    rows[0, 1].set_title("Friction")
    for axes in rows[-1]:
        axes.set_xlabel("time, s")
    legend_above(*rows[0])
    return rows


class JointValues(NamedTuple):
    """A quantity of the joints over time.

    Attributes:
        title: its name.
        unit: unit of values and limits; empty for fractions of a limit.
        values: (n, nu) values.
        lower: (n, nu) lower limits, or an array that is broadcast; not finite where there are none.
        upper: (n, nu) upper limits.
    """

    title: str
    unit: str
    values: Array
    lower: Array | float = -np.inf
    upper: Array | float = np.inf


def draw_joints(
    figure: Figure, names: Sequence[str], time: Array, *columns: JointValues, steps: bool = False
) -> NDArray[Any]:
    """Draw quantities of joints, side by side: a row for each kind of joint that all legs have, else one for all.

    Quantities with limits are drawn as fractions of them if joints of several kinds share the axes.

    Args:
        figure: empty figure.
        names: of the nu joints.
        time: (n,) s.
        columns: the quantities.
        steps: whether values are constant until the next time.

    Returns:
        (k, columns) the axes.
    """
    kinds = _joint_kinds(names)
    rows: dict[str, list[int]] = kinds or {"": list(range(len(names)))}
    figure.set_size_inches(8.0 if len(columns) == 1 else 9.6, 1.2 + (1.7 if kinds else 3.0) * len(rows))
    grid: NDArray[Any] = figure.subplots(len(rows), len(columns), sharex=True, squeeze=False)
    for place, (title, unit, values, *limits) in enumerate(columns):
        lower, upper = (np.broadcast_to(each, values.shape) for each in limits)
        known = bool(np.isfinite(lower).all() and np.isfinite(upper).all())
        share = known and not kinds
        scale = np.maximum(np.abs(lower), np.abs(upper)) if share else np.ones_like(values)
        for axes, (kind, joints) in zip(grid[:, place], rows.items(), strict=True):
            for count, joint in enumerate(joints):
                label = names[joint].partition("_")[0] if kinds else names[joint]
                style = {"color": (X, Y, Z, EXTRA)[count % 4], "ls": ("-", "--", ":", "-.")[count // 4 % 4]}
                curve = values[:, joint] / scale[:, joint]
                axes.plot(time, curve, **style, **_drawn(steps), lw=1.1, label=label)
            if known:
                ends = np.stack((lower[:, joints] / scale[:, joints], upper[:, joints] / scale[:, joints]))
                for low, high in np.unique(ends, axis=2).transpose(2, 0, 1):
                    _draw_limits(axes, time, low, high, f" {{:g}} {unit}" if unit and not share else "")
            axes.set_ylabel("fraction of the limit" if share or not unit else unit)
            axes.set_title(f"{title}{kind and ', '}{kind}")
    for axes in grid[-1]:
        axes.set_xlabel("time, s")
    count = len(next(iter(rows.values())))
    if count <= 4:
        legend_above(grid[0, -1])
    elif count <= 24:  # no legend for a crowd
        grid[0, -1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, handlelength=2.0)
    return grid


def _joint_kinds(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the indices of the joints of each kind that all legs have (``FL_HFE``: kind ``HFE``), if any."""
    kinds: dict[str, list[int]] = {}
    for joint, name in enumerate(names):
        kinds.setdefault(name.partition("_")[2], []).append(joint)
    alike = len(kinds) <= 4 and "" not in kinds and all(2 <= len(joints) <= 8 for joints in kinds.values())
    return kinds if alike else {}


def _extremes(values: Array, bins: int = 1500) -> IntArray:
    """Return the (m,) ticks of the least and the greatest of (n,) values in each of ``bins`` parts, all if n is small.

    Areas, unlike lines, are not simplified by matplotlib.
    """
    if len(values) <= 4 * bins:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), bins + 1).astype(np.int64)
    filled = np.nan_to_num(values, nan=0.0)
    found = [(a + np.argmin(filled[a:b]), a + np.argmax(filled[a:b])) for a, b in zip(edges, edges[1:], strict=False)]
    return np.unique(np.concatenate(([0], np.array(found).ravel(), [len(values) - 1])))


def _drawn(steps: bool) -> dict[str, str]:
    return {"drawstyle": "steps-post"} if steps else {}


def _draw_limits(axes: Axes, time: Array, low: Array, high: Array, figure: str) -> None:
    """Draw limits (n,), with a label below the upper one; where they change, below each of its values."""
    style: dict[str, Any] = {"textcoords": "offset points", "va": "top", "fontsize": 8.5, "color": LIMIT}
    constant = bool((low == low[0]).all() and (high == high[0]).all())
    for side in (low, high):
        if constant:
            axes.axhline(float(side[0]), color=LIMIT, ls="--", lw=1.1)
        else:
            axes.plot(time, side, color=LIMIT, ls="--", lw=1.1, drawstyle="steps-post")
    if constant:
        place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "ha": "right"}
        axes.annotate("limit" + figure.format(high[0]), (0.995, float(high[0])), (0, -3), **place, **style)
        return
    for each in np.flatnonzero(np.diff(high, prepend=np.nan)):
        axes.annotate("limit" + figure.format(high[each]), (time[each], high[each]), (3, -3), **style)


def finish(log: RunLog, *all_axes: Axes, span: float = 0.0) -> None:
    """Shade the pushes, fit the time axis, and extend the vertical one to ``span`` at least."""
    for axes in all_axes:
        for push in push_intervals(log):
            axes.axvspan(push.start, push.end, color=PUSH, alpha=0.15, lw=0.0, zorder=0)
        axes.set_xlim(float(log.time[0]), float(log.time[-1]))
        low, high = axes.get_ylim()
        if high - low < span:
            axes.set_ylim(0.5 * (low + high - span), 0.5 * (low + high + span))


def label_pushes(log: RunLog, all_axes: Iterable[Axes]) -> None:
    """Label each push with its impulse in a band above the curves and limits, unless there are too many."""
    pushes = push_intervals(log)
    for axes in all_axes if 0 < len(pushes) <= 8 else ():
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + _LABEL_BAND / (1.0 - _LABEL_BAND) * (high - low))
        for push in pushes:
            text = f"{np.linalg.norm(push.impulse):.2g} N.s"
            where = (0.5 * (push.start + push.end), 0.98)
            axes.annotate(
                text, where, xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8, color=PUSH
            )


def friction_words(log: RunLog) -> str:
    """Return the coefficients of the ground in the order of their times: ``0.6, then 0.3``; or ``0.2 to 0.6``."""
    if log.contact_friction is not None:
        return f"{log.contact_friction.min():g} to {log.contact_friction.max():g}"
    floor = log.friction_over_time
    changed = np.flatnonzero(np.diff(floor, prepend=np.nan))
    return ", then ".join(f"{each:g}" for each in (floor[changed] if len(floor) else [log.friction]))


def label_modes(log: RunLog, axes: Axes) -> None:
    """Draw a band of the modes along the lower edge, unless the robot only stood."""
    if bool((log.mode == MODES.index("stand")).all()):
        return
    edges = np.concatenate(([0], np.flatnonzero(np.diff(log.mode)) + 1, [log.ticks])).tolist()
    times = np.append(log.time, log.time[-1] + np.median(np.diff(log.time)))
    for a, b in zip(edges, edges[1:], strict=False):
        name = dict(enumerate(MODES)).get(int(log.mode[a]), "")
        if name in _MODE_COLORS:
            axes.axvspan(times[a], times[b], 0.0, 0.09, color=_MODE_COLORS[name], alpha=0.35, lw=0.0, zorder=0)
        if times[b] - times[a] > _NARROWEST * (times[-1] - times[0]):
            where = (0.5 * (times[a] + times[b]), 0.045)
            axes.annotate(name, where, xycoords=("data", "axes fraction"), ha="center", va="center", fontsize=7)
