"""Time of the state estimator's steps on Solo12, four contacts, 27 error states: python scripts/bench_estimation.py."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported: threads only slow matrices of this size down

import argparse
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
from record import add_json_option, print_machine, quantiles, write_record

from lgmpc.compile import find_compiler, jit_enabled
from lgmpc.config.build import build_estimator, build_sensors
from lgmpc.config.loading import load_config
from lgmpc.config.robots import build_robot
from lgmpc.control.interface import Measurement
from lgmpc.estimation import InvariantEkf, LegSensing
from lgmpc.estimation.invariant_ekf import FORMS, ErrorForm
from lgmpc.robot import Robot
from lgmpc.simulation.plant import PlantSample
from lgmpc.typing import Array

CONFIG = Path(__file__).parent.parent / "configs" / "solo12_balance_inekf.yaml"
CALLS = 5000
PERIOD = 1e-3
FIGURES: dict[str, dict[str, float]] = {}
"""us, by the name of the row."""
PREDICT_LIMIT, CORRECT_LIMIT = 20.0, 60.0  # us


def timed(call: Callable[[], object]) -> Array:
    """Return the duration of each of many calls, us."""
    times = np.empty(CALLS)
    for i in range(CALLS):
        start = perf_counter()
        call()
        times[i] = perf_counter() - start
    return 1e6 * times


def row(name: str, times: Array, limit: float | None = None) -> None:
    """Print a line of the table, and keep it for the record."""
    FIGURES[name] = quantiles(times)
    bound = "" if limit is None else f"at most {limit:g}"
    print(f"{name:34s}{np.median(times):10.1f}{np.percentile(times, 99):10.1f}   {bound}")


def resting(robot: Robot) -> Measurement:
    """Return a reading of a robot at rest."""
    torques = np.full(robot.nu, 0.1)
    return Measurement(0.0, np.zeros(3), -robot.gravity, robot.q_reference[7:], np.zeros(robot.nu), torques)


def filter_rows(robot: Robot, form: ErrorForm) -> None:
    """Print the times of one form of the filter, standing on four feet."""
    ekf = InvariantEkf(robot.nc, contact_offset=(0.0, 0.0, robot.contact_radius), form=form)
    legs, gyro, force = LegSensing(robot, PERIOD, 1e-4, 1e-3), np.zeros(3), -robot.gravity
    legs.update(resting(robot), np.eye(3), np.zeros(3), np.zeros(3))
    ekf.reset(np.eye(5), np.full(15, 0.01))
    for foot in range(robot.nc):
        ekf.begin_contact(foot, legs.positions[foot], legs.covariances[foot])
    row(f"predict, {form.name}", timed(lambda: ekf.predict(gyro, force, PERIOD, legs.rates)), PREDICT_LIMIT)
    row(f"correct, {form.name}", timed(lambda: ekf.correct(legs.positions, legs.covariances)), CORRECT_LIMIT)
    again = timed(lambda: ekf.begin_contact(0, legs.positions[0], legs.covariances[0]))
    row(f"a new contact, {form.name}", again)


def main() -> None:
    """Print machine, versions and the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_json_option(parser)
    options = parser.parse_args()
    print_machine()
    compiled = jit_enabled() and find_compiler() is not None
    print(f"\nestimator of Solo12, four contacts, {CALLS} calls, {'compiled' if compiled else 'interpreted'}; us\n")
    print(f"{'':34s}{'median':>10}{'99 %':>10}")
    config = load_config(CONFIG)
    robot = build_robot(config)
    for form in FORMS.values():
        filter_rows(robot, form)
    legs, gyro = LegSensing(robot, PERIOD, 1e-4, 1e-3), np.zeros(3)
    still = resting(robot)
    row("leg sensing", timed(lambda: legs.update(still, np.eye(3), gyro, gyro)))
    estimator, sensors = build_estimator(config, robot), build_sensors(config, robot)
    assert estimator is not None
    x = robot.x_reference
    sample = PlantSample(0.0, x[: robot.nq], x[robot.nq :], np.zeros(robot.nu), np.zeros((robot.nc, 3)))
    row("simulated sensors", timed(lambda: sensors.read(sample)))
    reading = sensors.read(sample)._replace(torques=still.torques)
    estimator.update(reading)
    tick = timed(lambda: estimator.update(reading))
    row("estimator's whole tick", tick)
    write_record(options.json, FIGURES)


if __name__ == "__main__":
    main()
