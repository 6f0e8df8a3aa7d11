"""Make the README's picture from a pushed run, standing or walking: the hardest push, its effect, and how it ended.

    python scripts/make_readme_picture.py runs/20260301T120000Z-solo12_trot_push .assets/trot_push.png

Needs playwright (``pip install -e ".[test]"``) and a Chromium.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from snapshot import headless_chromium, snapshots

from lgmpc.config import parse_config
from lgmpc.config.build import build_robot
from lgmpc.errors import LgmpcError
from lgmpc.runs import PushInterval, Run, RunFolder, RunLog, atomic_write, push_intervals
from lgmpc.runs.walking import body_velocity
from lgmpc.viz import replay_page, write_page

PANEL = (560, 460)
PAGE = """<!DOCTYPE html><meta charset="utf-8"><style>
body {{ margin: 0; display: flex; gap: 4px; background: #fff; font: 19px system-ui, "DejaVu Sans", sans-serif; }}
figure {{ margin: 0; width: {width}px; position: relative; }}
img {{ display: block; width: 100%; border-radius: 8px; }}
figcaption {{ position: absolute; left: 18px; bottom: 14px; color: #1d2733; }}
b {{ font-weight: 650; }}
</style>{figures}"""


@dataclass(frozen=True)
class Panel:
    """A moment of the run, s, and what it shows."""

    time_s: float
    caption: str


def main() -> int:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="run folder of a pushed run")
    parser.add_argument("picture", type=Path, help="PNG to write")
    arguments = parser.parse_args()
    try:
        run = RunFolder.load(arguments.run)
        pushes = push_intervals(run.log)
        if not pushes:
            print(f"{run.path}: the robot was not pushed in this run", file=sys.stderr)
            return 2
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(arguments.picture) as file:
            file.write(draw(run, pushes))
    except LgmpcError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"wrote {arguments.picture}")
    return 0


def draw(run: Run, pushes: tuple[PushInterval, ...]) -> bytes:
    """Return the PNG: panels side by side, each with its caption."""
    panels = choose_panels(run, pushes)
    robot = build_robot(parse_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
    with tempfile.TemporaryDirectory() as folder, headless_chromium() as browser:
        page = write_page(replay_page(robot, run), Path(folder) / "replay.html")
        start = float(run.log.time[0])
        pictures = snapshots(browser, page, [panel.time_s - start for panel in panels], size=PANEL, panels=False)
        figures = "".join(
            f'<figure><img src="data:image/png;base64,{base64.b64encode(picture).decode()}">'
            f"<figcaption><b>{panel.time_s:.2f} s</b> &ensp; {panel.caption}</figcaption></figure>"
            for picture, panel in zip(pictures, panels, strict=True)
        )
        tab = browser.new_page(viewport={"width": len(panels) * (PANEL[0] + 4) - 4, "height": PANEL[1]})
        tab.set_content(PAGE.format(width=PANEL[0], figures=figures))
        tab.evaluate("Promise.all([...document.images].map(image => image.decode()))")
        return tab.screenshot()


def choose_panels(run: Run, pushes: tuple[PushInterval, ...]) -> tuple[Panel, Panel, Panel]:
    """Return the hardest push, its largest effect, and the end of the calm after it."""
    log = run.log
    # To three digits, so that of equally hard ones the first is taken, whatever the rounding of its components.
    hardest = max(range(len(pushes)), key=lambda k: round(float(np.linalg.norm(pushes[k].impulse)), 3))
    push = pushes[hardest]
    until = pushes[hardest + 1].start if hardest + 1 < len(pushes) else float(log.time[-1])
    first, last = np.searchsorted(log.time, (push.start, max(push.end, until - 0.05))).tolist()
    pushed = push.start + 0.6 * (push.end - push.start)
    force = f"{np.linalg.norm(push.impulse) / (push.end - push.start):.3g} N for {push.end - push.start:.2g} s"
    if log.command[first].any():
        changes = np.flatnonzero((log.command[first:last] != log.command[first]).any(axis=1))
        last = first + int(changes[0]) - 1 if len(changes) else last
        speed = np.hypot(*log.command[first, :2])
        return Panel(pushed, f"{force}, at {speed:.2g} m/s"), *_walking_panels(log, first, last)
    return Panel(pushed, force), *_standing_panels(log, first, last)


def _standing_panels(log: RunLog, first: int, last: int) -> tuple[Panel, Panel]:
    base = log.base_pose[first : last + 1, :3]
    moved = 1e3 * np.linalg.norm(base - base[0], axis=1)
    furthest = int(np.argmax(moved))
    return (
        Panel(float(log.time[first + furthest]), f"the base gave way by {moved[furthest]:.1f} mm"),
        Panel(float(log.time[last]), f"and is back within {max(moved[-1], 0.1):.1f} mm"),
    )


def _walking_panels(log: RunLog, first: int, last: int) -> tuple[Panel, Panel]:
    off = (body_velocity(log) - log.command)[first : last + 1, :2]
    fastest = int(np.argmax(np.linalg.norm(off, axis=1)))
    stride = round(log.gait_period_s[last] / np.median(np.diff(log.time)))
    rest = float(np.linalg.norm(off[-stride:].mean(axis=0)))
    return (
        Panel(float(log.time[first + fastest]), f"{np.linalg.norm(off[fastest]):.2f} m/s off its velocity"),
        Panel(
            float(log.time[last]), f"back at {np.hypot(*log.command[last, :2]):.2g} m/s, within {1e3 * rest:.0f} mm/s"
        ),
    )


if __name__ == "__main__":
    sys.exit(main())
