"""Speed of the closed loop: real-time factor, the share of each part, time to a first command.

Runs the balance config in this process several times and prints medians with the machine and the versions beside them
(the factor by the wall clock, and by processor time, which other processes on the machine disturb less);
once more with a stopwatch around every part; then the Gymnasium environment of a walking robot, if it is installed,
beside the same loop without it; then starts fresh processes to time what a user waits for, with an empty
compile cache and with a warm one.

    python scripts/bench_loop.py [--model centroidal|full_body] [--repeats 5] [--skip-start]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from record import add_json_option, print_machine, write_record

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config

CONFIGS = Path(__file__).parent.parent / "configs"
MODELS = {"centroidal": "", "full_body": "_full_body"}
FIRST_COMMAND = """
import os; os.environ.setdefault("OMP_NUM_THREADS", "1")
from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config
session = prepare(load_config({config!r}, ["duration_s=0.001", "log.rate_hz=1000"]))
session.run(lambda progress: None)
"""


class Stopwatch:
    """Adds up the time within methods, each without the time within the others that it calls.

    Attributes:
        spent: s, by part.
    """

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._within = 0.0

    def watch(self, part: str, owner: Any, *names: str) -> None:
        """Count the time within these methods of ``owner`` as ``part``."""
        self.spent.setdefault(part, 0.0)
        for name in names:
            setattr(owner, name, self._timed(part, getattr(owner, name)))

    def _timed(self, part: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            before, self._within = self._within, 0.0
            started = time.perf_counter()
            result = method(*args, **kwargs)
            elapsed = time.perf_counter() - started
            self.spent[part] += elapsed - self._within
            self._within = before + elapsed
            return result

        return call


def part_shares(config_file: Path, overrides: list[str]) -> tuple[dict[str, float], int]:
    """Return the seconds that a run spends in each part, the rest as the interpreter's, and its ticks."""
    session = prepare(load_config(config_file, overrides))
    assert isinstance(session, ClosedLoopSession)
    stopwatch, wbc, planner = Stopwatch(), session.controller.wbc, session.controller.planner
    stopwatch.watch("plant step", session.plant, "step")
    stopwatch.watch("plant access", session.plant, "sense", "set_wrench")
    stopwatch.watch("recording", session.recorder, "append", "record_mpc")
    stopwatch.watch("sense", wbc, "sense")
    stopwatch.watch("QP data", wbc.qp, "update")
    stopwatch.watch("QP solver", wbc.solver, "solve")
    if planner is not None:
        stopwatch.watch("MPC", planner.mpc, "update")
        stopwatch.watch("plan sampling", planner, "plan_from", "follow")
    started = time.perf_counter()
    session.run(lambda progress: None)
    elapsed = time.perf_counter() - started
    return {**stopwatch.spent, "interpreter": elapsed - sum(stopwatch.spent.values())}, session.ticks.count


def environment_factors(duration_s: float, rate_hz: float = 50.0) -> dict[str, float]:
    """Return the real-time factors by processor time of the walking environment, and of ``lgmpc run``'s loop."""
    from lgmpc.gym import LocomotionEnv

    env = LocomotionEnv("solo12_velocity", overrides=["pushes=[]"], rate_hz=rate_hz, episode_s=duration_s)
    env.reset(seed=0, options={"goal": [0.5, 0.0, 0.0]})
    still, steps = np.zeros(env.action_space.shape), round(duration_s * rate_hz) - 1
    begin = time.process_time()
    for _ in range(steps):
        env.step(still)
    stepped = steps / rate_hz / (time.process_time() - begin)
    walk = "commands=[{at_s: 0, velocity_m_s: [0.5, 0, 0], gait: trot}]"
    session = prepare(load_config("solo12_velocity", [walk, "pushes=[]", f"duration_s={duration_s}"]))
    assert isinstance(session, ClosedLoopSession)
    begin = time.process_time()
    session.advance(lambda progress: None)
    return {"environment": stepped, "loop": duration_s / (time.process_time() - begin)}


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
    add_json_option(parser)
    arguments = parser.parse_args()
    print_machine()
    config_file = CONFIGS / f"solo12_balance{MODELS[arguments.model]}.yaml"
    overrides = [f"plant.kind={arguments.plant}"]
    runs, processor = [], []
    for _ in range(arguments.repeats):
        session = prepare(load_config(config_file, overrides))
        assert isinstance(session, ClosedLoopSession)
        begin = time.process_time()
        session.advance(lambda progress: None)
        processor.append(session.ticks.end / (time.process_time() - begin))
        metrics = session.run(lambda progress: None).metrics
        if metrics is not None and metrics.wbc_ms and metrics.mpc_ms:
            runs.append(metrics)
    updates = 1e3 / load_config(config_file).mpc.rate_hz
    print(f"MPC: {arguments.model}, one update every {updates:g} ms")
    figures: dict[str, Any] = {}
    for name, timings in (("MPC update", [m.mpc_ms for m in runs]), ("whole-body tick", [m.wbc_ms for m in runs])):
        p50, p99 = (np.median([getattr(t, q) for t in timings]) for q in ("p50", "p99"))
        figures[name] = {"p50_ms": float(p50), "p99_ms": float(p99)}
        print(f"{name:22s} median {1e3 * p50:6.0f} us   99th percentile {1e3 * p99:6.0f} us")
    factors = [m.real_time_factor for m in runs]
    print(f"real-time factor       median {np.median(factors):6.2f}      of {len(factors)} runs of 10 s, one process")
    print(f"  by processor time    median {np.median(processor):6.2f}")
    shares, ticks = part_shares(config_file, overrides)
    figures["real-time factor"] = float(np.median(factors))
    figures["real-time factor by processor time"] = float(np.median(processor))
    figures["parts"] = {
        part: {"us_a_tick": 1e6 * s / ticks, "share": s / sum(shares.values())} for part, s in shares.items()
    }
    print("\npart                us a tick   share")
    for part, spent in sorted(shares.items(), key=lambda item: -item[1]):
        print(f"{part:18s} {1e6 * spent / ticks:10.1f} {100 * spent / sum(shares.values()):6.1f} %")
    if find_spec("gymnasium") is not None:
        walking = [environment_factors(8.0) for _ in range(arguments.repeats)]
        for name in ("environment", "loop"):
            figures[f"walking {name}"] = float(np.median([each[name] for each in walking]))
            print(f"walking {name:14s} median {figures[f'walking {name}']:6.2f} times real time by processor time")
    print()
    if not arguments.skip_start:
        with tempfile.TemporaryDirectory() as cache:
            cold = first_command_s(config_file, cache)
            warm = np.median([first_command_s(config_file, cache) for _ in range(3)])
        print(f"first command          {cold:.1f} s with an empty compile cache, {warm:.1f} s with a warm one")
        figures["first command"] = {"empty_cache_s": cold, "warm_cache_s": float(warm)}
    write_record(arguments.json, figures)


if __name__ == "__main__":
    main()
