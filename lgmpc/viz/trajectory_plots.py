"""Figures of a solved trajectory."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog
from lgmpc.runs.log import tilt_deg
from lgmpc.typing import Array
from lgmpc.viz.figure_files import EXTRA, INK, SOFT, Drawing, X, Y, legend_above
from lgmpc.viz.series import JointValues, draw_forces, draw_joints, draw_xyz, stacked

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NEAR = 0.3
"""Velocities below this fraction of their limits are drawn without the limits."""


def trajectory_drawings(robot: Robot, run: SolvedRun) -> dict[str, Drawing]:
    """Return the drawings of a solved trajectory by their names; each returns whether there was data.

    Raises:
        InputError: if the trajectory contains NaN or infinity.
    """
    log = run.log
    if not log.finite:
        raise InputError("run", f"{run.path}, whose trajectory contains NaN or infinity", "a trajectory to draw")
    return {
        "base": partial(_base, log=log),
        "joints": partial(_joints, log=log, robot=robot),
        "controls": partial(_controls, log=log),
        "forces": partial(_forces, log=log),
        "convergence": partial(_convergence, log=log),
    }


def _base(figure: "Figure", log: TrajectoryLog) -> bool:
    if not log.floating_base:
        return False
    linear, angular = (("Linear velocity, base axes", "m/s"), ("Angular velocity, base axes", "rad/s"))
    headings = ("Base position, world", "m"), ("Base tilt from upright", "deg"), linear, angular
    rows = stacked(figure, (8.0, 7.8), *headings)
    v = log.xs[:, log.nq :]
    for axes, values in zip(rows[[0, 2, 3]], (log.xs[:, :3], v[:, :3], v[:, 3:6]), strict=True):
        draw_xyz(axes, log.times, values)
    rows[1].plot(log.times, tilt_deg(log.xs[:, 3:7]), color=INK)
    rows[1].set_ylim(0.0, None)
    _finish(log, *rows)
    legend_above(rows[0])
    return True


def _joints(figure: "Figure", log: TrajectoryLog, robot: Robot) -> bool:
    """Draw positions of the joints within their ranges, and velocities as fractions of their limits."""
    if robot.nu == 0:
        return False
    lower, upper = robot.joint_lower, robot.joint_upper
    share = np.full((len(log.times), robot.nu), np.nan)
    if robot.nq - robot.joint_q.start == robot.nu:
        bounded = np.isfinite(lower) & np.isfinite(upper)
        range_ = np.where(bounded, upper - lower, np.nan)
        share = 2.0 * (log.xs[:, robot.joint_q] - lower) / range_ - 1.0
    speed = log.xs[:, robot.nq :][:, robot.joint_v] / robot.velocity_limit
    end = 1.0 if np.abs(speed).max() > _NEAR else np.inf
    columns = JointValues("Position in its range", "", share, -1.0, 1.0), JointValues("Velocity", "", speed, -end, end)
    _finish(log, *draw_joints(figure, robot.joint_names, log.times, *columns).flat)
    return True


def _controls(figure: "Figure", log: TrajectoryLog) -> bool:
    """Draw controls, constant over each interval, and their limits."""
    names: list[str] = log.control_names.tolist()
    if not names:
        return False
    controls = JointValues("Control", log.control_unit, _held(log.us), log.control_lower, log.control_upper)
    _finish(log, *draw_joints(figure, names, log.times, controls, steps=True).flat)
    return True


def _forces(figure: "Figure", log: TrajectoryLog) -> bool:
    """Draw each contact's forces, constant over each interval, and its friction limit."""
    if not log.contact_flags.any():
        return False
    forces = _held(log.contact_forces)
    normal, tangential = forces[:, :, 2], np.linalg.norm(forces[:, :, :2], axis=2)
    limit = log.friction * np.maximum(normal, 0.0) if np.isfinite(log.friction) else None
    names, words = log.contact_frames.tolist(), f"{log.friction:g}"
    _finish(log, *draw_forces(figure, names, log.times, normal, tangential, limit, words, steps=True).flat)
    return True


def _held(values: Array) -> Array:
    """Return values (n, ...) of intervals at the (n + 1) nodes: each holds until the next."""
    return np.concatenate((values, values[-1:]))


def _convergence(figure: "Figure", log: TrajectoryLog) -> bool:
    """Draw cost, gaps, the measure compared with the tolerance, and steps, over the iterations."""
    count = len(log.iteration_cost)
    if count == 0:
        return False
    figure.set_size_inches(8.0, 6.6)
    cost, residual, step = figure.subplots(3, 1, sharex=True)
    iterations = np.arange(1, count + 1)
    marker = "." if count <= 60 else ""
    cost.plot(iterations, log.iteration_cost, color=X, marker=marker)
    if (log.iteration_cost > 0.0).all() and log.iteration_cost.max() > 10.0 * log.iteration_cost.min():
        cost.set_yscale("log")
    for values, color, name in (
        (log.iteration_criterion, X, "compared with the tolerance"),
        (log.iteration_gap, EXTRA, "largest gap of the dynamics"),
    ):
        shown = np.where(values > 1e-14, values, np.nan)
        if np.isfinite(shown).any():
            residual.plot(iterations, shown, color=color, marker=marker, label=name)
            residual.set_yscale("log")
    if np.isfinite(log.iteration_step).any():
        step.stem(iterations, log.iteration_step, linefmt=SOFT, markerfmt=".", basefmt=" ")
    cost.set(title="Cost", ylabel="")
    residual.set_title("Residuals")
    step.set(title="Step length (0: rejected)", xlabel="iteration", ylim=(0.0, 1.08))
    cost.set_xlim(0.5, count + 0.5)
    if residual.lines:
        legend_above(residual)
    return True


def _finish(log: TrajectoryLog, *all_axes: "Axes") -> None:
    """Fit the time axis, and mark the times of targets."""
    for axes in all_axes:
        axes.set_xlim(float(log.times[0]), float(log.times[-1]))
        for time in np.unique(log.waypoint_times):
            axes.axvline(float(time), color=Y, lw=0.9, alpha=0.7, zorder=0)
