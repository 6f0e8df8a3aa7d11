"""Modes in closed loop: lying, rising and lying down; falling, damping, and recovery."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.modes import Mode
from lgmpc.runs import Metrics, ModeMetrics, RunLog
from lgmpc.runs.log import MODES
from lgmpc.simulation.loop import true_state

CONFIGS = Path(__file__).parent.parent / "configs"


def session_of(name: str, *overrides: str) -> ClosedLoopSession:
    session = prepare(load_config(CONFIGS / f"{name}.yaml", overrides))
    assert isinstance(session, ClosedLoopSession)
    return session


def simulated(session: ClosedLoopSession) -> tuple[RunLog, Metrics, ModeMetrics]:
    metrics = session.run(lambda progress: None).metrics
    assert metrics is not None and metrics.modes is not None
    return session.recorder.log(), metrics, metrics.modes


def modes_of(log: RunLog) -> list[str]:
    """Return the names of the modes in order."""
    assert log.mode is not None
    codes = log.mode[np.concatenate(([0], np.flatnonzero(np.diff(log.mode)) + 1))]
    return [MODES[code] for code in codes.tolist()]


@pytest.mark.parametrize("mpc", ["true", "false"])
def test_it_rises_from_its_belly_and_lies_down_again(mpc: str) -> None:
    """Without a plan too: the way up and down is the whole-body QP's."""
    requests = "commands=[{at_s: 0.0, mode: stand}, {at_s: 2.5, mode: lie}]" if mpc == "true" else "commands=[]"
    seconds = 4.9 if mpc == "true" else 2.6
    overrides = [requests, f"mpc.enabled={mpc}", f"duration_s={seconds}"]
    log, metrics, modes = simulated(session_of("solo12_rise", *overrides))
    assert metrics.falls == 0 and metrics.solver_failures == 0
    assert modes.rises == 1 and metrics.max_tilt_deg < 0.5
    assert np.abs(log.tau).max() < 1.1  # the knees carry 0.9 N.m
    assert modes.torque_step_nm is not None and modes.torque_step_nm < 0.15
    stands = log.time > 2.3
    np.testing.assert_allclose(log.q[stands & (log.time < 2.5), 2], 0.232, atol=1e-3)
    assert metrics.max_slip_m < 0.015  # the rolling of the feet included
    if mpc == "true":
        assert modes_of(log) == ["lie", "rise", "stand", "sit", "lie"] and modes.descents == 1
        assert log.q[-1, 2] == pytest.approx(0.03, abs=1e-3)
        assert np.abs(log.v[-1]).max() < 0.1


def test_a_robot_on_its_belly_gives_up_at_once_and_lies_limp() -> None:
    """Pushed over ahead it fell flat, tilted by nothing, with a motor at its limit for as long as the run lasted."""
    push = "pushes=[{body: base_link, time_s: 0.1, duration_s: 0.2, impulse_ns: [8.0, 0.0, 0.0]}]"
    overrides = [push, "modes.rearm=on_command", "duration_s=1.5"]
    log, metrics, modes = simulated(session_of("solo12_fall", *overrides))
    assert metrics.falls == 1
    assert modes_of(log) == ["stand", "damp"]
    assert modes.give_up_s is not None and modes.give_up_s < 0.15
    assert modes.damped_rms_torque_nm is not None and modes.damped_rms_torque_nm < 0.2
    assert np.abs(log.tau[log.time > 1.2]).max() < 0.05
    assert log.time[-1] == pytest.approx(1.499)


def test_a_fall_ends_the_run_half_a_second_later_unless_the_config_says_otherwise() -> None:
    push = "pushes=[{body: base_link, time_s: 0.1, duration_s: 0.2, impulse_ns: [8.0, 0.0, 0.0]}]"
    log, metrics, _ = simulated(session_of("solo12_fall", push, "duration_s=3.0", "after_fall_s=0.2"))
    assert log.time[-1] == pytest.approx(metrics.survived_s + 0.2, abs=0.06)


def test_an_emergency_stop_damps_and_a_new_request_rises() -> None:
    requests = "commands=[{at_s: 0.1, mode: damp}, {at_s: 0.7, mode: stand}]"
    log, _, modes = simulated(session_of("solo12_stand", requests, "duration_s=4.5", "after_fall_s=null"))
    assert modes_of(log) == ["stand", "damp", "lie", "rise", "stand"]
    assert modes.damped_rms_torque_nm is not None and modes.damped_rms_torque_nm < 0.25  # it sinks for 0.3 s of 0.6
    assert log.q[-1, 2] == pytest.approx(0.232, abs=2e-3)


def test_a_reset_begins_again_with_the_present_state() -> None:
    session = session_of("solo12_rise", "duration_s=0.05", "commands=[]")
    simulated(session)
    controller = session.controller
    assert controller.modes.mode is Mode.LIE
    controller.reset()
    assert not controller.fallen
    session.plant.reset(session.robot.x_reference)
    controller.update(true_state(session.plant.sense()))
    assert controller.modes.mode is Mode.STAND


@pytest.mark.slow
@pytest.mark.parametrize("name", ["solo12_rise", "solo12_fall"])
def test_shipped_configs_pass_their_gates(name: str) -> None:
    result = session_of(name).run(lambda progress: None)
    assert result.verdict.passed, result.verdict.reasons
    assert result.certificate is not None
    assert not [each for each in result.certificate.broken if each.name == "joint position"]


LIFTED = "{FL_HFE: 1.1, FL_KFE: -2.1}"  # 6 cm off the floor
TWO_LIFTED = "{FL_HFE: 0.95, FL_KFE: -1.9, HR_HFE: -0.95, HR_KFE: 1.9}"  # 4 cm
DISPLACED = "{FL_HFE: 1.15, FL_KFE: -1.328}"  # on the floor, 12 cm behind its place


@pytest.mark.parametrize(("posture", "seconds"), [(LIFTED, 0.6), (TWO_LIFTED, 0.6), (DISPLACED, 1.2)])
def test_a_robot_that_begins_with_feet_out_of_place_finds_its_stance(posture: str, seconds: float) -> None:
    """Every foot was taken for a contact before, and a robot with a foot in the air toppled."""
    overrides = ["commands=[]", f"plant.initial_posture={posture}", f"duration_s={seconds}"]
    session = session_of("solo12_velocity", *overrides)
    log, metrics, _ = simulated(session)
    assert metrics.falls == 0 and metrics.max_tilt_deg < 1.5
    assert log.mode is not None and "recover" in modes_of(log)
    assert modes_of(log)[-1] == "stand"
    assert (log.contact_forces[-1, :, 2] > 3.0).all()
    places = log.com[-1, :2] + session.controller.feet.legs.feet[:, :2]  # it has not turned
    assert np.linalg.norm(log.contact_points[-1, :, :2] - places, axis=1).max() < 0.015
    assert np.abs(log.v[-1, :6]).max() < 0.05


def test_feet_that_are_a_little_off_stay() -> None:
    overrides = ["commands=[]", "plant.initial_posture={FL_HFE: 1.0, FL_KFE: -1.549}", "duration_s=0.8"]
    log, _, _ = simulated(session_of("solo12_velocity", *overrides, "modes.displaced_m=0.06"))
    assert modes_of(log) == ["stand"]
