"""Time lgmpc's optimisers beside Crocoddyl's, in one process, one thread each, in turns, on the same problems.

    python scripts/bench_optimiser.py --nodes 20 50 100 --json figures.json

FDDP here and there, from the same guess: Solo12 standing on four feet (any horizon) and trotting one step, ANYmal C in
five gaits, Talos on both feet reaching with its right hand (compiled, and by the numeric action), an arm, a quadrotor
(also bounded, by box FDDP). Then the same stance with hard friction cones and torque limits, by SQP. Medians and minima
of all rounds, in the thread's processor time: on a busy machine a call waits for its turn, and a short one longer than
it takes. Crocoddyl comes with the extra ``bench``; without it Solo12 and ANYmal are timed alone.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import argparse
import importlib.util
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from paired_problems import ANYMAL_GAITS, FEET, GAINS, Stance, Trot, anymal_gait
from paired_robots import Pair, arm, paired, quadrotor, talos
from record import add_json_option, print_machine, write_record

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.compile import reporting
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import CoMPosition, Control, FrictionCone, StateError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import BoxFddp, Fddp, LineSearchSqp
from lgmpc.solvers.qp import PiqpSolver

PUSH = 4.0  # times the stance's: enough for a sixth of all rows to be at their limits
Calls = dict[str, Callable[[], object]]


@dataclass(frozen=True)
class Figure:
    """Duration of one call.

    Attributes:
        problem: name and horizon.
        solver: its name.
        part: of the solver, or ``solve``.
        nodes: N.
        iterations: of a solve; 1 of a part.
        median_ms: of all rounds.
        least_ms: of all rounds.
    """

    problem: str
    solver: str
    part: str
    nodes: int
    iterations: int
    median_ms: float
    least_ms: float


def rounds_of(calls: Calls, rounds: int) -> dict[str, np.ndarray]:
    """Times of each call (rounds,), ms; the calls take turns."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.thread_time()
            call()
            times[name].append(1e3 * (time.thread_time() - start))
    return {name: np.array(values) for name, values in times.items()}


def parts(ours: Fddp, guess: Trajectory, theirs: Any) -> Calls:
    """The parts of an iteration, and the whole solve, of both."""
    calls: Calls = {
        "lgmpc/linearisation": ours.functions.expand,
        "lgmpc/backward sweep": lambda: ours.sweep.run(1e-9, closed=True),
        "lgmpc/forward sweep": ours.functions.roll_out,
        "lgmpc/solve": lambda: ours.solve(guess),
    }
    if theirs is not None:
        xs, us = list(guess.xs), list(guess.us)
        calls |= {
            "crocoddyl/linearisation": lambda: theirs.problem.calcDiff(theirs.xs, theirs.us),
            "crocoddyl/backward sweep": theirs.backwardPass,
            "crocoddyl/forward sweep": lambda: theirs.forwardPass(1.0),
            "crocoddyl/solve": lambda: theirs.solve(xs, us, 100, False),
        }
    return calls


def compare(name: str, pair: Pair, rounds: int, crocoddyl: Any) -> list[Figure]:
    """Time FDDP (box FDDP if controls are bounded) on one problem, and print a table."""
    problem, guess = pair.ours, pair.guess
    bounded = problem.actions[0].value_function.size1_out("constraint") > 0
    with reporting(print):
        ours = (BoxFddp if bounded else Fddp)(problem)
    solution = ours.solve(guess)
    iterations = {"lgmpc": solution.iterations}
    theirs = None
    if crocoddyl is not None:
        theirs = (crocoddyl.SolverBoxFDDP if bounded else crocoddyl.SolverFDDP)(pair.theirs)
        theirs.problem.nthreads = 1  # it would use all cores otherwise, regardless of OMP_NUM_THREADS
    line = f"\n{name}, N = {problem.nodes}: {solution.status.name.lower()}, cost {solution.cost:.9g}"
    if theirs is not None:
        theirs.solve(list(guess.xs), list(guess.us), 100, False)
        iterations["crocoddyl"] = theirs.iter + 1
        line += f" (Crocoddyl's differs by {theirs.cost - solution.cost:.1e})"
    print(f"{line}; median (least)")
    figures = []
    for key, times in rounds_of(parts(ours, guess, theirs), rounds).items():
        solver, part = key.split("/")
        taken = iterations[solver] if part == "solve" else 1
        median, least = float(np.median(times)), float(times.min())
        figures.append(Figure(name, solver, part, problem.nodes, taken, median, least))
    for part in ("linearisation", "backward sweep", "forward sweep"):
        row(f"{part}, us a stage", figures, part, lambda f, ms: 1e3 * ms / f.nodes)
    row("whole iteration, ms", figures, "solve", lambda f, ms: ms / f.iterations)
    row("to convergence, ms", figures, "solve", lambda f, ms: ms)
    print(f"  {'iterations':26s}" + "".join(f"{solver:>12s} {n:7d}          " for solver, n in iterations.items()))
    return figures


def row(title: str, figures: list[Figure], part: str, scale: Callable[[Figure, float], float]) -> None:
    """Print one quantity of all solvers, and the ratio of the first to the second."""
    chosen = [f for f in figures if f.part == part]
    values = [(scale(f, f.median_ms), scale(f, f.least_ms)) for f in chosen]
    cells = "".join(f"{f.solver:>12s} {m:7.2f} ({s:7.2f})" for f, (m, s) in zip(chosen, values, strict=True))
    ratio = f"   ratio {values[0][0] / values[1][0]:.2f} ({values[0][1] / values[1][1]:.2f})" if len(values) > 1 else ""
    print(f"  {title:26s}{cells}{ratio}")


def constrained(stance: Stance, push: float = PUSH, facets: int = 4, friction: float = 0.5) -> ShootingProblem:
    """The stance, pushed harder, with friction cones and torque limits that hold."""
    dynamics = ContactForwardDynamics(stance.robot.model, FEET)
    limits = np.full(dynamics.nu, 1.8)
    costs = [
        CostItem("com", CoMPosition(stance.com), stance.com_weight),
        CostItem("posture", StateError(dynamics.state, stance.x_reference), stance.state_weights),
        CostItem("effort", Control(dynamics.nu), stance.effort_weight),
    ]
    rows = [ConstraintItem("motors", Control(dynamics.nu), -limits, limits)]
    rows += [ConstraintItem(f"cone_{foot}", FrictionCone(foot, facets, friction), 0.0, np.inf) for foot in FEET]
    problem = ShootingProblem(MultibodyAction("hard_stance", dynamics, costs, rows), stance.nodes)
    problem.set("duration", stance.dt)
    problem.set("contact_points", stance.feet.ravel())
    problem.set("contact_gains", GAINS)
    x0 = stance.x0
    x0[stance.robot.nq : stance.robot.nq + 6] *= push
    problem.set_initial_state(x0)
    return problem


def time_constrained(nodes: int, rounds: int) -> list[Figure]:
    """Time every iteration of the SQP, by the solver of its quadratic programmes."""
    stance = Stance(nodes)
    problem = constrained(stance)
    guess = Trajectory(np.tile(problem.x0, (nodes + 1, 1)), stance.guess().us)
    figures = []
    print(f"\nstance with hard friction cones and torque limits, N = {nodes}: SQP; median (least), ms")
    for solver, make in (("active_set", None), ("piqp", lambda qp: PiqpSolver(qp, 1e-11, 200))):
        with reporting(print):
            sqp = LineSearchSqp(problem, qp_solver=make)
        all_times = []
        for _ in range(rounds):
            clock = [time.thread_time()]
            solution = sqp.solve(guess, callback=lambda _, clock=clock: clock.append(time.thread_time()))
            all_times.append(1e3 * np.diff(clock))
        median, least = np.median(all_times, axis=0), np.min(all_times, axis=0)
        active = int((np.abs(solution.multipliers) > 1e-6).sum())
        print(f"  {solver}: {solution.status.name.lower()}, cost {solution.cost:.9g}, {active} active rows")
        print("    each iteration:", " ".join(f"{m:.2f} ({s:.2f})" for m, s in zip(median, least, strict=True)))
        print(
            f"    mean {median.mean():.2f} ({least.mean():.2f}), to convergence {median.sum():.2f} ({least.sum():.2f})"
        )
        figures += [
            Figure("constrained stance", solver, f"iteration {i + 1}", nodes, 1, float(m), float(s))
            for i, (m, s) in enumerate(zip(median, least, strict=True))
        ]
    return figures


def _gait(name: str, *, theirs: bool) -> Pair:
    return paired(anymal_gait(name), theirs=theirs)


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, nargs="+", default=[20, 50, 100], help="horizons of the stance")
    parser.add_argument("--problems", nargs="+", help="beginnings of names (stance, trot, ANYmal, Talos, constrained)")
    parser.add_argument("--rounds", type=int, default=30, help="rounds of each measurement")
    add_json_option(parser)
    options = parser.parse_args()
    crocoddyl: Any = None
    packages: dict[str, str] = {}
    if importlib.util.find_spec("crocoddyl") is None:
        print("Crocoddyl is not installed: only lgmpc is timed")
    else:
        crocoddyl, packages = importlib.import_module("crocoddyl"), {"crocoddyl": version("crocoddyl")}
    print_machine(packages)
    theirs = crocoddyl is not None
    problems: dict[str, Callable[[], Pair]] = {
        **{f"stance {nodes}": partial(paired, Stance(nodes), theirs=theirs) for nodes in options.nodes},
        "trot": partial(paired, Trot(), theirs=theirs),
        **{f"ANYmal {gait}": partial(_gait, gait, theirs=theirs) for gait in ANYMAL_GAITS},
    }
    if theirs:
        problems |= {
            "Talos": partial(talos, still=()),
            "arm": arm,
            "quadrotor": quadrotor,
            "bounded quadrotor": partial(quadrotor, bounds=(1.0, 6.0)),
        }
    chosen = [name for name in problems if any(name.startswith(each) for each in options.problems or ("",))]
    figures = [f for name in chosen for f in compare(name, problems[name](), options.rounds, crocoddyl)]
    if not options.problems or "constrained" in options.problems:
        figures += time_constrained(20, options.rounds)
    write_record(options.json, [asdict(figure) for figure in figures], packages)


if __name__ == "__main__":
    main()
