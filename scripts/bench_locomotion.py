"""Quality of walking on command: velocities, pushes, cost of transport, and the controller's timing.

Every figure is one of the library's (`metrics.walking` of run.json), measured in closed loop in MuJoCo from the exact
state. A push acts for 0.2 s at the base's centre of mass, while the robot trots or while it stands and may step. For
each direction and each phase of the gait the largest impulse is found by bisection that the robot survives (it has not
fallen two seconds later, six if it stood), and that it recovers from: by then its velocity is back within 0.05 m/s of
the command; one that stood stands again, every foot within 2 cm of its place under the base.

    python scripts/bench_locomotion.py --quick                      # a minute or two
    python scripts/bench_locomotion.py                              # 12 directions x 4 phases: tens of minutes
    python scripts/bench_locomotion.py --friction 0.9 --directions 4 --phases 2 --set locomotion.swing.clearance_m=0.04
    python scripts/bench_locomotion.py --impulses 7 8 --directions 8  # how often a trotting robot falls
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from record import add_json_option, print_machine, write_record

from lgmpc.config.build import prepare
from lgmpc.config.loading import load_config
from lgmpc.runs import Metrics, RunLog, WalkingMetrics

CONFIG = Path(__file__).parent.parent / "configs" / "solo12_velocity.yaml"
START_S, PLATEAU_S, PUSH_S = 0.5, 3.5, 0.2
AFTER_PUSH_S, STANDING_AGAIN_S = 2.0, 6.0
STRONGEST_NS = 8.0
FOOT_LIMIT_M = 0.02
STEPPING = "locomotion.reaction.enabled=true"


@dataclass(frozen=True)
class Motion:
    """A command to hold: velocity ahead and to the left, m/s, and yaw rate, rad/s."""

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0

    @property
    def reached_s(self) -> float:
        """Time at which the limited command (1 m/s2, 4 rad/s2) gets there, s."""
        return START_S + max(np.hypot(self.vx, self.vy), abs(self.yaw_rate) / 4.0)

    @property
    def moves(self) -> bool:
        """Whether it is anything but standing."""
        return bool(self.vx or self.vy or self.yaw_rate)

    def __str__(self) -> str:
        parts = (("ahead", self.vx, "m/s"), ("left", self.vy, "m/s"), ("turn", self.yaw_rate, "rad/s"))
        return ", ".join(f"{name} {value:g} {unit}" for name, value, unit in parts if value) or "nowhere"


MOTIONS = (
    Motion(0.3), Motion(0.5), Motion(1.0), Motion(1.5), Motion(0.0, 0.2), Motion(0.0, 0.5), Motion(0.0, 0.8),
    Motion(yaw_rate=1.0), Motion(yaw_rate=2.0), Motion(yaw_rate=3.0), Motion(1.0, 0.0, 1.0),
)  # fmt: skip
QUICK_MOTIONS = (Motion(0.5), Motion(1.0), Motion(0.0, 0.8), Motion(yaw_rate=3.0))


class Bench:
    """Runs of one config under one set of overrides.

    Args:
        config_file: whose robot, plant and controller walk.
        gait: name of the gait.
        overrides: of the config.
    """

    def __init__(self, config_file: Path, gait: str, overrides: list[str]) -> None:
        self._file, self._gait, self._overrides = config_file, gait, overrides

    def run(self, motion: Motion, duration: float, pushes: str = "[]") -> tuple[RunLog, Metrics]:
        """Hold a command until ``duration``, s; return log and metrics."""
        velocity = [float(motion.vx), float(motion.vy), 0.0]
        command = (
            f"{{at_s: {START_S}, velocity_m_s: {velocity}, yaw_rate_rad_s: {motion.yaw_rate}, gait: {self._gait}}}"
        )
        keys = [f"commands=[{command}]", f"pushes={pushes}", f"duration_s={duration}", "log.rate_hz=1000"]
        result = prepare(load_config(self._file, [*self._overrides, *keys])).run(lambda progress: None)
        assert result.metrics is not None
        return result.log, result.metrics

    def push(self, motion: Motion, body: str, time: float, impulse: float, angle: float) -> Metrics:
        """Push towards ``angle`` at ``time`` while the robot holds a command."""
        vector = [float(impulse * np.cos(angle)), float(impulse * np.sin(angle)), 0.0]
        push = f"[{{body: {body}, time_s: {time}, duration_s: {PUSH_S}, impulse_ns: {vector}}}]"
        after = AFTER_PUSH_S if motion.moves else STANDING_AGAIN_S
        return self.run(motion, round(time + PUSH_S + after, 3), push)[1]


def tick_ms(log: RunLog) -> np.ndarray:
    """Return the duration of every control tick, the plan of those that plan included, ms."""
    whole = np.array(log.wbc_ms)
    whole[np.searchsorted(log.time, log.mpc_time)] += log.mpc_ms
    return whole


def largest(holds: Callable[[float], bool], resolution: float, strongest: float = STRONGEST_NS) -> float:
    """Return the largest impulse (N.s) for which ``holds`` is true, by bisection; 0 if it never is."""
    low, high = 0.0, strongest
    while high - low > resolution:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


@dataclass(frozen=True)
class Column:
    """A column of the table of velocities: heading, unit, format, and the figure."""

    name: str
    unit: str
    spec: str
    figure: Callable[[Metrics, WalkingMetrics], float | None]

    @property
    def width(self) -> int:
        """Characters."""
        return int(self.spec.partition(".")[0])

    def cell(self, metrics: Metrics, walking: WalkingMetrics) -> str:
        """Return the figure as text."""
        value = self.figure(metrics, walking)
        return "-".rjust(self.width) if value is None else format(value, self.spec)


def millimetres(metres: float | None) -> float | None:
    """Return a length in mm."""
    return None if metres is None else 1e3 * metres


COLUMNS = (
    Column("RMSE", "m/s", "8.4f", lambda _, walking: walking.velocity_rmse_m_s),
    Column("raw", "m/s", "7.3f", lambda _, walking: walking.raw_velocity_rmse_m_s),
    Column("bias", "m/s", "8.4f", lambda _, walking: walking.velocity_bias_m_s),
    Column("yaw", "rad/s", "8.4f", lambda _, walking: walking.yaw_rate_rmse_rad_s),
    Column("tilt", "deg", "6.2f", lambda _, walking: walking.walking_tilt_deg),
    Column("heave", "mm", "6.2f", lambda _, walking: millimetres(walking.height_std_m)),
    Column("CoT", "", "5.2f", lambda _, walking: walking.cost_of_transport),
    Column("steps", "", "6.0f", lambda _, walking: walking.steps),
    Column("scuff", "mm", "6.1f", lambda _, walking: millimetres(walking.max_scuff_m)),
    Column("slip", "mm", "6.1f", lambda metrics, _: millimetres(metrics.max_slip_m)),
    Column("at limit", "%", "8.1f", lambda metrics, _: 1e2 * metrics.torque_saturation_fraction),
)


def velocities(bench: Bench, motions: tuple[Motion, ...]) -> list[dict[str, object]]:
    """Print and return the figures of each motion."""
    for words in (("command", [column.name for column in COLUMNS], "MPC p50 / p99", "tick p50 / p99"),
                  ("", [column.unit for column in COLUMNS], "ms", "ms")):  # fmt: skip
        cells = " ".join(word.rjust(column.width) for word, column in zip(words[1], COLUMNS, strict=True))
        print(f"{words[0]:24s} {cells}   {words[2]:15s} {words[3]}")
    rows: list[dict[str, object]] = []
    for motion in motions:
        log, metrics = bench.run(motion, round(motion.reached_s + PLATEAU_S, 3))
        walking, mpc = metrics.walking, metrics.mpc_ms
        assert walking is not None and mpc is not None
        p50, p99 = np.percentile(tick_ms(log), [50.0, 99.0])
        times = {"mpc_ms": asdict(mpc), "tick_ms": {"p50": p50, "p99": p99}}
        saturated = {"torque_saturation_fraction": metrics.torque_saturation_fraction}
        rows.append({"command": str(motion), "fell": metrics.fell, **asdict(walking), **saturated, **times})
        cells = " ".join(column.cell(metrics, walking) for column in COLUMNS)
        cells = f"fell after {metrics.survived_s:.2f} s".ljust(len(cells)) if metrics.fell else cells
        timing = f"{mpc.p50:.2f} / {mpc.p99:.2f}"
        print(f"{motion!s:24s} {cells}   {timing:15s} {p50:.2f} / {p99:.2f}", flush=True)
    return rows


class Pushes:
    """The runs with pushes in one direction at one time, each made once.

    Args:
        bench: makes the runs.
        motion: the command meanwhile.
        body: that is pushed.
        time: when the push begins, s.
        angle: where it points to, rad.
    """

    def __init__(self, bench: Bench, motion: Motion, body: str, time: float, angle: float) -> None:
        self._run = lru_cache(maxsize=None)(lambda impulse: bench.push(motion, body, time, impulse, angle))
        self._moves = motion.moves

    def survived(self, impulse: float) -> bool:
        """Return whether the robot is up at the end."""
        return not self._run(impulse).fell

    def recovered(self, impulse: float) -> bool:
        """Return whether it is also back at the command; at rest, with its feet where they belong."""
        metrics = self._run(impulse)
        walking = metrics.walking
        if metrics.fell or walking is None:  # without figures of walking it did not step
            return not metrics.fell and metrics.max_foot_displacement_m < FOOT_LIMIT_M
        if walking.recovery_time_s is None:
            return False
        return self._moves or (walking.final_foot_error_m is not None and walking.final_foot_error_m < FOOT_LIMIT_M)


def pushes(
    bench: Bench, motion: Motion, body: str, directions: int, phases: int, resolution: float
) -> dict[str, object]:
    """Print and return the largest impulses by direction and phase, survived and recovered from."""
    times = push_times(bench, motion, phases)
    print(f"\npushes of {PUSH_S:g} s while it goes {motion}; N.s, by phase of the gait's cycle")
    survived, recovered = np.zeros((2, directions, phases))
    for i, angle in enumerate(2.0 * np.pi * np.arange(directions) / directions):
        for k, time in enumerate(times):
            runs = Pushes(bench, motion, body, time, float(angle))
            survived[i, k] = largest(runs.survived, resolution)
            recovered[i, k] = largest(runs.recovered, resolution)
        cells = "   ".join(
            f"{name} " + "  ".join(f"{impulse:.2f}" for impulse in table[i])
            for name, table in (("survived", survived), ("recovered", recovered))
        )
        print(f"  towards {np.degrees(angle):4.0f} deg   {cells}", flush=True)
    for name, table in (("survived", survived), ("recovered", recovered)):
        print(f"{name:10s} min {table.min():.2f}  median {np.median(table):.2f}  max {table.max():.2f} N.s")
    return {"command": str(motion), "survived_ns": survived.tolist(), "recovered_ns": recovered.tolist()}


def falls(
    bench: Bench, motion: Motion, body: str, directions: int, phases: int, impulses: list[float]
) -> dict[str, object]:
    """Print and return how often the robot falls after each of several impulses, by direction."""
    times = push_times(bench, motion, phases)
    angles = 2.0 * np.pi * np.arange(directions) / directions
    print(f"\npushes of {PUSH_S:g} s while it goes {motion}: falls by direction, of {phases} phases")
    table = []
    for impulse in impulses:
        row = [sum(bench.push(motion, body, t, impulse, float(angle)).fell for t in times) for angle in angles]
        cells = "  ".join(map(str, row))
        print(f"  {impulse:4g} N.s   {cells}   together {sum(row)} of {directions * phases}", flush=True)
        table.append(row)
    return {"command": str(motion), "impulses_ns": impulses, "phases": phases, "falls": table}


def push_times(bench: Bench, motion: Motion, phases: int) -> list[float]:
    """Return when pushes begin, s: a second after the motion is reached, at evenly spaced phases of the gait."""
    settled = round(motion.reached_s + 1.0, 3)
    log, _ = bench.run(motion, settled)
    return [round(settled + k * float(log.gait_period_s[-1]) / phases, 3) for k in range(phases)]


def main() -> None:
    """Measure and print, as tables and as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=CONFIG, help="whose robot, plant and controller walk")
    parser.add_argument("--gait", default="trot")
    parser.add_argument("--friction", type=float, help="of floor and controller; as in the config unless given")
    parser.add_argument(
        "--push-speed", type=float, default=0.5, help="speed ahead while it is pushed, m/s; 0: stands, with steps"
    )
    parser.add_argument("--body", default="base_link", help="that is pushed")
    parser.add_argument("--directions", type=int, help="of pushes: 12, or 4 with --quick")
    parser.add_argument("--phases", type=int, help="of the gait at which pushes begin: 4, or 1 with --quick")
    parser.add_argument("--resolution", type=float, help="of impulses, N.s: 0.1, or 0.5 with --quick")
    parser.add_argument("--impulses", type=float, nargs="+", help="N.s: count the falls, and measure nothing else")
    parser.add_argument("--quick", action="store_true", help="few velocities, few pushes, coarsely")
    parser.add_argument("--skip-pushes", action="store_true")
    add_json_option(parser)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    logging.getLogger("lgmpc").setLevel(logging.ERROR)  # falls are figures here
    same = [] if arguments.friction is None else [
        f"{section}.friction={arguments.friction}" for section in ("plant", "mpc", "wbc")
    ]  # fmt: skip
    bench = Bench(arguments.config, arguments.gait, [*same, *arguments.overrides])
    print_machine()
    print(f"{arguments.config.stem}, {arguments.gait}, " + (", ".join([*same, *arguments.overrides]) or "as it is"))
    quick = arguments.quick
    if arguments.impulses:
        cases = arguments.directions or 12, arguments.phases or 4
        motion = Motion(arguments.push_speed)
        if not motion.moves:
            bench = Bench(arguments.config, arguments.gait, [*same, STEPPING, *arguments.overrides])
        pushed = falls(bench, motion, arguments.body, *cases, arguments.impulses)
        write_record(arguments.json, pushed)
        return
    found: dict[str, object] = {"velocities": velocities(bench, QUICK_MOTIONS if quick else MOTIONS)}
    if not arguments.skip_pushes:
        directions, resolution = (
            arguments.directions or (4 if quick else 12),
            arguments.resolution or (0.5 if quick else 0.1),
        )
        phases = arguments.phases or (1 if quick else 4)
        steps = Bench(arguments.config, arguments.gait, [*same, STEPPING, *arguments.overrides])
        found["pushes"] = [
            pushes(bench, Motion(arguments.push_speed), arguments.body, directions, phases, resolution),
            pushes(steps, Motion(), arguments.body, directions, 1, resolution),
        ]
    write_record(arguments.json, found)


if __name__ == "__main__":
    main()
