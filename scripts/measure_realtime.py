"""Lateness of ticks on this machine, and round trips of the links to robots, in microseconds.

    python scripts/measure_realtime.py --seconds 60 --priority 80
    python scripts/measure_realtime.py --link unitree --seconds 60
    python scripts/measure_realtime.py --deploy solo12_velocity_inekf --seconds 60 --priority 80

Each row: median, 99 %, 99.9 % and largest value, and the share of ticks without an answer in time. A link is measured
between two processes: the robot's end sends a measurement at each tick, and waits for the command that answers it.
A config is deployed on its robot, simulated in another process, standing, walking, and walking while it is pushed;
values are the times from a measurement's arrival until its command was written.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from functools import partial
from multiprocessing.synchronize import Event
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lgmpc.config import load_config
from lgmpc.config.deploying import deploy_config, serve_config
from lgmpc.control import Command, Measurement
from lgmpc.hardware import UdpDriver, UdpRobot
from lgmpc.hardware.realtime import real_time
from lgmpc.hardware.udp import LOCALHOST
from lgmpc.robot import Robot

JOINTS = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
NU, SECRET, DOMAIN = len(JOINTS), bytes(32), 7


def robot_end(link: str) -> Any:
    """Return the robot's end of a link."""
    if link == "udp":
        return UdpRobot(NU, secret=SECRET)
    from lgmpc.hardware.unitree import UnitreeRobot

    return UnitreeRobot(JOINTS, "lo", DOMAIN)


def answer(link: str, port: int, over: Event) -> None:
    """Answer each measurement by a command, in a process of its own."""
    if link == "udp":
        driver: Any = UdpDriver((LOCALHOST, port), NU, SECRET)
    else:
        from lgmpc.hardware.unitree import UnitreeDriver

        driver = UnitreeDriver(JOINTS, "lo", DOMAIN)
    command = Command.damping(np.zeros(NU), np.zeros(NU), 0.1)
    while not over.is_set():
        for _ in driver.read(0.05):
            driver.write(command)
    driver.close()


def row(name: str, values: list[float], missed: int, ticks: int) -> None:
    """Print a row of the table."""
    shown = np.percentile(1e6 * np.array(values), [50.0, 99.0, 99.9, 100.0])
    print(f"{name:<12}" + "".join(f"{each:>9.0f}" for each in shown) + f"{100.0 * missed / ticks:>9.3f} %")


def lateness(rate: float, ticks: int) -> None:
    """Sleep until absolute deadlines, and measure how late it wakes; overtaken ticks are skipped."""
    period, late, missed = 1.0 / rate, [], 0
    deadline = time.perf_counter() + period
    for _ in range(ticks):
        if (left := deadline - time.perf_counter()) > 0.0:
            time.sleep(left)
        late.append(time.perf_counter() - deadline)
        overtaken = int(late[-1] / period)
        missed += overtaken
        deadline += (1 + overtaken) * period
    row("tick", late, missed, ticks)


def round_trips(link: str, rate: float, ticks: int) -> None:
    """Send a measurement at each tick, and measure the time until its command."""
    context = multiprocessing.get_context("spawn")
    robot, over = robot_end(link), context.Event()
    port = robot.address[1] if link == "udp" else 0
    process = context.Process(target=answer, args=(link, port, over))
    process.start()
    found, missed, period = list[float](), 0, 1.0 / rate
    try:
        assert robot.wait_for_controller(30.0)
        reading = Measurement(0.0, np.zeros(3), np.zeros(3), *np.zeros((3, NU)))
        robot.send(reading)
        while robot.receive_answer(0.2) is None:  # until both ends have found each other
            robot.send(reading)
        deadline = time.perf_counter() + period
        for tick in range(ticks):
            if (left := deadline - time.perf_counter()) > 0.0:
                time.sleep(left)
            robot.receive()  # what came too late
            begun = time.perf_counter()
            robot.send(reading._replace(time=tick * period))
            if robot.receive_answer(period) is None:
                missed += 1
            else:
                found.append(time.perf_counter() - begun)
            deadline = max(deadline + period, time.perf_counter())
    finally:
        over.set()
        process.join()
        robot.close()
    row(link, found, missed, ticks)


MOTIONS = {
    "standing": ["commands=[]", "pushes=[]"],
    "walking": ["commands=[{at_s: 0.2, velocity_m_s: [0.4, 0, 0], gait: trot}]", "pushes=[]"],
    "pushed": ["commands=[{at_s: 0.2, velocity_m_s: [0.4, 0, 0], gait: trot}]"],
}


def robot_of(name: str, changes: list[str], port: Any) -> None:
    """Simulate a config's robot in real time, in a process of its own."""

    def link(robot: Robot) -> UdpRobot:
        end = UdpRobot(robot.nu, secret=SECRET)
        port.send(end.address[1])
        return end

    serve_config(load_config(name, changes), link, wait_s=300.0)


def driver_at(address: tuple[str, int], robot: Robot) -> UdpDriver:
    """Return the controller's end of the link."""
    return UdpDriver(address, robot.nu, SECRET)


def deployed(name: str, seconds: float, changes: list[str]) -> None:
    """Run a config's controllers on its simulated robot, in three motions."""
    context = multiprocessing.get_context("spawn")
    body = load_config(name).robot.model
    for motion, commands in MOTIONS.items():
        pushes = [
            f"{{body: base_link, time_s: {t}, impulse_ns: [0.0, {1.5 * (-1) ** t}, 0.0]}}"
            for t in range(2, int(seconds), 2)
        ]
        pushed = [f"pushes=[{', '.join(pushes)}]"] if motion == "pushed" else []
        wanted = [f"duration_s={seconds}", "estimator={kind: inekf}", *commands, *pushed, *changes]
        ours, theirs = context.Pipe()
        process = context.Process(target=robot_of, args=(name, wanted, theirs))
        process.start()
        driver = partial(driver_at, (LOCALHOST, ours.recv()))
        with TemporaryDirectory() as folder:
            finished, link = deploy_config(load_config(name, wanted), driver, folder)
        process.terminate()
        process.join()
        row(motion, link.spent.tolist(), link.late + link.overtaken + link.missing, link.ticks + link.overtaken)
        if finished.result.metrics is None or finished.result.metrics.falls:
            print(f"    {body} fell")


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--link", choices=["none", "udp", "unitree"], default="none", help="none: ticks alone")
    parser.add_argument("--deploy", metavar="CONFIG", help="a config to deploy on its simulated robot")
    parser.add_argument("changes", nargs="*", help="key=value, of that config")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=None, help="Hz; 1000, of Unitree's robots 500")
    parser.add_argument("--priority", type=int, default=0, help="SCHED_FIFO; 0: none")
    parser.add_argument("--cores", type=int, nargs="*", default=(), help="processor cores that it may use")
    options = parser.parse_args()
    rate = options.rate or (500.0 if options.link == "unitree" else 1000.0)
    print(f"{'us':<12}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>9}{'missed':>11}")
    if options.deploy:
        rights = [f"deployment.priority={options.priority}", f"deployment.cores={list(options.cores)}"]
        return deployed(options.deploy, options.seconds, [*rights, *options.changes])
    with real_time(options.priority, options.cores):
        if options.link == "none":
            lateness(rate, round(options.seconds * rate))
        else:
            round_trips(options.link, rate, round(options.seconds * rate))


if __name__ == "__main__":
    main()
