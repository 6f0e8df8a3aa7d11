"""Figures of a solved trajectory."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import SolvedRun, TrajectoryLog
from lgmpc.runs.log import tilt_deg
from lgmpc.typing import Array
from lgmpc.viz.figure_files import Drawing, Plots, draw_figures, draw_limits, figure_title, joint_style, legend_above
from lgmpc.viz.series import draw_efforts, draw_forces, draw_xyz
from lgmpc.viz.style import EXTRA, INK, SOFT, X, Y

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot_trajectory", "trajectory_drawings"]

_NEAR = 0.3
"""Velocities below this fraction of their limits are drawn without the limits."""


def plot_trajectory(robot: Robot, run: SolvedRun) -> Plots:
    """Draw the figures of a solved trajectory: base, joints, controls, contact forces, convergence.

    Args:
        robot: the robot of the run.
        run: contents of the run folder.

    Returns:
        The figures with data.

    Raises:
        InputError: if the trajectory contains NaN or infinity.
        MissingDependencyError: if matplotlib is not installed.
    """
    return draw_figures(trajectory_drawings(robot, run), figure_title(run.result))


def trajectory_drawings(robot: Robot, run: SolvedRun) -> dict[str, Drawing]:
    """Return the drawings of a solved trajectory by their names; each returns whether there was data.

    Raises:
        InputError: if the trajectory contains NaN or infinity.
    """
    log = run.trajectory
    if not log.finite:
        raise InputError("run", f"{run.path}, whose trajectory contains NaN or infinity", "a trajectory to draw")
    return {
        "base": partial(_base, log=log),
        "joints": partial(_joints, log=log, robot=robot),
        "controls": partial(_controls, log=log),
        "forces": partial(_forces, log=log),
        "convergence": partial(_convergence, log=log),
    }


def _base(figure: Figure, log: TrajectoryLog) -> bool:
    if not log.floating_base:
        return False
    figure.set_size_inches(8.0, 7.8)
    position, tilt, linear, angular = figure.subplots(4, 1, sharex=True)
    v = log.xs[:, log.nq :]
    for axes, values in ((position, log.xs[:, :3]), (linear, v[:, :3]), (angular, v[:, 3:6])):
        draw_xyz(axes, log.times, values)
    tilt.plot(log.times, tilt_deg(log.xs[:, 3:7]), color=INK)
    position.set(title="Base position, world", ylabel="m")
    tilt.set(title="Base tilt from upright", ylabel="deg", ylim=(0.0, None))
    linear.set(title="Linear velocity, base axes", ylabel="m/s")
    angular.set(title="Angular velocity, base axes", ylabel="rad/s", xlabel="time, s")
    _finish(log, position, tilt, linear, angular)
    legend_above(position)
    return True


def _joints(figure: Figure, log: TrajectoryLog, robot: Robot) -> bool:
    """Draw positions of the joints within their limits, and their velocities."""
    if robot.nu == 0:
        return False
    figure.set_size_inches(8.0, 6.4)
    position, velocity = figure.subplots(2, 1, sharex=True)
    lower, upper = robot.joint_lower, robot.joint_upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    scalar = robot.nq - robot.joint_q.start == robot.nu
    q = log.xs[:, robot.joint_q] if scalar else np.zeros((len(log.times), 0))
    v = log.xs[:, robot.nq :][:, robot.joint_v]
    for i, name in enumerate(robot.joint_names):
        if scalar and bounded[i]:
            share = 2.0 * (q[:, i] - lower[i]) / (upper[i] - lower[i]) - 1.0
            position.plot(log.times, share, **joint_style(i), lw=1.1, label=name)
        velocity.plot(log.times, v[:, i] / robot.velocity_limit[i], **joint_style(i), lw=1.1, label=name)
    draw_limits(position, -1.0, 1.0, "limit")
    if np.abs(v / robot.velocity_limit).max() > _NEAR:
        draw_limits(velocity, -1.0, 1.0, "limit")
    position.set(title="Joint positions in their ranges", ylabel="fraction of the limit")
    velocity.set(title="Joint velocities", ylabel="fraction of the limit", xlabel="time, s")
    _finish(log, position, velocity)
    if robot.nu <= 18:
        figure.legend(*velocity.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    return True


def _controls(figure: Figure, log: TrajectoryLog) -> bool:
    """Draw controls, constant over each interval, and their limits."""
    names: list[str] = log.control_names.tolist()
    if not names:
        return False
    ends = (np.broadcast_to(each, (len(log.times), len(names))) for each in (log.control_lower, log.control_upper))
    _finish(log, *draw_efforts(figure, "Control", log.control_unit, names, log.times, _held(log.us), *ends, steps=True))
    return True


def _forces(figure: Figure, log: TrajectoryLog) -> bool:
    """Draw each contact's forces, constant over each interval, and its friction limit."""
    if not log.contact_flags.any():
        return False
    forces = _held(log.contact_forces)
    normal, tangential = forces[:, :, 2], np.linalg.norm(forces[:, :, :2], axis=2)
    limit = log.friction * np.maximum(normal, 0.0) if np.isfinite(log.friction) else None
    names = log.contact_frames.tolist()
    _finish(
        log, *draw_forces(figure, names, log.times, normal, tangential, limit, f"{log.friction:g}", steps=True).flat
    )
    return True


def _held(values: Array) -> Array:
    """Return values (n, ...) of intervals at the (n + 1) nodes: each holds until the next."""
    return np.concatenate((values, values[-1:]))


def _convergence(figure: Figure, log: TrajectoryLog) -> bool:
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


def _finish(log: TrajectoryLog, *all_axes: Axes) -> None:
    """Fit the time axis, and mark the times of targets."""
    for axes in all_axes:
        axes.set_xlim(float(log.times[0]), float(log.times[-1]))
        for time in np.unique(log.waypoint_times):
            axes.axvline(float(time), color=Y, lw=0.9, alpha=0.7, zorder=0)
