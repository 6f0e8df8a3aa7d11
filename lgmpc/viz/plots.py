"""Figures of a run, as PNG files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lgmpc.errors import InputError, MissingDependencyError, RunFolderError
from lgmpc.runs import Run, RunLog, atomic_write, push_intervals
from lgmpc.runs.atomic import reason_of
from lgmpc.runs.metrics import tilt_deg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FIGURES", "plot_run"]

_X, _Y, _Z = "#0072B2", "#E69F00", "#009E73"  # Okabe and Ito: told apart by colour-blind eyes too
_LIMIT, _PUSH, _EXTRA = "#D55E00", "#D55E00", "#CC79A7"
_INK, _SOFT = "#1d2733", "#5b6877"

_STYLE = {
    "figure.dpi": 130,
    "figure.facecolor": "white",
    "font.size": 10,
    "text.color": _INK,
    "axes.edgecolor": "#b9c2cc",
    "axes.labelcolor": _INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6eaee",
    "xtick.color": _SOFT,
    "ytick.color": _SOFT,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


def plot_run(run: Run, out_dir: Path | str | None = None) -> tuple[Path, ...]:
    """Draw the figures of a run: base, centre of mass, contact forces, torques, timing.

    Args:
        run: the run folder, read.
        out_dir: where the PNG files go; the run folder's ``figures/`` if not given.

    Returns:
        Paths of the files, one for each figure that the run has data for.

    Raises:
        InputError: if the log has no tick.
        RunFolderError: if the folder cannot be written.
        MissingDependencyError: if matplotlib is not installed.
    """
    if run.log.ticks < 2:
        raise InputError("run", f"{run.path} with {run.log.ticks} ticks", "a run with something to draw")
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("matplotlib", "lgmpc plot", "pip install matplotlib") from error
    folder = Path(out_dir) if out_dir is not None else run.path / "figures"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make {folder}: {reason_of(error)}") from error
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, draw in FIGURES.items():
            figure = Figure(layout="constrained")
            FigureCanvasAgg(figure)
            if not draw(figure, run.log):
                continue
            figure.suptitle(_title(run), x=0.01, ha="left", fontsize=9, color=_SOFT)
            path = folder / f"{name}.png"
            with atomic_write(path) as file:
                figure.savefig(file, format="png")
            written.append(path)
    return tuple(written)


def _title(run: Run) -> str:
    result = run.result
    return (
        f"{result.name} · {result.verdict.outcome.value} · {result.created.replace('T', ' ').replace('+00:00', ' UTC')}"
    )


def _base(figure: Figure, log: RunLog) -> bool:
    figure.set_size_inches(8.0, 6.2)
    position, height, tilt = figure.subplots(3, 1, sharex=True)
    base = log.base_pose
    for axis, color, name in ((0, _X, "x (forward)"), (1, _Y, "y (left)")):
        position.plot(log.time, 1e3 * (base[:, axis] - base[0, axis]), color=color, label=name)
    height.plot(log.time, 1e3 * base[:, 2], color=_Z)
    tilt.plot(log.time, tilt_deg(base[:, 3:], log.base_reference[0, 3:]), color=_X)
    position.set(title="Base displacement", ylabel="mm")
    height.set(title="Base height", ylabel="mm")
    tilt.set(title="Base tilt from upright", ylabel="deg", xlabel="time, s", ylim=(0.0, None))
    _finish(log, position, height, tilt)
    _legend(position)
    return True


def _com(figure: Figure, log: RunLog) -> bool:
    figure.set_size_inches(9.6, 5.6)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.7, 1.0))
    first: Axes | None = None
    for axis, (color, name) in enumerate(((_X, "x"), (_Y, "y"), (_Z, "z"))):
        axes = figure.add_subplot(grid[axis, 0], sharex=first)
        first = first or axes
        axes.plot(log.time, 1e3 * log.com_reference[:, axis], color=_INK, lw=1.0, ls="--", label="target")
        axes.plot(log.time, 1e3 * log.com[:, axis], color=color, label="centre of mass")
        axes.set_ylabel(f"{name}, mm")
        _finish(log, axes)
    assert first is not None
    first.set_title("Centre of mass and its target")
    _legend(first)
    figure.axes[2].set_xlabel("time, s")
    above = figure.add_subplot(grid[:, 1])
    above.plot(1e3 * log.com_reference[:, 0], 1e3 * log.com_reference[:, 1], color=_INK, lw=1.0, ls="--", marker=".")
    above.plot(1e3 * log.com[:, 0], 1e3 * log.com[:, 1], color=_X)
    above.set(title="Seen from above", xlabel="x, mm", ylabel="y, mm")
    above.set_aspect("equal", adjustable="datalim")
    return True


def _forces(figure: Figure, log: RunLog) -> bool:
    """Each contact's tangential force, as a share of what friction holds, and its normal force."""
    contacts = len(log.contact_frames)
    if contacts == 0:
        return False
    figure.set_size_inches(9.6, 1.0 + 1.7 * contacts)
    rows = figure.subplots(contacts, 2, sharex=True, sharey="col", squeeze=False)
    for k, name in enumerate(log.contact_frames.tolist()):
        normal, tangential = log.contact_forces[:, k, 2], np.linalg.norm(log.contact_forces[:, k, :2], axis=1)
        left, right = rows[k]
        left.plot(log.time, log.contact_forces_desired[:, k, 2], color=_EXTRA, lw=1.0, label="planned")
        left.plot(log.time, normal, color=_X, label="measured")
        left.set_ylabel(f"{name}, N")
        right.fill_between(log.time, 0.0, log.friction * np.maximum(normal, 0.0), color=_Z, alpha=0.18, lw=0.0)
        right.plot(log.time, log.friction * np.maximum(normal, 0.0), color=_Z, lw=1.0, label="µ × normal force")
        right.plot(log.time, tangential, color=_LIMIT, label="tangential force")
        _finish(log, left, right)
    rows[0, 0].set_title("Normal force")
    rows[0, 1].set_title(f"Tangential force and the friction cone, µ = {log.friction:g}")
    for axes in rows[-1]:
        axes.set_xlabel("time, s")
    _legend(*rows[0])
    return True


def _torques(figure: Figure, log: RunLog) -> bool:
    """Torques as a share of their limits, in the rows that the joints form: every third joint of a leg, or all."""
    joints = log.tau.shape[1]
    if joints == 0:
        return False
    per_leg = joints // len(log.contact_frames) if len(log.contact_frames) else 0
    groups = per_leg if per_leg and per_leg * len(log.contact_frames) == joints and per_leg <= 4 else 1
    figure.set_size_inches(8.0, 1.2 + 1.7 * groups)
    rows = figure.subplots(groups, 1, sharex=True, squeeze=False)[:, 0]
    colors = (_X, _Y, _Z, _EXTRA)
    for group, axes in enumerate(rows):
        members = range(group, joints, groups)
        for count, joint in enumerate(members):
            named = groups > 1
            label = f"{log.contact_frames[count]}" if named else f"joint {joint + 1}"
            axes.plot(log.time, log.tau[:, joint], color=colors[count % 4], lw=1.1, label=label if group == 0 else None)
        limit = float(max(log.effort_limit[joint] for joint in members))
        for sign in (-1.0, 1.0):
            axes.axhline(sign * limit, color=_LIMIT, ls="--", lw=1.1)
        axes.annotate(f"limit {limit:g} N.m", (0.995, limit), xycoords=("axes fraction", "data"), color=_LIMIT,
                      ha="right", va="top", fontsize=8.5)  # fmt: skip
        axes.set_ylabel("N.m")
        axes.set_title(f"Torque of each leg's joint {group + 1}" if groups > 1 else "Joint torques")
        _finish(log, axes)
    rows[-1].set_xlabel("time, s")
    if joints // groups <= 8:
        _legend(rows[0])
    return True


def _timing(figure: Figure, log: RunLog) -> bool:
    parts = [
        (name, milliseconds, 1e3 * period, color)
        for name, milliseconds, period, color in (
            ("MPC update", log.mpc_ms, log.mpc_period_s, _X),
            ("Whole-body tick", log.wbc_ms, log.control_period_s, _Z),
        )
        if len(milliseconds)
    ]
    if not parts:
        return False
    figure.set_size_inches(4.4 * len(parts), 3.2)
    for axes, (name, milliseconds, period, color) in zip(
        figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True
    ):
        low, high = max(float(milliseconds.min()), 1e-4), max(float(milliseconds.max()), 1.1e-4)
        axes.hist(milliseconds, bins=np.geomspace(0.95 * low, 1.05 * high, 60), color=color, alpha=0.85)
        axes.set_xscale("log")
        if high > 0.2 * period:
            axes.axvline(period, color=_LIMIT, ls="--", lw=1.2, label=f"period {period:g} ms")
        p50, p99 = np.percentile(milliseconds, [50.0, 99.0])
        axes.axvline(float(p50), color=_INK, lw=1.2, label=f"median {p50:.3g} ms")
        axes.axvline(float(p99), color=_INK, lw=1.2, ls=":", label=f"99 % {p99:.3g} ms")
        axes.set(title=f"{name} (every {period:g} ms)", xlabel="duration, ms", ylabel="count")
        axes.legend(loc="upper right")
    return True


FIGURES: dict[str, Callable[[Figure, RunLog], bool]] = {
    "base": _base,
    "com": _com,
    "forces": _forces,
    "torques": _torques,
    "timing": _timing,
}
"""What :func:`plot_run` draws: file name without ``.png`` -> drawing, which returns whether there was data."""


def _finish(log: RunLog, *all_axes: Axes) -> None:
    """Shade the pushes and fit the time axis."""
    for axes in all_axes:
        for push in push_intervals(log):
            axes.axvspan(push.start, push.end, color=_PUSH, alpha=0.15, lw=0.0, zorder=0)
        axes.set_xlim(float(log.time[0]), float(log.time[-1]))
    pushes = push_intervals(log)
    for push in pushes if len(pushes) <= 8 else ():
        all_axes[0].annotate(
            f"{np.linalg.norm(push.impulse):.2g} N.s",
            (push.start, 1.0),
            xycoords=("data", "axes fraction"),
            va="bottom",
            fontsize=8,
            color=_PUSH,
        )


def _legend(*all_axes: Axes) -> None:
    for axes in all_axes:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1, handlelength=1.4)
