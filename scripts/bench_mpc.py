"""Time one update of an MPC, for every QP solver, in a closed loop on its own exact model.

    python scripts/bench_mpc.py [--impulse 2.0] [--nodes 20] [--facets 8] [--seconds 3]
    python scripts/bench_mpc.py --model full_body [--solvers active_set piqp]
    python scripts/bench_mpc.py --robot talos --nodes 30 --impulse 20 --facets 4

A robot stands, is pushed for 0.2 s, and recovers.
Updates at 100 Hz (50 Hz with the legs); an update is timed from measured state to plan, everything included. The
solvers take turns update by update, so that whatever else the machine does meets all of them alike.
"""

from __future__ import annotations

import argparse
import math
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from record import add_json_option, print_machine, quantiles, write_record

from lgmpc.config.build import build_robot
from lgmpc.config.loading import load_config
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import CentroidalMpc, CentroidalMpcSettings, FullBodyMpc, FullBodyMpcSettings, MeasuredState, Plan
from lgmpc.mpc.sqp import SqpMpc
from lgmpc.robot import Robot
from lgmpc.solvers.qp import QP_SOLVERS
from lgmpc.typing import Array

CONFIGS = Path(__file__).parent.parent / "configs"
ROBOTS = {"solo12": "solo12_balance_full_body", "talos": "talos_stand", "g1": "g1_stand"}
PUSH = (0.5, 0.7)


class ClosedLoop(ABC):
    """One controller and its own copy of the model."""

    period = 0.01
    mpc: SqpMpc

    def __init__(self, name: str) -> None:
        self.name = name
        self.times: list[float] = []
        self.iterations: list[int] = []
        self.kkt: list[float] = []
        self.failures = 0
        self.deviation = 0.0

    @abstractmethod
    def plan(self, t: float, wrench: Array) -> Plan:
        """Plan from the present state."""

    @abstractmethod
    def advance(self, plan: Plan, wrench: Array) -> None:
        """Let the first controls act for one period."""

    def step(self, t: float, wrench: Array) -> None:
        """Plan and advance, and write down how that went."""
        plan = self.plan(t, wrench)
        self.times.append(plan.update_time)
        self.iterations.append(plan.qp_iterations)
        self.kkt.append(self.mpc.solver.residual().largest)
        self.failures += not plan.status.usable
        self.deviation = max(self.deviation, float(np.linalg.norm(plan.xs[0, :3] - self.standing[:3])))
        self.advance(plan, wrench)

    @property
    @abstractmethod
    def standing(self) -> Array:
        """(9,) reference of centre of mass and momenta."""

    def figures(self) -> dict[str, float]:
        """Times of all updates but the first two, ms, and what the worst of them left."""
        ms = 1e3 * np.array(self.times[2:])
        return {**quantiles(ms), "failures": self.failures, "deviation_m": self.deviation}

    def row(self) -> str:
        """One line of the table."""
        ms = 1e3 * np.array(self.times[2:])
        at = np.arange(2, len(self.times)) * self.period
        kkt = max((value for value in self.kkt if not math.isnan(value)), default=math.nan)
        pushed = ms[(at >= PUSH[0]) & (at < PUSH[1] + 0.1)]
        return (
            f"{self.name:16s} {np.median(ms):8.3f} {np.quantile(ms, 0.9):8.3f} {np.quantile(ms, 0.99):8.3f} "
            f"{np.median(pushed):10.3f} {np.median(self.iterations):6.0f} {max(self.iterations):6d} "
            f"{kkt:10.1e} {self.failures:5d} {1e3 * self.deviation:8.1f}"
        )


class CentroidalLoop(ClosedLoop):
    """Centre of mass and momenta."""

    def __init__(self, robot: Robot, settings: CentroidalMpcSettings) -> None:
        super().__init__(settings.qp_solver)
        self.mpc = model = CentroidalMpc.of(robot, settings)
        self.compiled, nodes = model.solver.compiled, settings.nodes
        data = robot.create_data()
        com = pin.centerOfMass(robot.model, data, robot.q_reference)
        pin.framesForwardKinematics(robot.model, data, robot.q_reference)
        points = np.array([data.oMf[frame].translation for frame in robot.contact_ids])
        self._standing = np.r_[com, np.zeros(6)]
        self.x: Array = self._standing.copy()
        self._contacts = ContactHorizon.allocate(nodes, robot.nc)
        self._contacts.hold(points, np.ones(robot.nc, dtype=np.bool_), 0.6)
        self._motion = MotionReference.standing(robot, nodes, com)
        self._action = model.problem.action
        self._parameters = model.problem.parameters[0].copy()
        layout = self._action.parameters
        self._parameters[layout["duration"]] = self.period
        self._parameters[layout["contact_points"]] = points.ravel()
        self._parameters[layout["contact_flags"]] = 1.0
        self._wrench = layout["external_wrench"]

    @property
    def standing(self) -> Array:
        """(9,) reference."""
        return self._standing

    def plan(self, t: float, wrench: Array) -> Plan:
        """Plan from the present state."""
        state = MeasuredState.centroidal(t, self.x[:3], self.x[3:])
        return self.mpc.update(state, self._contacts, self._motion, np.tile(wrench, (len(self._motion.com) - 1, 1)))

    def advance(self, plan: Plan, wrench: Array) -> None:
        """Let the first forces act for one period."""
        self._parameters[self._wrench] = wrench
        self.x = self._action.evaluate(self.x, plan.first_forces.ravel(), self._parameters).x_next


class WholeBodyLoop(ClosedLoop):
    """Base and joints."""

    period = 0.02

    def __init__(self, name: str, mpc: FullBodyMpc) -> None:
        super().__init__(name)
        self.mpc, self.robot = mpc, mpc.robot
        self.compiled = mpc.solver.compiled
        self._data = self.robot.create_data()
        self.q, self.v = self.robot.q_reference.copy(), np.zeros(self.robot.nv)
        self._standing = np.r_[pin.centerOfMass(self.robot.model, self._data, self.q), np.zeros(6)]
        nodes = mpc.settings.nodes
        self._contacts = ContactHorizon.allocate(nodes, self.robot.nc)
        self._motion = MotionReference.standing(self.robot, nodes, self._standing[:3])

    @property
    def standing(self) -> Array:
        """(9,) reference."""
        return self._standing

    def plan(self, t: float, wrench: Array) -> Plan:
        """Plan from the present state."""
        no_momentum = np.zeros(6)
        state = MeasuredState(t, self.q, self.v, self._standing[:3], no_momentum, np.eye(3), np.eye(3))
        return self.mpc.update(state, self._contacts, self._motion, np.tile(wrench, (len(self._motion.com) - 1, 1)))

    def advance(self, plan: Plan, wrench: Array) -> None:
        """Let the first controls act for one period, an interval of the plan."""
        problem, u = self.mpc.problem, self.mpc.solver.us[0]
        x = problem.action.evaluate(problem.x0, u, problem.parameters[0]).x_next
        self.q, self.v = x[: self.robot.nq], x[self.robot.nq :]


def centroidal(robot: Robot, nodes: int, facets: int, solvers: list[str]) -> list[ClosedLoop]:
    """One loop a solver."""
    settings = [CentroidalMpcSettings(nodes=nodes, friction_facets=facets, qp_solver=name) for name in solvers]
    return [CentroidalLoop(robot, each) for each in settings]


def full_body(robot: Robot, nodes: int, facets: int, solvers: list[str]) -> list[ClosedLoop]:
    """One loop a solver."""
    settings = [FullBodyMpcSettings(nodes=nodes, friction_facets=facets, qp_solver=name) for name in solvers]
    return [WholeBodyLoop(s.qp_solver, FullBodyMpc(robot, s)) for s in settings]


MODELS: dict[str, Callable[[Robot, int, int, list[str]], list[ClosedLoop]]] = {
    "centroidal": centroidal,
    "full_body": full_body,
}


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=list(ROBOTS), default="solo12")
    parser.add_argument("--model", choices=list(MODELS), default="centroidal", help="what predicts")
    parser.add_argument("--solvers", nargs="+", choices=QP_SOLVERS, default=list(QP_SOLVERS))
    parser.add_argument("--impulse", type=float, default=2.0, help="N.s, 45 degrees from the x axis")
    parser.add_argument("--nodes", type=int, default=20)
    parser.add_argument("--facets", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=3.0)
    add_json_option(parser)
    options = parser.parse_args()

    robot = build_robot(load_config(CONFIGS / f"{ROBOTS[options.robot]}.yaml"))
    loops = MODELS[options.model](robot, options.nodes, options.facets, options.solvers)
    period = loops[0].period
    push = np.zeros(6)
    push[:2] = options.impulse / (PUSH[1] - PUSH[0]) * np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    for i in range(round(options.seconds / period)):
        t = i * period
        wrench = push if PUSH[0] <= t < PUSH[1] else np.zeros(6)
        for loop in loops:
            loop.step(t, wrench)

    print_machine()
    print(
        f"{options.robot}, {options.model}, N = {options.nodes}, {robot.nc} contact points, {options.facets} facets, "
        f"{options.impulse} N.s in 0.2 s, "
        f"one thread, {'compiled' if loops[0].compiled else 'interpreted'}; times in ms"
    )
    print(
        f"{'QP solver':16s} {'median':>8s} {'p90':>8s} {'p99':>8s} {'in push':>10s} {'its':>6s} {'most':>6s} "
        f"{'KKT max':>10s} {'fail':>5s} {'dev mm':>8s}"
    )
    for loop in loops:
        print(loop.row())
    write_record(options.json, {loop.name: loop.figures() for loop in loops})


if __name__ == "__main__":
    main()
