"""Time of one whole-body control tick, split into its parts, while Solo12 is pushed: python scripts/bench_wbc.py."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported: threads only slow matrices of this size down

import dataclasses
from pathlib import Path
from time import perf_counter

import numpy as np

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.robot import Robot
from lgmpc.runs import host_info, versions
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.typing import Array
from lgmpc.wbc import (
    QpAssembly,
    QpStatus,
    TaskStack,
    WholeBodyReference,
    WholeBodySettings,
    WholeBodySolver,
    WholeBodyTerms,
    standing_tasks,
)

CONFIG = Path(__file__).parent.parent / "configs" / "solo12_balance.yaml"
PARTS = ("terms", "tasks", "assembly", "solve")
TICKS = 3000
PUSHES = {500: (0.0, 10.0, 0.0), 1500: (10.0, 0.0, 0.0), 2200: (7.0, 7.0, 0.0)}  # N for 200 ms, by first tick


def pushed_run(robot: Robot, facets: int) -> Array:
    """Stand through three pushes of 2 N.s and return the time of every tick's parts (ticks, parts), us."""
    settings = WholeBodySettings()
    limits = dataclasses.replace(settings.limits, friction_facets=facets)
    terms = WholeBodyTerms(robot)
    stack = TaskStack(standing_tasks(robot, settings), robot.nv)
    assembly = QpAssembly(robot, stack, limits, settings.force_weight, settings.acceleration_weight)
    solver = WholeBodySolver(assembly, settings.tolerance, settings.max_iterations)
    reference = WholeBodyReference.standing(robot, terms.com, terms.contact_points)
    plant = MujocoPlant(robot)
    plant.reset(robot.x_reference)
    times = np.zeros((TICKS, 5))
    for k in range(TICKS):
        if k in PUSHES:
            plant.set_wrench("base_link", np.array([*PUSHES[k], 0.0, 0.0, 0.0]))
        elif k - 200 in PUSHES:
            plant.set_wrench("base_link", np.zeros(6))
        sample = plant.sense()
        times[k, 0] = perf_counter()
        terms.update(sample.q, sample.v)
        times[k, 1] = perf_counter()
        stack.update(terms, reference)
        times[k, 2] = perf_counter()
        assembly.update(terms, reference)
        times[k, 3] = perf_counter()
        status = solver.solve()
        tau = assembly.torques(terms, solver.solution)
        times[k, 4] = perf_counter()
        if status is not QpStatus.SOLVED:
            raise SystemExit(f"tick {k}: {status.name} ({status.value})")
        plant.step(tau)
    return 1e6 * np.diff(times, axis=1)


def main() -> None:
    """Print machine, versions and the table."""
    host = host_info()
    print(f"{host.cpu}, {host.cores} cores, {host.system}, OMP_NUM_THREADS={host.threads}")
    print(", ".join(f"{name} {version}" for name, version in versions().items()))
    print(f"\nwhole-body control of Solo12, {TICKS} ticks, three pushes of 2 N.s; median / 99th percentile, us\n")
    print("facets" + "".join(f"{part:>16}" for part in (*PARTS, "tick")))
    robot = build_robot(load_config(CONFIG))
    for facets in (4, 8, 12, 16):
        times = pushed_run(robot, facets)
        columns = [*times.T, times.sum(axis=1)]
        cells = [f"{np.median(column):.0f} / {np.percentile(column, 99):.0f}" for column in columns]
        print(f"{facets:6d}" + "".join(f"{cell:>16}" for cell in cells))


if __name__ == "__main__":
    main()
