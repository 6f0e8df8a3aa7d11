"""Files of lgmpc that a control tick passes through, from the state to the torque and around it.

Runs a closed loop until it stands, then traces ticks: every file of which a function is called counts. A tick between
two plans, a tick that plans, and of both the part that is the controller's.

    python scripts/files_of_a_tick.py [--config solo12_balance]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import lgmpc
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.interface import Command, RobotState

ROOT = Path(lgmpc.__file__).parent
CONFIGS = Path(__file__).parent.parent / "configs"


class Trace:
    """Collects the files of the functions that are called, in the order of their first call."""

    def __init__(self) -> None:
        self.files: dict[str, None] = {}

    def __enter__(self) -> Trace:
        sys.setprofile(self._called)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _called(self, frame: FrameType, event: str, _: Any) -> None:
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(str(ROOT)):
            self.files[str(Path(name).relative_to(ROOT))] = None


def trace_ticks(session: ClosedLoopSession, first: int, count: int) -> dict[tuple[str, bool], list[str]]:
    """Return the files of a tick, by part (``loop`` or ``controller``) and whether the tick plans."""
    controller = session.controller
    session.advance(lambda progress: None, first)
    plain = controller.update
    found: dict[tuple[str, bool], list[str]] = {}
    inner = Trace()

    def update(state: RobotState) -> Command:
        sys.setprofile(None)
        with inner:
            command = plain(state)
        sys.setprofile(outer._called)
        return command

    controller.update = update  # type: ignore[method-assign]
    for tick in range(first + 1, first + count):
        inner.files, outer = {}, Trace()
        with outer:
            session.advance(lambda progress: None, tick)
        plans = controller.report.planned
        own = {"config/closed_loop.py", *inner.files}
        around = [name for name in outer.files if name not in own and not name.startswith("config/build")]
        found["controller", plans] = list(inner.files)
        found["loop", plans] = ["config/closed_loop.py", *around]
    return found


def main() -> None:
    """Trace and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="solo12_balance", help="name of a config of a closed loop")
    arguments = parser.parse_args()
    session = prepare(load_config(CONFIGS / f"{arguments.config}.yaml"))
    assert isinstance(session, ClosedLoopSession)
    found = trace_ticks(session, 1500, 12)
    for plans in (False, True):
        if ("controller", plans) not in found:
            continue
        controller, loop = found["controller", plans], found["loop", plans]
        kind = "that plans" if plans else "between two plans"
        print(f"a tick {kind}: {len(controller)} files from the state to the torque, {len(loop)} around it")
        for names in (controller, loop):
            for name in names:
                print(f"    {name:40s} {len((ROOT / name).read_text().splitlines()):4d} lines")
            print()


if __name__ == "__main__":
    main()
