"""Largest push that Solo12 survives with its feet where they were: whole-body QP alone, and with the MPC above it.

Standing on the benchmark plant (MuJoCo), the base is pushed for 0.2 s, half a second into standing, by a constant
horizontal force; for each direction the largest impulse is found by bisection. "Stay" means that the robot is up two
seconds later and every contact point is within 2 cm of where it was.

    python scripts/push_recovery.py                      # friction 0.6, 12 directions: some minutes
    python scripts/push_recovery.py --friction 0.4 0.5 0.7 --directions 12 --set mpc.qp_solver=piqp
    python scripts/push_recovery.py --model full_body    # or kinodynamic, lqr: what predicts
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import platform
from pathlib import Path

import numpy as np

from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config
from lgmpc.runs import versions

CONFIGS = Path(__file__).parent.parent / "configs"
MODELS = {"centroidal": "", "kinodynamic": "_kinodynamic", "full_body": "_full_body", "lqr": "_lqr"}
FOOT_LIMIT_M = 0.02
DURATION_S = 2.5
START_S = 0.5
CONTROLLERS = {"whole-body QP": "mpc.enabled=false", "MPC + whole-body QP": "mpc.enabled=true"}


def stays(config_file: Path, overrides: list[str], impulse: float, angle: float) -> bool:
    """Return whether the robot is up, its feet where they were, after a push of ``impulse`` N.s towards ``angle``."""
    push = [float(impulse * np.cos(angle)), float(impulse * np.sin(angle)), 0.0]
    pushes = f"pushes=[{{body: base_link, time_s: {START_S}, duration_s: 0.2, impulse_ns: {push}}}]"
    config = load_config(config_file, [*overrides, pushes, f"duration_s={DURATION_S}"])
    metrics = prepare(config).run(lambda progress: None).metrics
    return metrics is not None and not metrics.fell and metrics.max_foot_displacement_m < FOOT_LIMIT_M


def largest(config_file: Path, overrides: list[str], angle: float, resolution: float) -> float:
    """Return the largest impulse (N.s) for which :func:`stays` holds, by bisection."""
    low, high = 0.5, 8.0
    while high - low > resolution:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stays(config_file, overrides, middle, angle) else (low, middle)
    return low


def main() -> None:
    """Measure and print, as a table and as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", choices=list(MODELS), default="centroidal", help="what predicts")
    parser.add_argument("--friction", type=float, nargs="+", default=[0.6], help="of floor and controller")
    parser.add_argument("--directions", type=int, default=12)
    parser.add_argument("--resolution", type=float, default=0.05, help="N.s")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    packages = versions()
    print(platform.machine(), {name: packages[name] for name in ("pin", "mujoco", "proxsuite", "osqp")})
    angles = 2.0 * np.pi * np.arange(arguments.directions) / arguments.directions
    config_file = CONFIGS / f"solo12_balance{MODELS[arguments.model]}.yaml"
    results = []
    for friction in arguments.friction:
        for name, switch in CONTROLLERS.items():
            same = [f"{section}.friction={friction}" for section in ("plant", "mpc", "wbc")]
            overrides = [*same, switch, *arguments.overrides]
            found = [largest(config_file, overrides, angle, arguments.resolution) for angle in angles]
            print(
                f"friction {friction:.2f}  {name:20s} stay: median {np.median(found):.2f}"
                f"  min {min(found):.2f}  max {max(found):.2f} N.s",
                flush=True,
            )
            results.append({"friction": friction, "controller": name, "stay_ns": [round(x, 3) for x in found]})
    print(json.dumps(results))


if __name__ == "__main__":
    main()
