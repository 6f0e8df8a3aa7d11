"""Nothing is special about the origin: displaced closed loops give displaced logs, which are judged the same."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lgmpc.config import load_config
from lgmpc.config.build import build_sensors, prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.robots import joint_limits
from lgmpc.control.interface import RobotState
from lgmpc.runs import RunLog, compute_metrics, flat_metrics
from lgmpc.runs.certificate import Balances, certify, window_edges
from lgmpc.runs.limited import limited_quantities
from lgmpc.simulation import make_plant
from lgmpc.simulation.loop import Sensing, true_state
from lgmpc.simulation.parameters import momentum_and_energy
from lgmpc.simulation.plant import PlantSample
from lgmpc.world import World
from tests.support.displaced import DISPLACEMENTS, Displacement

TROT = "commands=[{at_s: 0.1, velocity_m_s: [0.5, 0.1, 0], yaw_rate_rad_s: 0.3, gait: trot}]"
PUSH = "pushes=[{{body: base_link, time_s: 0.2, duration_s: 0.1, impulse_ns: [{}, {}, 0.3]}}]"
NOWHERE, FLOOR = Displacement.of((0.0, 0.0, 0.0)), World()
SHIFT = ("world={start_m: [3, -2], height_m: -0.7}", Displacement.of((3.0, -2.0, -0.7)))
QUARTER = ("world={start_yaw_deg: 90}", Displacement.of((0.0, 0.0, 0.0), 90.0))
ANGLE = ("world={start_yaw_deg: 70}", DISPLACEMENTS["turned"])

CONTROLLERS = ("com_reference", "base_reference", "contact_forces_desired", "swing_targets", "footholds",
               "mpc_horizon_com", "mpc_forces", "estimate_q")  # fmt: skip
"""Channels in the controller's axes."""


def run(name: str, overrides: list[str]) -> tuple[RunLog, ClosedLoopSession]:
    """Run for 0.6 s from 10 um below the ground: whether MuJoCo has a contact does not depend on rounding."""
    session = prepare(load_config(name, ["duration_s=0.6", *overrides]))
    start = session.initial.copy()
    start[2] -= 1e-5
    session.plant.reset(start)
    assert isinstance(session, ClosedLoopSession)
    return session.run(lambda progress: None).log, session


def differences(log: RunLog, other: RunLog) -> dict[str, float]:
    """Largest differences of the channels in which two logs differ; of quaternions, of the nearer sign."""
    found = {}
    for name in log.channels:
        mine, theirs = getattr(log, name).astype(float), getattr(other, name).astype(float)
        if name in ("q", "base_reference", "estimate_q"):
            mine[:, 3:7] *= np.sign(np.sum(mine[:, 3:7] * theirs[:, 3:7], axis=1))[:, None]
        found[name] = float(np.abs(mine - theirs).max(initial=0.0))
    return {name: size for name, size in found.items() if size > 0.0 and not name.endswith("_ms")}


def pushed(move: Displacement) -> str:
    return PUSH.format(*move.vectors(np.array([1.0, 0.5, 0.3]))[:2])


@pytest.mark.parametrize(
    ("name", "overrides"),
    [("solo12_balance", []), ("solo12_velocity", [TROT]), ("solo12_velocity_inekf", [TROT])],
    ids=["pushed", "trot", "trot on the estimate"],
)
@pytest.mark.parametrize(("key", "move"), [SHIFT, QUARTER], ids=["shifted", "turned by a right angle"])
def test_a_displaced_run_is_the_run_displaced(name: str, overrides: list[str], key: str, move: Displacement) -> None:
    """To rounding: a right angle turns friction pyramids of four and twelve sides into themselves."""
    log, _ = run(name, [*overrides, pushed(NOWHERE)])
    moved, _ = run(name, [*overrides, pushed(move), key])
    found = differences(move.log(log, FLOOR), moved)
    forces = ("tau", "tau_command", "contact_forces", "contact_forces_desired", "mpc_forces")
    assert max(found.pop(each, 0.0) for each in forces) < 1e-8
    assert max(found.values()) < 1e-9, found
    assert np.ptp(log.com, axis=0).max() > 5e-4


def test_a_run_turned_by_any_angle_differs_by_the_sides_of_friction_pyramids() -> None:
    """Measured: 0.05 mm of the base and 6 um of a foot after 0.6 s of a trot; forces to a tenth of the weight."""
    log, _ = run("solo12_velocity", [TROT])
    moved, _ = run("solo12_velocity", [TROT, ANGLE[0]])
    found = differences(ANGLE[1].log(log, FLOOR), moved)
    assert 1e-6 < found["q"] < 5e-4 and found["com"] < 1e-5 and found["contact_points"] < 1e-4
    assert found["contact_forces"] < 2.5


class Levelled:
    """The plant's state in axes whose z is against gravity, as an inertial sensor tells it."""

    def __init__(self, move: Displacement) -> None:
        self.back = Displacement(move.rotation.T, -move.rotation.T @ move.translation)

    def state(self, sample: PlantSample) -> RobotState:
        forces = self.back.vectors(sample.contact_forces)
        return true_state(sample._replace(q=self.back.poses(sample.q), contact_forces=forces))


def run_tilted(name: str, overrides: list[str], move: Displacement) -> RunLog:
    """Run as :func:`run` does, with ground, gravity and start displaced; the controller's axes are level."""
    config = load_config(name, ["duration_s=0.6", *overrides])
    session = prepare(config)
    assert isinstance(session, ClosedLoopSession)
    world, robot, start = move.world(session.world), move.robot(session.robot), session.initial.copy()
    start[2] -= 1e-5
    start[: robot.nq] = move.poses(start[: robot.nq])
    session.recorder.world = world
    estimator = session.estimator
    tilted = replace(
        session,
        plant=make_plant(robot, session.simulated, world),
        world=world,
        initial=start,
        sensing=Levelled(move) if estimator is None else Sensing(build_sensors(config, robot), estimator),
    )
    return tilted.run(lambda progress: None).log


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("solo12_velocity", ["duration_s=2.5"]),
        ("solo12_velocity", ["plant.kind=pinocchio"]),
        ("solo12_velocity_inekf", []),
    ],
    ids=["true state", "pinocchio", "estimate"],
)
def test_a_trot_where_ground_and_gravity_are_tilted_is_the_trot_tilted(name: str, overrides: list[str]) -> None:
    """The controller's own z is against gravity: what it wants is level, what plant, recorder and feet do is tilted.

    On the estimate nothing but the inertial sensor tells it where that is.
    """
    move = Displacement.of((0.3, -0.2, 0.1), 0.0, (4.0, -10.0))
    log, _ = run(name, [TROT, *overrides])
    wanted = {each: getattr(log, each) for each in CONTROLLERS if getattr(log, each) is not None}
    found = differences(replace(move.log(log, FLOOR), **wanted), run_tilted(name, [TROT, *overrides], move))
    forces = ("tau", "tau_command", "contact_forces", "contact_forces_desired", "mpc_forces")
    assert max(found.pop(each, 0.0) for each in forces) < 1e-8
    assert max(found.values()) < 1e-9, found
    assert np.ptp(log.com, axis=0).max() > 0.08


def judged(log: RunLog, balances: Balances, session: ClosedLoopSession, vertical: bool) -> dict[str, Any]:
    """All figures by which a run is judged; some only where gravity is along the world's z."""
    joints = joint_limits(session.robot, session.simulated.actuators)
    figures: dict[str, Any] = {f"metrics {name}": value for name, value in flat_metrics(compute_metrics(log)).items()}
    certificate = certify(log, joints, balances)
    figures |= {f"check of {each.name}": each.margin for each in certificate.checks}
    for each in limited_quantities(log, session.gate, joints):
        figures[f"quantity {each.name}"] = each.margins
    horizontal = ("walking.", "capture point")
    return {name: value for name, value in figures.items() if vertical or not any(each in name for each in horizontal)}


@pytest.mark.parametrize(("name", "overrides"), [("solo12_balance", [pushed(NOWHERE)]), ("solo12_velocity", [TROT])])
def test_a_displaced_log_is_judged_as_the_log(name: str, overrides: list[str], displacement: Displacement) -> None:
    _, session = run(name, overrides)
    log = session.recorder.log()
    edges = window_edges(log)
    balances = Balances(edges, *momentum_and_energy(session.robot, session.simulated, log.q[edges], log.v[edges]))
    momentum, weight = displacement.vectors(balances.momentum), displacement.vectors(balances.weight)
    moved = replace(balances, momentum=momentum, weight=weight)
    vertical = not displacement.tilts
    figures, others = (
        judged(log, balances, session, vertical),
        judged(displacement.log(log, FLOOR), moved, session, vertical),
    )
    assert len(figures) > 40 and "check of momentum balance" in figures
    for key, value in figures.items():
        expected = np.nan if value is None else value
        found = np.nan if others[key] is None else others[key]
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9, err_msg=key)


def test_a_robot_down_a_ramp_has_not_fallen() -> None:
    """24 cm below its start, it is as high above the ground as before; on a level floor at 0 it would lie below it."""
    _, session = run("solo12_balance", [])
    log, down = (
        session.recorder.log(),
        Displacement.of((-1.4, 0.0, -1.4 * math.tan(math.radians(10.0))), 0.0, (0.0, -10.0)),
    )
    ramp = down.log(log, FLOOR)
    assert ramp.q[-1, 2] < 0.0
    metrics = compute_metrics(ramp)
    assert not metrics.fell and metrics.max_tilt_deg < 0.5
    assert metrics.min_base_height_fraction == pytest.approx(1.0, abs=0.01)
    assert metrics.max_slip_m < 1e-3
    level = {"ground_height": np.zeros(ramp.ticks), "ground_normal": np.tile([0.0, 0.0, 1.0], (ramp.ticks, 1))}
    assert compute_metrics(RunLog.from_arrays(ramp.arrays() | level)).fell
