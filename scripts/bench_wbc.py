"""Time of one whole-body control tick, split into its parts, while a standing robot is pushed.

python scripts/bench_wbc.py
python scripts/bench_wbc.py --robots talos g1 --facets 4
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported: threads only slow matrices of this size down

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np
from record import add_json_option, print_machine, quantiles, write_record

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.robot import Robot
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.status import Status
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyController, WholeBodySettings

CONFIGS = Path(__file__).parent.parent / "configs"
ROBOTS = {"solo12": ("solo12_balance", 2.0), "talos": ("talos_stand", 20.0), "g1": ("g1_stand", 7.0)}  # pushes, N.s
PARTS = ("sense", "QP data", "solver")
TICKS = 3000
PUSHES = {500: (0.0, 1.0, 0.0), 1500: (1.0, 0.0, 0.0), 2200: (0.7, 0.7, 0.0)}  # for 200 ms, by first tick


def pushed_run(robot: Robot, body: str, impulse: float, settings: WholeBodySettings) -> tuple[Array, int]:
    """Stand through three pushes; return the time of every tick's parts and of all (ticks, parts + 1), us.

    The parts are timed on a controller that is called piece by piece, the whole on another one that is called as usual.
    The number of ticks that were left to ProxQP is returned too.
    """
    apart, whole = WholeBodyController(robot, settings), WholeBodyController(robot, settings)
    plant = MujocoPlant(robot)
    plant.reset(robot.x_reference)
    times, left = np.zeros((TICKS, 4)), 0
    for k in range(TICKS):
        if k in PUSHES:
            plant.set_wrench(body, impulse / 0.2 * np.array([*PUSHES[k], 0.0, 0.0, 0.0]))
        elif k - 200 in PUSHES:
            plant.set_wrench(body, np.zeros(6))
        sample = plant.sense()
        started = perf_counter()
        whole.sense(sample.q, sample.v)
        status = whole.solve()
        times[k, 3] = perf_counter() - started
        if status is not Status.CONVERGED:
            raise SystemExit(f"tick {k}: {status.name} ({status.value})")
        started = perf_counter()
        apart.sense(sample.q, sample.v)
        sensed = perf_counter()
        apart.qp.update()
        written = perf_counter()
        apart.solver.solve()
        times[k, :3] = sensed - started, written - sensed, perf_counter() - written
        left += apart.solver.took_over
        plant.step(whole.tau)
    return 1e6 * times, left


def main() -> None:
    """Print machine, versions and the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument("--facets", type=int, nargs="+", help="4, 8, 12 and 16 of points unless given, 4 of soles")
    add_json_option(parser)
    arguments = parser.parse_args()
    print_machine()
    figures: dict[str, dict[str, object]] = {}
    for name in arguments.robots:
        stem, impulse = ROBOTS[name]
        config = load_config(CONFIGS / f"{stem}.yaml")
        robot, body = build_robot(config), config.pushes[0].body
        print(f"\n{name}, {TICKS} ticks, three pushes of {impulse:g} N.s; median / 99th percentile, us\n")
        print("facets" + "".join(f"{part:>16}" for part in (*PARTS, "tick", "ticks by ProxQP")))
        figures[name] = {}
        for facets in arguments.facets or ([4, 8, 12, 16] if robot.foot_points.single else [4]):
            times, left = pushed_run(robot, body, impulse, WholeBodySettings(friction_facets=facets))
            cells = [f"{np.median(column):.0f} / {np.percentile(column, 99):.0f}" for column in times.T]
            print(f"{facets:6d}" + "".join(f"{cell:>16}" for cell in cells) + f"{left:16d}")
            parts = {f"{part}_us": quantiles(column) for part, column in zip((*PARTS, "tick"), times.T, strict=True)}
            figures[name][str(facets)] = {**parts, "ticks_by_proxqp": left}
    write_record(arguments.json, figures)


if __name__ == "__main__":
    main()
