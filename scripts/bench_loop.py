"""How fast the closed loop is: plant step, whole-body tick, MPC update, real-time factor, time to a first command.

Runs the balance config in this process several times and prints medians with the machine and the versions beside them;
then starts fresh processes to time what a user waits for, with an empty compile cache and with a warm one.

    python scripts/bench_loop.py [--model centroidal|kinodynamic|full_body|lqr] [--repeats 5] [--skip-start]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from lgmpc.config.build import build_plant, prepare
from lgmpc.config.loading import load_config
from lgmpc.config.robots import build_robot
from lgmpc.runs import host_info, versions

CONFIGS = Path(__file__).parent.parent / "configs"
MODELS = {"centroidal": "", "kinodynamic": "_kinodynamic", "full_body": "_full_body", "lqr": "_lqr"}
FIRST_COMMAND = """
import os; os.environ.setdefault("OMP_NUM_THREADS", "1")
from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config
session = prepare(load_config({config!r}, ["duration_s=0.001", "log.rate_hz=1000"]))
session.run(lambda progress: None)
"""


def plant_step_us(config_file: Path, overrides: list[str]) -> tuple[float, float]:
    """Return median microseconds of a plant step and of sensing, standing under the joint torques of a stiff PD."""
    config = load_config(config_file, overrides)
    robot = build_robot(config)
    plant = build_plant(config, robot)
    plant.reset(robot.x_reference)
    steps, senses = [], []
    for _ in range(3000):
        start = time.perf_counter()
        sample = plant.sense()
        sensed = time.perf_counter()
        joints, rates = sample.q[robot.joint_q], sample.v[robot.joint_v]
        torque = 20.0 * (robot.q_reference[robot.joint_q] - joints) - 0.3 * rates
        begin = time.perf_counter()
        plant.step(torque)
        steps.append(time.perf_counter() - begin)
        senses.append(sensed - start)
    return 1e6 * float(np.median(steps)), 1e6 * float(np.median(senses))


def first_command_s(config_file: Path, cache: str) -> float:
    """Return the seconds from starting Python to the first torque, with the compiled libraries of folder ``cache``."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", FIRST_COMMAND.format(config=str(config_file))],
        env={**os.environ, "LGMPC_CACHE_DIR": cache},
        check=True,
    )
    return time.perf_counter() - begin


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", choices=list(MODELS), default="centroidal", help="what predicts")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--plant", choices=["mujoco", "pinocchio"], default="mujoco")
    parser.add_argument("--skip-start", action="store_true", help="leave out the time to a first command")
    arguments = parser.parse_args()
    print(host_info())
    print(", ".join(f"{name} {version}" for name, version in versions().items()))
    config_file = CONFIGS / f"solo12_balance{MODELS[arguments.model]}.yaml"
    overrides = [f"plant.kind={arguments.plant}"]
    step, sense = plant_step_us(config_file, overrides)
    print(f"plant ({arguments.plant})       step {step:6.1f} us   sense {sense:6.1f} us")
    found = [
        prepare(load_config(config_file, overrides)).run(lambda progress: None).metrics
        for _ in range(arguments.repeats)
    ]
    runs = [metrics for metrics in found if metrics is not None and metrics.wbc_ms and metrics.mpc_ms]
    updates = 1e3 / load_config(config_file).mpc.rate_hz
    print(f"MPC: {arguments.model}, one update every {updates:g} ms")
    for name, timings in (("MPC update", [m.mpc_ms for m in runs]), ("whole-body tick", [m.wbc_ms for m in runs])):
        p50, p99 = (np.median([getattr(t, q) for t in timings]) for q in ("p50", "p99"))
        print(f"{name:22s} median {1e3 * p50:6.0f} us   99th percentile {1e3 * p99:6.0f} us")
    factors = [m.real_time_factor for m in runs]
    print(f"real-time factor       median {np.median(factors):6.2f}      of {len(factors)} runs of 10 s, one process")
    if not arguments.skip_start:
        with tempfile.TemporaryDirectory() as cache:
            cold = first_command_s(config_file, cache)
            warm = np.median([first_command_s(config_file, cache) for _ in range(3)])
        print(f"first command          {cold:.1f} s with an empty compile cache, {warm:.1f} s with a warm one")


if __name__ == "__main__":
    main()
