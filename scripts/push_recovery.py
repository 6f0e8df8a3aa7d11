"""Largest push that Solo12 survives: with its feet where they were, with steps, or while it walks.

On the benchmark plant (MuJoCo) the base is pushed for 0.2 s by a constant horizontal force; for each direction the
largest impulse is found by bisection. Half a second into standing, "stay" means that the robot is up two seconds later
and every contact point is within 2 cm of where it was; this is compared between the whole-body QP alone and with the
MPC above it. With steps or a command, "survived" and "recovered" mean what they mean in bench_locomotion.py.

    python scripts/push_recovery.py                      # friction 0.6, 12 directions: some minutes
    python scripts/push_recovery.py --stepping           # standing; it may step
    python scripts/push_recovery.py --command 0.5,0,0 --phases 4   # m/s ahead, m/s left, rad/s
    python scripts/push_recovery.py --friction 0.4 0.5 0.7 --directions 12 --set mpc.qp_solver=piqp
    python scripts/push_recovery.py --model full_body    # what predicts

What is estimated only while the robot walks, such as joint friction, it learns in a warm-up: a trot, after which it
stands again for a second before it is pushed (with the MPC: without a plan it only stands).

    python scripts/push_recovery.py --warm-up 3 --set plant.joint_friction_nm=0.1 --set joint_friction={}
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import logging
from functools import partial
from pathlib import Path

import numpy as np
from bench_locomotion import FOOT_LIMIT_M, STEPPING, Bench, Motion, largest, pushes
from record import add_json_option, print_machine, write_record

from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config

CONFIGS = Path(__file__).parent.parent / "configs"
MODELS = {"centroidal": "", "full_body": "_full_body"}
DURATION_S = 2.5
START_S = 0.5
WARM_UP_M_S, STOP_S = 0.3, 1.0
CONTROLLERS = {"whole-body QP": "mpc.enabled=false", "MPC + whole-body QP": "mpc.enabled=true"}


def stays(config_file: Path, overrides: list[str], warm_up: float, angle: float, impulse: float) -> bool:
    """Return whether the robot is up, its feet where they were, after a push of ``impulse`` N.s towards ``angle``.

    With a ``warm_up``, s, it trots for so long and stands again before.
    """
    go, stop = f"{{at_s: 0.0, velocity_m_s: [{WARM_UP_M_S}, 0, 0]}}", f"{{at_s: {warm_up}, velocity_m_s: [0, 0, 0]}}"
    stands = warm_up + STOP_S if warm_up else 0.0
    push = [float(impulse * np.cos(angle)), float(impulse * np.sin(angle)), 0.0]
    keys = [
        f"commands=[{f'{go}, {stop}' if warm_up else ''}]",
        f"pushes=[{{body: base_link, time_s: {stands + START_S}, duration_s: 0.2, impulse_ns: {push}}}]",
        f"duration_s={stands + DURATION_S}",
    ]
    result = prepare(load_config(config_file, [*overrides, *keys])).run(lambda progress: None)
    if result.metrics is None or result.metrics.fell:
        return False
    feet = result.log.contact_points[result.log.time >= stands, :, :2]
    return bool(np.linalg.norm(feet - feet[0], axis=2).max() < FOOT_LIMIT_M)


def motion(text: str) -> Motion:
    """Return the command ``VX,VY,W``."""
    try:
        vx, vy, yaw_rate = (float(number) for number in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got '{text}', expected three numbers VX,VY,W: m/s, m/s, rad/s") from None
    return Motion(vx, vy, yaw_rate)


def compare_standing(
    config_file: Path, same: list[str], warm_up: float, angles: np.ndarray, resolution: float
) -> dict[str, dict[str, object]]:
    """Print and return by controller the largest pushes that the feet hold in place."""
    found: dict[str, dict[str, object]] = {}
    # Without a plan the robot only stands.
    for name, switch in [*CONTROLLERS.items()][1 if warm_up else 0 :]:
        pushed = partial(stays, config_file, [*same, switch], warm_up)
        held = [largest(partial(pushed, angle), resolution) for angle in angles]
        print(
            f"{name:20s} stay: median {np.median(held):.2f}  min {min(held):.2f}  max {max(held):.2f} N.s", flush=True
        )
        found[name] = {"stay_ns": [round(each, 3) for each in held]}
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", choices=list(MODELS), default="centroidal", help="what predicts")
    parser.add_argument("--friction", type=float, nargs="+", default=[0.6], help="of floor and controller")
    parser.add_argument("--command", type=motion, metavar="VX,VY,W", help="to trot at meanwhile, m/s, m/s, rad/s")
    parser.add_argument("--stepping", action="store_true", help="it may step where it stands")
    parser.add_argument("--warm-up", type=float, default=0.0, help="it trots for so long before, s; feet in place")
    parser.add_argument("--directions", type=int, default=12)
    parser.add_argument("--phases", type=int, default=1, help="of the gait at which pushes begin, with --command")
    parser.add_argument("--resolution", type=float, default=0.05, help="N.s")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    add_json_option(parser)
    arguments = parser.parse_args()
    logging.getLogger("lgmpc").setLevel(logging.ERROR)  # falls are figures here
    print_machine()
    angles = 2.0 * np.pi * np.arange(arguments.directions) / arguments.directions
    config_file = CONFIGS / f"solo12_balance{MODELS[arguments.model]}.yaml"
    moving = arguments.command is not None and arguments.command.moves
    results = []
    for friction in arguments.friction:
        print(f"\nfriction {friction:.2f}")
        same = [f"{section}.friction={friction}" for section in ("plant", "mpc", "wbc")] + arguments.overrides
        found: dict[str, object]
        if moving or arguments.stepping:
            bench = Bench(config_file, "trot", [*same, STEPPING] if arguments.stepping else same)
            phases = arguments.phases if moving else 1
            command = arguments.command or Motion()
            found = pushes(bench, command, "base_link", arguments.directions, phases, arguments.resolution)
        else:
            found = {
                "controllers": compare_standing(config_file, same, arguments.warm_up, angles, arguments.resolution)
            }
        results.append({"friction": friction, **found})
    write_record(arguments.json, results)


if __name__ == "__main__":
    main()
