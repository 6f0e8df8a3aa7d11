"""Cost of a live page for the control loop: durations of ticks with and without it, in turn.

A walking Solo12 in real time, alternately with a headless Chromium that shows its page and without a viewer. A tick's
duration is the processor time of the loop between two calls of its watcher: controller, plant, recorder, pictures and
wishes; other work on a shared machine counts as far as it takes the caches. Chromium draws without a graphics card here
and takes a core; a page on a desktop takes less.

    python scripts/paired_live.py [--pairs 5] [--seconds 10]
"""

from __future__ import annotations

import argparse
import multiprocessing
import threading
from pathlib import Path
from time import perf_counter, sleep, thread_time
from typing import Any

import numpy as np
from record import print_machine
from snapshot import headless_chromium

import lgmpc.live.session as live
from lgmpc.config import load_config
from lgmpc.config.session import StopSignals
from lgmpc.live.viewing import Link, Viewing
from lgmpc.live.wishes import Restart, Tune
from lgmpc.locomotion.command import CommandEntry
from lgmpc.typing import Array

WALK = CommandEntry(at_s=0.0, velocity_m_s=(0.5, 0.0, 0.0), gait="trot")


def walked(seconds: float, link: Link) -> Array:
    """Walk, and return the durations of ticks, us."""
    config = load_config("solo12_velocity", [f"duration_s={seconds + 60.0}", "commands=[]"])
    run = live.LiveRun(config, link, StopSignals(), Path("runs"), lambda message: None)
    run._fulfil(WALK)
    durations: list[float] = []
    watch, last = run.watch, [thread_time()]

    def watched(tick: Any) -> bool:
        going = watch(tick)
        now = thread_time()
        durations.append(now - last[0])
        last[0] = now
        if tick.sample.time > seconds:
            run.after = Restart()
        return going

    run._session.watch = watched
    run.run()
    run.close()
    return 1e6 * np.array(durations[2000:])


def main() -> None:
    """Measure in pairs and print medians, and the latency of a setting."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    print_machine()
    figures: dict[str, list[Array]] = {"without": [], "with": []}
    addresses: list[str] = []
    with Viewing(port=0, browser=False).open(addresses.append) as link, headless_chromium() as browser:
        page = browser.new_page(viewport={"width": 240, "height": 160})
        page.goto(addresses[0].removeprefix("page: "))
        for _ in range(options.pairs):
            for name, used in (("without", Link(multiprocessing.Pipe()[0])), ("with", link)):
                figures[name].append(np.percentile(walked(options.seconds, used), [50, 99, 99.9]))
    for name, each in figures.items():
        p50, p99, p999 = np.median(each, axis=0)
        spread = np.ptp([row[1] for row in each])
        print(f"{name:8} tick p50 {p50:6.1f}  p99 {p99:6.1f}  p99.9 {p999:7.1f} us  (p99 varies by {spread:.1f})")
    ratio = np.array([b[1] / a[1] for a, b in zip(figures["without"], figures["with"], strict=True)])
    print(f"p99 with the page over without: median {np.median(ratio):.3f}, {ratio.min():.3f} to {ratio.max():.3f}")
    print(
        f"a setting is read back after {1e3 * np.median(latencies()):.1f} ms (median), the page's own way not counted"
    )


def latencies() -> list[float]:
    """Return times from a wish for another weight until its value is read back from the controller, s."""
    mine, theirs = multiprocessing.Pipe()
    config = load_config("solo12_velocity", ["duration_s=60.0", "commands=[]"])
    run, found = live.LiveRun(config, Link(theirs), StopSignals(), Path("runs"), lambda message: None), []

    def ask() -> None:
        sleep(1.0)
        for k in range(50):
            begun = perf_counter()
            mine.send(Tune("wbc.gains.swing.kp", 1600.0 + k))
            while not isinstance(mine.recv(), Tune):
                pass
            found.append(perf_counter() - begun)
            sleep(0.013)
        mine.send(Restart())

    asking = threading.Thread(target=ask)
    asking.start()
    run.run()
    asking.join()
    run.close()
    return found


if __name__ == "__main__":
    main()
