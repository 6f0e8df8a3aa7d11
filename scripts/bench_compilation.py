"""Measure what has to be compiled, in an empty cache: a robot's first problem, another cost, another solver, a weight.

    python scripts/bench_compilation.py --robots solo12 anymal_c talos

For each step: libraries built, processor time of the C compiler, processor time of Python (expressions and code), and
elapsed time. Dynamics are compiled apart from costs and shared by solvers, so that only the first step takes long.
Then the same for whole controllers of configs: in an empty cache, with their libraries but not the index of what they
were written from, and again, as every point of a sweep does.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import argparse
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import example_robot_data
import numpy as np
from record import add_json_option, print_machine, write_record

from lgmpc import load_config
from lgmpc.actions import Contact, ContactForwardDynamics, MultibodyAction
from lgmpc.compile import reporting
from lgmpc.config.build import prepare
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control, FrameTranslation, StateError
from lgmpc.ocp import ShootingProblem
from lgmpc.solvers import Fddp, LineSearchSqp

FEET = {
    "solo12": ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"],
    "anymal_c": ["LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"],
    "talos": [Contact("left_sole_link", 6), Contact("right_sole_link", 6)],
}


@dataclass(frozen=True)
class Step:
    """Duration of a step.

    Attributes:
        libraries: built.
        compiler_s: processor time of the C compiler.
        python_s: processor time of this process.
        elapsed_s: on the clock.
    """

    libraries: int
    compiler_s: float
    python_s: float
    elapsed_s: float


def measure(call: Callable[[], object]) -> Step:
    """Call, and measure."""
    messages: list[str] = []
    start, children, mine = time.perf_counter(), _children(), time.process_time()
    with reporting(messages.append):
        call()
    built = sum("once, later runs load it" in message for message in messages)
    return Step(built, _children() - children, time.process_time() - mine, time.perf_counter() - start)


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def problem_of(robot: str, frame: str | None) -> ShootingProblem:
    """Return a problem of a robot with a cost of its posture, its efforts, and of a frame's place."""
    model = example_robot_data.load(robot).model
    dynamics = ContactForwardDynamics(model, FEET[robot])
    costs = [CostItem("posture", StateError(dynamics.state)), CostItem("effort", Control(dynamics.nu), 1e-3)]
    if frame is not None:
        costs.append(CostItem("place", FrameTranslation(frame)))
    return ShootingProblem(MultibodyAction(f"{robot}_task", dynamics, costs), 10)


def steps_of(robot: str) -> dict[str, Step]:
    """Measure the steps with one robot."""
    first, last = FEET[robot][0], problem_of(robot, None).action.state.model.frames[-1].name
    name = first if isinstance(first, str) else first.frame
    problem = problem_of(robot, name)

    def weight() -> None:
        problem.set("place_weight", np.full(3, 5.0))
        Fddp(problem)

    return {
        "first problem, FDDP": measure(lambda: Fddp(problem_of(robot, None))),
        "one cost more": measure(lambda: Fddp(problem_of(robot, name))),
        "another cost instead": measure(lambda: Fddp(problem_of(robot, last))),
        "SQP of the same problem": measure(lambda: LineSearchSqp(problem)),
        "another weight": measure(weight),
    }


def builds_of(config: str, cache: Path) -> dict[str, Step]:
    """Measure builds of a closed loop; all but the last write every expression."""
    loop = load_config(config)

    steps = {"empty cache": measure(lambda: prepare(loop))}
    shutil.rmtree(cache / "kernels")
    return steps | {"libraries, no index": measure(lambda: prepare(loop)), "again": measure(lambda: prepare(loop))}


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", choices=sorted(FEET), default=list(FEET))
    parser.add_argument("--configs", nargs="*", default=["solo12_velocity_inekf", "solo12_balance_full_body"])
    add_json_option(parser)
    options = parser.parse_args()
    print_machine()
    taken: dict[str, dict[str, dict[str, float]]] = {}
    print(f"{'':49s}{'libraries':>10s}{'compiler, s':>13s}{'Python, s':>11s}{'elapsed, s':>12s}")
    for subject in (*options.robots, *options.configs):
        with tempfile.TemporaryDirectory() as cache:
            os.environ["LGMPC_CACHE_DIR"] = cache
            steps = steps_of(subject) if subject in FEET else builds_of(subject, Path(cache))
            for name, step in steps.items():
                figures = f"{step.libraries:10d}{step.compiler_s:13.1f}{step.python_s:11.2f}{step.elapsed_s:12.2f}"
                print(f"{subject:25s}{name:24s}{figures}", flush=True)
                taken.setdefault(subject, {})[name] = asdict(step)
    write_record(options.json, taken)


if __name__ == "__main__":
    main()
