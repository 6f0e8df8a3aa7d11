"""Make the README's picture from a pushed run: the hardest push, how far the robot gave way, and how it ended.

    python scripts/make_readme_picture.py runs/20260301T120000Z-solo12_balance .assets/balance.png

Needs playwright (``pip install -e ".[test]"``) and a Chromium.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from pathlib import Path

import numpy as np

from lgmpc.config import parse_config
from lgmpc.config.build import build_robot
from lgmpc.errors import LgmpcError
from lgmpc.runs import PushInterval, Run, RunFolder, atomic_write, push_intervals
from lgmpc.viz import replay_page, write_page
from lgmpc.viz.snapshot import headless_chromium, snapshots

PANEL = (560, 460)
PAGE = """<!DOCTYPE html><meta charset="utf-8"><style>
body {{ margin: 0; display: flex; gap: 4px; background: #fff; font: 19px system-ui, "DejaVu Sans", sans-serif; }}
figure {{ margin: 0; width: {width}px; position: relative; }}
img {{ display: block; width: 100%; border-radius: 8px; }}
figcaption {{ position: absolute; left: 18px; bottom: 14px; color: #1d2733; }}
b {{ font-weight: 650; }}
</style>{figures}"""


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
            print(f"{run.path}: nobody pushed the robot in this run", file=sys.stderr)
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
    moments, captions = tell(run, pushes)
    robot = build_robot(parse_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
    with tempfile.TemporaryDirectory() as folder, headless_chromium() as browser:
        page = write_page(replay_page(robot, run), Path(folder) / "replay.html")
        start = float(run.log.time[0])
        pictures = snapshots(browser, page, [moment - start for moment in moments], size=PANEL, panels=False)
        figures = "".join(
            f'<figure><img src="data:image/png;base64,{base64.b64encode(picture).decode()}">'
            f"<figcaption>{caption}</figcaption></figure>"
            for picture, caption in zip(pictures, captions, strict=True)
        )
        tab = browser.new_page(viewport={"width": len(moments) * (PANEL[0] + 4) - 4, "height": PANEL[1]})
        tab.set_content(PAGE.format(width=PANEL[0], figures=figures))
        tab.evaluate("Promise.all([...document.images].map(image => image.decode()))")
        return tab.screenshot()


def tell(run: Run, pushes: tuple[PushInterval, ...]) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Choose three moments, s, and say what they show: the hardest push, where the base gave way most, and the rest."""
    log = run.log
    # To three digits, so that of equally hard ones the first is taken, whatever the rounding of its components.
    hardest = max(range(len(pushes)), key=lambda k: round(float(np.linalg.norm(pushes[k].impulse)), 3))
    push = pushes[hardest]
    calm_until = pushes[hardest + 1].start if hardest + 1 < len(pushes) else float(log.time[-1])
    calm = max(push.end, calm_until - 0.05)
    after = (log.time >= push.start) & (log.time <= calm)
    base = log.base_pose[:, :3]
    moved = 1e3 * np.linalg.norm(base[after] - base[np.searchsorted(log.time, push.start)], axis=1)
    furthest = float(log.time[after][np.argmax(moved)])
    force = np.linalg.norm(push.impulse) / (push.end - push.start)
    pushed = push.start + 0.6 * (push.end - push.start)
    return (pushed, furthest, calm), (
        f"<b>{pushed:.2f} s</b> &ensp; {force:.3g} N for {push.end - push.start:.2g} s",
        f"<b>{furthest:.2f} s</b> &ensp; the base gave way by {moved.max():.1f} mm",
        f"<b>{calm:.2f} s</b> &ensp; and is back within {max(moved[-1], 0.1):.1f} mm",
    )


if __name__ == "__main__":
    sys.exit(main())
