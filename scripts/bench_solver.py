"""Time FDDP on Solo12 standing on four feet: lgmpc's, and Crocoddyl's in the same process where it is installed.

    python scripts/bench_solver.py --nodes 20 50 100

Both solve the same problem from the same guess, in turns; the smallest time of all rounds is printed. Crocoddyl comes
with the extra ``bench``: pip install "lgmpc[bench]".
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.costs import CostItem
from lgmpc.costs.library import CoMPosition, Control, StateError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import Fddp

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
GAINS = np.array([20.0, 6.0])  # draw the feet back to their places: 1/s2 and 1/s


@dataclass(frozen=True)
class Stance:
    """Solo12 on four feet, pushed, moves its centre of mass: all numbers of the problem."""

    robot: Robot
    nodes: int
    dt: float
    feet: np.ndarray
    com: np.ndarray
    x_reference: np.ndarray
    x0: np.ndarray
    state_weights: np.ndarray
    com_weight: float = 100.0
    effort_weight: float = 0.1

    @classmethod
    def make(cls, nodes: int = 20, dt: float = 0.02) -> Stance:
        """Load the robot and fill in the numbers."""
        spec = RobotSpec(
            model="solo12",
            contact_frames=FEET,
            effort_limit=1.8,
            velocity_limit=30.0,
            position_limit=(-3.2, 3.2),
            posture={"*_HAA": 0.0, "F?_HFE": 0.8, "H?_HFE": -0.8, "F?_KFE": -1.6, "H?_KFE": 1.6},
        )
        robot = load_robot(spec)
        model, data, nu = robot.model, robot.model.createData(), robot.nv - 6
        pin.framesForwardKinematics(model, data, robot.q_reference)
        feet = np.array([data.oMf[i].translation for i in robot.contact_ids])
        com = pin.centerOfMass(model, data, robot.q_reference) + [0.02, 0.01, -0.02]
        x_reference = np.concatenate([robot.q_reference, np.zeros(robot.nv)])
        x0 = x_reference.copy()
        x0[model.nq : model.nq + 6] = [0.1, 0.2, 0.0, 0.3, -0.2, 0.1]
        parts = [np.zeros(3), np.full(3, 5.0), np.full(nu, 0.5), np.full(6, 0.5), np.full(nu, 0.05)]
        return cls(robot, nodes, dt, feet, com, x_reference, x0, np.concatenate(parts))

    def guess(self) -> Trajectory:
        """The first state at all nodes, with the efforts that hold the robot's weight as well as they can."""
        model, nv = self.robot.model, self.robot.nv
        data = model.createData()
        q = self.robot.q_reference
        load = pin.rnea(model, data, q, np.zeros(nv), np.zeros(nv))
        pin.computeJointJacobians(model, data, q)
        pin.framesForwardKinematics(model, data, q)
        jacobian = np.vstack(
            [pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED)[:3] for i in self.robot.contact_ids]
        )
        forces = np.linalg.lstsq(jacobian[:, :6].T, load[:6])[0]
        efforts = (load - jacobian.T @ forces)[6:]
        return Trajectory(np.tile(self.x0, (self.nodes + 1, 1)), np.tile(efforts, (self.nodes, 1)))

    def ours(self) -> ShootingProblem:
        """The problem for lgmpc."""
        model, nu = self.robot.model, self.robot.nv - 6
        dynamics = ContactForwardDynamics(model, FEET)
        costs = [
            CostItem("com", CoMPosition(self.com), self.com_weight),
            CostItem("posture", StateError(dynamics.state, self.x_reference), self.state_weights),
            CostItem("effort", Control(nu), self.effort_weight),
        ]
        problem = ShootingProblem(MultibodyAction("stance", dynamics, costs), self.nodes)
        problem.set("duration", self.dt)
        problem.set("contact_points", self.feet.ravel())
        problem.set("contact_gains", GAINS)
        problem.set_initial_state(self.x0)
        return problem

    def theirs(self) -> Any:
        """The problem for Crocoddyl."""
        import crocoddyl

        model, nu = self.robot.model, self.robot.nv - 6
        state = crocoddyl.StateMultibody(model)
        actuation = crocoddyl.ActuationModelFloatingBase(state)
        contacts = crocoddyl.ContactModelMultiple(state, nu)
        for name, frame, point in zip(FEET, self.robot.contact_ids, self.feet, strict=True):
            contact = crocoddyl.ContactModel3D(state, frame, point, pin.LOCAL_WORLD_ALIGNED, nu, GAINS)
            contacts.addContact(name, contact)
        costs = crocoddyl.CostModelSum(state, nu)
        for name, residual, weights in (
            ("com", crocoddyl.ResidualModelCoMPosition(state, self.com, nu), np.full(3, self.com_weight)),
            ("posture", crocoddyl.ResidualModelState(state, self.x_reference, nu), self.state_weights),
            ("effort", crocoddyl.ResidualModelControl(state, nu), np.full(nu, self.effort_weight)),
        ):
            activation = crocoddyl.ActivationModelWeightedQuad(weights)
            costs.addCost(name, crocoddyl.CostModelResidual(state, activation, residual), 1.0)
        action = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)
        running = crocoddyl.IntegratedActionModelEuler(action, self.dt)
        terminal = crocoddyl.IntegratedActionModelEuler(action, 0.0)
        return crocoddyl.ShootingProblem(self.x0, [running] * self.nodes, terminal)


def best(rounds: int, calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Smallest time of each call, s; the calls take turns."""
    times = dict.fromkeys(calls, float("inf"))
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            times[name] = min(times[name], time.perf_counter() - start)
    return times


def compare(nodes: int, rounds: int, crocoddyl: Any) -> None:
    """Print the times for one horizon."""
    stance = Stance.make(nodes)
    guess, ours = stance.guess(), Fddp(stance.ours(), progress=print)
    ours.solve(guess)
    calls: dict[str, Callable[[], object]] = {
        "lgmpc  expansion": ours.functions.expand,
        "lgmpc  backward sweep": lambda: ours.sweep.run(1e-9, closed=True),
        "lgmpc  roll-out": ours.functions.roll_out,
        "lgmpc  solve": lambda: ours.solve(guess),
    }
    if crocoddyl is not None:
        theirs = crocoddyl.SolverFDDP(stance.theirs())
        xs, us = list(guess.xs), list(guess.us)
        theirs.solve(xs, us, 100, False)
        calls |= {
            "croco  calcDiff": lambda: theirs.problem.calcDiff(theirs.xs, theirs.us),
            "croco  backward sweep": theirs.backwardPass,
            "croco  roll-out": lambda: theirs.forwardPass(1.0),
            "croco  solve": lambda: theirs.solve(xs, us, 100, False),
        }
    times = best(rounds, calls)
    solution = ours.solve(guess)
    print(f"\nN = {nodes}: {solution.status.name.lower()}, cost {solution.cost:.9g}")
    for name, seconds in times.items():
        if name.endswith("solve"):
            taken = solution.iterations if name.startswith("lgmpc") else theirs.iter + 1
            print(f"  {name:24s} {1e3 * seconds:8.2f} ms, {taken} iterations, {1e3 * seconds / taken:.2f} ms each")
        else:
            print(f"  {name:24s} {1e6 * seconds / nodes:8.1f} us a stage")
    if crocoddyl is not None:
        mine, other = times["lgmpc  solve"] / solution.iterations, times["croco  solve"] / (theirs.iter + 1)
        gap = solution.cost - theirs.cost
        print(f"  an iteration takes {mine / other:.2f} of Crocoddyl's time; the costs differ by {gap:.1e}")


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, nargs="+", default=[20, 50, 100], help="horizons to time")
    parser.add_argument("--rounds", type=int, default=20, help="rounds of each measurement")
    options = parser.parse_args()
    crocoddyl: Any = None
    if importlib.util.find_spec("crocoddyl") is None:
        print("Crocoddyl is not installed: only lgmpc is timed")
    else:
        crocoddyl = importlib.import_module("crocoddyl")
    for nodes in options.nodes:
        compare(nodes, options.rounds, crocoddyl)


if __name__ == "__main__":
    main()
