"""What is kept of a solved problem as arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lgmpc.problems import Scenario
from lgmpc.problems.kinematics import com_positions, contact_positions
from lgmpc.runs import TrajectoryLog
from lgmpc.solvers import Progress, Solution, Status

__all__ = ["is_finite", "trajectory_log"]


def trajectory_log(scenario: Scenario, solution: Solution, iterations: Sequence[Progress]) -> TrajectoryLog:
    """Return the trajectory with what is seen of it: centre of mass, contacts and forces; NaN where it is not finite.

    Args:
        scenario: what was solved.
        solution: what came of it.
        iterations: what the solver told on the way.
    """
    robot, problem, waypoints, finite = scenario.robot, scenario.problem, scenario.waypoints, is_finite(solution)
    nodes, nc = problem.nodes, robot.nc
    trajectory = solution.trajectory
    points, com = np.full((nodes + 1, nc, 3), np.nan), np.full((nodes + 1, 3), np.nan)
    forces = np.zeros((nodes, nc, 3))
    if finite:
        com[:] = com_positions(robot, trajectory.xs)
        points[:] = contact_positions(robot, trajectory.xs) - [0.0, 0.0, robot.contact_radius]
        if scenario.contact_forces is not None:
            forces[:] = scenario.contact_forces(trajectory)
    controls = scenario.controls
    unknown = np.full(problem.nu, np.inf)
    names = controls.names if controls is not None else tuple(f"u{i}" for i in range(problem.nu))
    rotations = [np.full((3, 3), np.nan) if w.rotation is None else w.rotation for w in waypoints]
    return TrajectoryLog(
        times=scenario.times,
        xs=solution.xs.copy(),
        us=solution.us.copy(),
        com=com,
        contact_points=points,
        contact_flags=scenario.contact_flags.copy(),
        contact_forces=forces,
        contact_frames=np.array(robot.contact_frames, dtype=np.str_),
        control_names=np.array(names, dtype=np.str_),
        control_lower=-unknown if controls is None else controls.lower.copy(),
        control_upper=unknown if controls is None else controls.upper.copy(),
        waypoint_names=np.array([w.name for w in waypoints], dtype=np.str_),
        waypoint_times=np.array([w.time for w in waypoints], dtype=np.float64),
        waypoint_positions=np.array([w.position for w in waypoints], dtype=np.float64).reshape(-1, 3),
        waypoint_rotations=np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
        iteration_cost=np.array([p.cost for p in iterations]),
        iteration_criterion=np.array([p.criterion for p in iterations]),
        iteration_gap=np.array([p.gap for p in iterations]),
        iteration_step=np.array([p.step_length if p.accepted else 0.0 for p in iterations]),
        iteration_regularization=np.array([p.regularization for p in iterations]),
        iteration_elapsed=np.array([p.elapsed for p in iterations]),
        control_unit="" if controls is None else controls.unit,
        nq=robot.nq,
        floating_base=robot.floating_base,
        friction=math.nan if scenario.friction is None else scenario.friction,
    )


def is_finite(solution: Solution) -> bool:
    """Return whether a trajectory holds numbers only."""
    fine = solution.status is not Status.NOT_FINITE
    return fine and bool(np.isfinite(solution.xs).all() and np.isfinite(solution.us).all())
