"""Heading of every benchmark, and its record with ``--json FILE``: figures, machine, versions, date."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.runs import host_info, versions

__all__ = ["add_json_option", "print_machine", "quantiles", "write_record"]


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--json FILE``."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures there, with the machine")


def print_machine(packages: Mapping[str, str] | None = None) -> None:
    """Print the machine and the versions; ``packages`` are more of these."""
    host = host_info()
    print(f"{host.cpu}, {host.cores} cores, {host.system}, OMP_NUM_THREADS={host.threads}")
    print(", ".join(f"{name} {version}" for name, version in {**versions(), **(packages or {})}.items()), flush=True)


def write_record(file: Path | None, figures: object, packages: Mapping[str, str] | None = None) -> None:
    """Write the figures of the command that runs, unless there is no file to write."""
    if file is None:
        return
    words = list(sys.argv[1:])
    if "--json" in words:
        at = words.index("--json")
        del words[at : at + 2]
    record: dict[str, Any] = {
        "command": " ".join(["python", f"scripts/{Path(sys.argv[0]).name}", *words]),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "host": asdict(host_info()),
        "versions": {**versions(), **(packages or {})},
        "figures": figures,
    }
    file.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def quantiles(times: np.ndarray) -> dict[str, float]:
    """Return median and 99th percentile, as run.json has them."""
    return {"p50": float(np.median(times)), "p99": float(np.percentile(times, 99.0))}
