"""Time the compiled stage of Solo12's full-body dynamics: size, compile time, time of a stage, alone and in a batch.

    python scripts/bench_actions.py [--repeat 2000] [--stages 20]

Stance on four feet: state and control cost, and the friction pyramid as a barrier on each foot. Set LGMPC_CACHE_DIR to
an empty folder to time the compiler instead of the cache.
"""

from __future__ import annotations

import argparse
import os
import time

import casadi as ca
import numpy as np
from record import add_json_option, print_machine, write_record

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.compile import BatchKernel, StageKernel
from lgmpc.costs import CostItem, QuadraticBarrier
from lgmpc.costs.library import Control, FrictionCone, StateError
from lgmpc.robot import RobotSpec, load_robot

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


def stance() -> tuple[MultibodyAction, np.ndarray]:
    """Return the action, and the reference state."""
    spec = RobotSpec(
        model="solo12",
        contact_frames=FEET,
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=(-3.0, 3.0),
        armature_kg_m2=3.6e-4,
    )
    robot = load_robot(spec)
    dynamics = ContactForwardDynamics(robot.model, FEET)
    costs = [
        CostItem("posture", StateError(dynamics.state, robot.x_reference)),
        CostItem("effort", Control(dynamics.nu), weight=1e-3),
        *(CostItem(f"cone_{foot}", FrictionCone(foot, 4), 10.0, QuadraticBarrier(0.0, np.inf)) for foot in FEET),
    ]
    return MultibodyAction("solo12_stance", dynamics, costs), robot.x_reference


def measure(
    kernel: type[StageKernel], function: ca.Function, point: list[np.ndarray], options: argparse.Namespace
) -> dict[str, float]:
    """Return processor time of the compilation, s, and median and least time of a stage, us."""
    start = sum(os.times()[:4])
    made = kernel(function)
    took = sum(os.times()[:4]) - start
    given = [np.tile(argument, (options.stages, 1)) for argument in point]
    results = [np.zeros((options.stages, function.numel_out(i))) for i in range(function.n_out())]
    call = made.bind(
        options.stages, **dict(zip((*function.name_in(), *function.name_out()), (*given, *results), strict=True))
    )
    samples = []
    for _ in range(options.repeat):
        begun = time.perf_counter()
        call()
        samples.append(time.perf_counter() - begun)
    median, least = (1e6 * float(value) / options.stages for value in (np.median(samples), min(samples)))
    return {"compiler_s": took, "median_us": median, "least_us": least}


def main() -> None:
    """Print one line a function."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=2000, help="evaluations to take the median of")
    parser.add_argument("--stages", type=int, default=20, help="stages of an evaluation")
    add_json_option(parser)
    options = parser.parse_args()
    print_machine()
    figures = {}
    action, x = stance()
    u = np.zeros(action.nu)
    print(f"{'':<25} {'one by one':>27} {'in lanes':>27}")
    print(f"{'function':<12} {'instructions':>12}" + 2 * f" {'compile s':>10} {'us/stage':>16}")
    for label, function, arguments in (
        ("values", action.value_function, (x, u, action.parameters.default)),
        ("expansion", action.quadratic_function, (x, u, x, action.parameters.default)),
    ):
        kernels = (("one by one", StageKernel), ("in lanes", BatchKernel))
        each = {name: measure(kernel, function, list(arguments), options) for name, kernel in kernels}
        columns = [
            " {compiler_s:>10.1f} {median_us:>8.1f} ({least_us:5.1f})".format(**taken) for taken in each.values()
        ]
        print(f"{label:<12} {function.n_instructions():>12}{''.join(columns)}")
        figures[label] = {"instructions": function.n_instructions(), **each}
    write_record(options.json, figures)


if __name__ == "__main__":
    main()
