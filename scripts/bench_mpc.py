"""Time one update of the centroidal MPC, for every QP solver, in a closed loop on its own exact model.

    python scripts/bench_mpc.py [--impulse 2.0] [--nodes 20] [--facets 8] [--seconds 3]

A quadruped of Solo12's mass stands, is pushed for 0.2 s, and recovers. Updates at 100 Hz; an update is timed from
measured state to plan, everything included. The solvers take turns update by update, so that whatever else the machine
does meets all of them alike.
"""

from __future__ import annotations

import argparse
import os
import platform
from importlib.metadata import version

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from lgmpc.mpc import CentroidalMpc, CentroidalMpcSettings
from lgmpc.solvers.qp import QP_SOLVERS
from lgmpc.typing import Array

MASS = 2.5
PERIOD = 0.01
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])
PUSH = (0.5, 0.7)


class ClosedLoop:
    """One controller and its own copy of the model."""

    def __init__(self, name: str, nodes: int, facets: int) -> None:
        self.name = name
        self.mpc = CentroidalMpc(MASS, 4, CentroidalMpcSettings(nodes=nodes, facets=facets, qp_solver=name))
        self.x: Array = STANDING.copy()
        self.times: list[float] = []
        self.iterations: list[int] = []
        self.kkt: list[float] = []
        self.deviation = 0.0

    def step(self, t: float, wrench: Array) -> None:
        """Plan, and let the first forces act for one period."""
        x = self.x
        plan = self.mpc.update(t, x[:3], x[3:6], x[6:9], FEET, np.ones(4), STANDING, wrench)
        self.times.append(plan.update_time)
        self.iterations.append(plan.qp_iterations)
        self.kkt.append(plan.kkt.largest)
        action = self.mpc.problem.action
        p = self.mpc.problem.parameters[0].copy()
        p[action.parameters["duration"]] = PERIOD
        self.x = action.evaluate(x, plan.first_forces.ravel(), p).x_next
        self.deviation = max(self.deviation, float(np.linalg.norm(self.x[:3] - STANDING[:3])))

    def row(self) -> str:
        """One line of the table."""
        ms = 1e3 * np.array(self.times[2:])
        pushed = ms[(np.arange(ms.size) * PERIOD >= PUSH[0]) & (np.arange(ms.size) * PERIOD < PUSH[1] + 0.1)]
        return (
            f"{self.name:16s} {np.median(ms):8.3f} {np.quantile(ms, 0.9):8.3f} {np.quantile(ms, 0.99):8.3f} "
            f"{np.median(pushed):10.3f} {np.median(self.iterations):6.0f} {max(self.iterations):6d} "
            f"{np.nanmax(self.kkt):10.1e} {self.mpc.failures:5d} {1e3 * self.deviation:8.1f}"
        )


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--impulse", type=float, default=2.0, help="N.s, 45 degrees from the x axis")
    parser.add_argument("--nodes", type=int, default=20)
    parser.add_argument("--facets", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()

    loops = [ClosedLoop(name, options.nodes, options.facets) for name in QP_SOLVERS]
    push = np.zeros(6)
    push[:2] = options.impulse / (PUSH[1] - PUSH[0]) * np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    for i in range(round(options.seconds / PERIOD)):
        t = i * PERIOD
        wrench = push if PUSH[0] <= t < PUSH[1] else np.zeros(6)
        for loop in loops:
            loop.step(t, wrench)

    print(f"{_processor()}, {os.cpu_count()} cores, {platform.platform()}, Python {platform.python_version()}")
    packages = ("lgmpc", "casadi", "osqp", "piqp", "proxsuite", "numpy")
    print(", ".join(f"{name} {version(name)}" for name in packages))
    print(
        f"N = {options.nodes}, 4 contacts, {options.facets} facets, {options.impulse} N.s in 0.2 s, one thread, "
        f"{'compiled' if loops[0].mpc.solver.compiled else 'interpreted'}; times in ms"
    )
    print(
        f"{'QP solver':16s} {'median':>8s} {'p90':>8s} {'p99':>8s} {'in push':>10s} {'its':>6s} {'most':>6s} "
        f"{'KKT max':>10s} {'fail':>5s} {'dev mm':>8s}"
    )
    for loop in loops:
        print(loop.row())


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
