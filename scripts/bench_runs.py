"""Figures of shipped configs: what `lgmpc run NAME --set ...` prints, for each of them in turn.

python scripts/bench_runs.py [--only solo12_fast]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import logging
from dataclasses import asdict
from typing import Any

from record import add_json_option, print_machine, write_record

from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config

RUNS: dict[str, tuple[str, ...]] = {
    "solo12_balance": (),
    "solo12_balance alone": ("mpc.enabled=false",),
    "solo12_balance without the observer": ("mpc.observer_time_s=1000",),
    "solo12_balance on friction 0.4": ("plant.friction=0.4",),
    "solo12_balance_full_body": (),
    "solo12_strong_push": (),
    "solo12_strong_push alone": ("mpc.enabled=false",),
    "solo12_strong_push by Pinocchio": ("plant.kind=pinocchio",),
    "solo12_velocity": (),
    "solo12_fast": (),
}
"""By a name that begins with the config's: the values that are set."""


def figures_of(name: str) -> dict[str, Any]:
    """Run one of them and return its metrics, as run.json has them, and its command."""
    config, overrides = name.split()[0], RUNS[name]
    metrics = prepare(load_config(config, list(overrides))).run(lambda progress: None).metrics
    assert metrics is not None
    command = f"lgmpc run {config}" + "".join(f" --set {each}" for each in overrides)
    return {"command": command, **asdict(metrics)}


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="beginnings of names")
    add_json_option(parser)
    options = parser.parse_args()
    logging.getLogger("lgmpc").setLevel(logging.ERROR)  # falls are figures here
    print_machine()
    found = {}
    for name in (name for name in RUNS if any(map(name.startswith, options.only))):
        found[name] = figures_of(name)
        fate = "fell" if found[name]["fell"] else "stayed up"
        print(f"{name:38s} {fate:10s} base moved by {1e3 * found[name]['max_displacement_m']:6.1f} mm", flush=True)
    write_record(options.json, found)


if __name__ == "__main__":
    main()
