"""Time the compiled stage of Solo12's full-body dynamics: size, compile time, time of one evaluation.

    python scripts/bench_actions.py [--repeat 2000]

Stance on four feet: state and control cost, and the friction pyramid as a barrier on each foot. Set LGMPC_CACHE_DIR to
an empty folder to time the compiler instead of the cache.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.compile import CompiledFunction, compile_function
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


def run_time(function: CompiledFunction, repeat: int) -> float:
    """Return the median time of one evaluation, s."""
    samples = []
    for _ in range(repeat):
        start = time.perf_counter()
        function.run()
        samples.append(time.perf_counter() - start)
    return float(np.median(samples))


def main() -> None:
    """Print one line a function."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=2000, help="evaluations to take the median of")
    repeat = parser.parse_args().repeat
    action, x = stance()
    u = np.zeros(action.nu)
    print(f"{'function':<12} {'instructions':>12} {'compile s':>10} {'run us':>8}")
    for label, function, arguments in (
        ("values", action.value_function, (x, u, action.parameters.default)),
        ("expansion", action.quadratic_function, (x, u, x, action.parameters.default)),
    ):
        start = time.perf_counter()
        compiled = compile_function(function)
        took = time.perf_counter() - start
        for buffer, argument in zip(compiled.inputs, arguments, strict=True):
            buffer[...] = argument
        print(f"{label:<12} {function.n_instructions():>12} {took:>10.1f} {1e6 * run_time(compiled, repeat):>8.1f}")


if __name__ == "__main__":
    main()
