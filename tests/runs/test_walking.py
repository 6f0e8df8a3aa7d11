"""Figures of walking, from a synthetic log in which each of them is known by construction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.errors import InputError, RunFolderError
from lgmpc.locomotion.contacts import ContactState
from lgmpc.runs import Gate, RunFolder, RunLog, RunResult, WalkingMetrics, compute_metrics, flat_metrics, judge
from lgmpc.runs.events import find_events
from lgmpc.runs.log import CONTACT_STATES, MODES
from lgmpc.runs.walking import SETTLING_S, body_velocity, stride_mean

from .conftest import FEET, new_recorder, record_standing

DT, PERIOD, MASS = 0.004, 0.2, 2.5
TIME = DT * np.arange(1000)
WALK = (TIME >= 0.4) & (TIME < 3.0)
STEPS = 13
SWING = CONTACT_STATES.index("swing")

Edit = Callable[[dict[str, np.ndarray]], None]


def walking_log(standing: RunLog, edit: Edit | None = None, yaw_rate: float = 0.0) -> RunLog:
    """The robot follows [0.5 m/s, 0.1 m/s, yaw_rate] from 0.4 to 3 s exactly, from a heading of 60 degrees on.

    Foot 0 swings in the first half of each cycle, unloaded; the others stand, relative to the base where they began.
    """
    arrays = {name: np.array(array) for name, array in standing.arrays().items() if np.ndim(array)}
    arrays["time"] = TIME.copy()
    arrays["command"] = np.where(WALK[:, None], [0.5, 0.1, yaw_rate], 0.0)
    arrays["gait_period_s"] = np.full(1000, PERIOD)
    arrays["mode"] = np.full(1000, MODES.index("locomote"), dtype=np.int8)
    walked = np.clip(TIME - 0.4, 0.0, 2.6)
    yaw = np.radians(60.0) + yaw_rate * walked
    # The integral of a velocity that is constant in a turning frame.
    along, across = (np.sin(yaw_rate * walked), 1.0 - np.cos(yaw_rate * walked)) if yaw_rate else (walked, 0.0 * walked)
    x, y = (np.array([along, across]) / (yaw_rate or 1.0)).tolist()
    x, y = np.array(x), np.array(y)
    way = np.column_stack((0.5 * x - 0.1 * y, 0.5 * y + 0.1 * x))
    c, s = np.cos(np.radians(60.0)), np.sin(np.radians(60.0))
    way = np.column_stack((c * way[:, 0] - s * way[:, 1], s * way[:, 0] + c * way[:, 1]))
    arrays["com"][:, :2] = way
    arrays["q"][:, :2] = way
    arrays["q"][:, 5], arrays["q"][:, 6] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    turned = np.stack((c * FEET[:, 0] - s * FEET[:, 1], s * FEET[:, 0] + c * FEET[:, 1]), axis=2)
    arrays["contact_points"][:, :, :2] = way[:, None] + turned
    swings = WALK & ((TIME - 0.4 + 1e-9) % PERIOD < 0.5 * PERIOD)
    arrays["stance"] = np.ones((1000, 4), dtype=np.int8)
    arrays["stance"][:, 0] = ~swings
    arrays["contact_states"] = np.where(arrays["stance"] == 0, SWING, 0).astype(np.int8)
    arrays["contact_forces"][swings, 0] = 0.0
    arrays["swing_targets"] = arrays["contact_points"].copy()
    arrays["footholds"] = arrays["contact_points"].copy()
    arrays["tau"][:] = 0.2
    arrays["v"][:, 6:] = -0.75
    arrays["base_reference"] = arrays["q"][:, :7].copy()
    if edit is not None:
        edit(arrays)
    return replace(standing, **arrays, control_period_s=DT, mass_kg=MASS)


@pytest.fixture
def walk(standing: RunLog) -> Callable[..., WalkingMetrics]:
    def measure(edit: Edit | None = None, yaw_rate: float = 0.0) -> WalkingMetrics:
        walking = compute_metrics(walking_log(standing, edit, yaw_rate)).walking
        assert walking is not None
        return walking

    return measure


def sway(arrays: dict[str, np.ndarray], velocity: np.ndarray, axis: tuple[float, float] = (0.5, 3**0.5 / 2)) -> None:
    """Add a velocity (1000,) along a world axis, ahead unless given."""
    way = np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * DT))
    arrays["com"][:, :2] += way[:, None] * np.array(axis)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.8, -1.5])
def test_a_command_that_is_followed_exactly_has_no_error(walk, yaw_rate) -> None:
    found = walk(yaw_rate=yaw_rate)
    rounding = 2e-5 if yaw_rate else 1e-11  # of differences over 4 ms on an arc
    for name in ("velocity_rmse_m_s", "raw_velocity_rmse_m_s", "velocity_bias_m_s", "yaw_rate_rmse_rad_s"):
        assert getattr(found, name) == pytest.approx(0.0, abs=rounding), name
    assert found.height_rmse_m == found.max_scuff_m == 0.0
    assert found.height_std_m == pytest.approx(0.0, abs=1e-15)
    assert found.steps == STEPS
    assert found.walking_tilt_deg == pytest.approx(0.0, abs=1e-6)
    assert found.recovery_time_s is None
    assert found.ends_standing is True
    assert found.final_foot_error_m == pytest.approx(0.0, abs=1e-12)


def on_soles(log: RunLog) -> RunLog:
    """Its first two contact points become corners of a sole, with flags for each of them as logs once had."""
    arrays = {name: np.array(array) for name, array in log.arrays().items()}
    for name in ("stance", "contact_states"):
        arrays[name][:, 1] = arrays[name][:, 0]
    return RunLog.from_arrays(arrays | {"contact_frames": np.array(["a/sole/1", "a/sole/2", "b/foot", "b/2"])})


def test_flags_are_of_feet_and_forces_of_their_points(standing) -> None:
    log = walking_log(standing)
    soles = on_soles(log)
    assert soles.feet == {"a/sole": 2, "b/foot": 1, "b": 1} and soles.names_along()["nf"] == ["a/sole", "b/foot", "b"]
    np.testing.assert_array_equal(soles.stance, log.stance[:, [0, 2, 3]])
    assert log.of_feet(np.add, log.normal_forces) is log.normal_forces  # of points nothing is combined
    points, walking = compute_metrics(log).walking, compute_metrics(soles).walking
    assert points is not None and walking is not None
    assert points.steps == walking.steps == STEPS
    assert points.peak_impact_n == pytest.approx(6.0) and walking.peak_impact_n == pytest.approx(12.0)


def test_a_sole_has_contact_at_any_corner_and_is_named_in_events(standing) -> None:
    log = on_soles(walking_log(standing))
    for corners, found in (([0], []), ([0, 1], ["a/sole (400 ms)"])):
        forces = log.contact_forces.copy()
        forces[800:900, corners] = 0.0  # at rest, after the walk
        events = find_events(replace(log, contact_forces=forces), ())
        lost = [each.words.partition(": ")[2] for each in events if each.name == "contact lost" and each.start_s > 3.1]
        assert lost == found


def test_sway_within_a_stride_is_in_the_raw_error_alone(walk) -> None:
    """Two whole oscillations a cycle: nothing is left of them in the mean, and 1/sqrt(2) of the size in the RMS."""
    found = walk(lambda arrays: sway(arrays, np.where(WALK, 0.1 * np.sin(2.0 * np.pi * 2.0 * TIME / PERIOD), 0.0)))
    assert found.velocity_rmse_m_s == pytest.approx(0.0, abs=1e-6)
    assert found.raw_velocity_rmse_m_s == pytest.approx(0.1 / np.sqrt(2.0), rel=0.03)  # differences over 8 ms damp it


def test_a_bias_is_in_all_errors_and_in_its_direction(walk) -> None:
    found = walk(lambda arrays: sway(arrays, np.where(WALK, 0.03, 0.0)))
    for name in ("velocity_rmse_m_s", "raw_velocity_rmse_m_s", "velocity_bias_m_s"):
        assert getattr(found, name) == pytest.approx(0.03, rel=1e-3), name  # the last tick's difference ends it
    assert found.yaw_rate_rmse_rad_s == pytest.approx(0.0, abs=1e-12)


def test_errors_before_the_command_has_settled_do_not_count(walk) -> None:
    begin = 0.4 + SETTLING_S
    early = walk(lambda arrays: sway(arrays, np.where((TIME > 0.42) & (TIME < begin - 0.02), 0.2, 0.0)))
    late = walk(lambda arrays: sway(arrays, np.where((TIME > begin) & (TIME < begin + 0.02), 0.2, 0.0)))
    assert early.raw_velocity_rmse_m_s == pytest.approx(0.0, abs=1e-9)
    assert late.raw_velocity_rmse_m_s > 0.01


def test_a_yaw_rate_error_is_measured(walk) -> None:
    def slow(arrays):
        arrays["command"][WALK, 2] = 0.9

    assert walk(slow, yaw_rate=0.8).yaw_rate_rmse_rad_s == pytest.approx(0.1, rel=1e-4)


def test_height_errors_and_heave_are_those_of_plateaus(walk) -> None:
    def heave(arrays):
        arrays["q"][:, 2] += 0.003 + np.where(np.arange(1000) % 2, 0.001, -0.001)

    found = walk(heave)
    assert found.height_std_m == pytest.approx(0.001, rel=1e-3)
    assert found.height_rmse_m == pytest.approx(np.hypot(0.003, 0.001), rel=1e-3)


def test_cost_of_transport_is_work_over_weight_and_way(walk) -> None:
    """Twelve joints at 0.2 N.m and 0.75 rad/s: 1.8 W, at 2.5 kg and sqrt(0.26) m/s."""
    expected = 1.8 / (MASS * 9.81 * np.hypot(0.5, 0.1))
    assert walk().cost_of_transport == pytest.approx(expected)
    wiggle = walk(lambda arrays: sway(arrays, np.where(WALK, 0.5 * np.sin(4.0 * np.pi * TIME / PERIOD), 0.0)))
    assert wiggle.cost_of_transport == pytest.approx(expected, rel=1e-3), "going to and fro is no way"


def test_the_cost_of_transport_needs_a_mass_and_a_way(standing, walk) -> None:
    unknown = compute_metrics(replace(walking_log(standing), mass_kg=np.nan)).walking
    assert unknown is not None and unknown.cost_of_transport is None

    def turn_only(arrays):
        arrays["command"][:, :2] = 0.0

    assert walk(turn_only, yaw_rate=0.5).cost_of_transport is None


def test_tilt_counts_while_the_robot_walks(walk) -> None:
    def lean(arrays):
        for tick, degrees in ((50, 9.0), (400, 4.0), (900, 7.0)):
            half = np.radians(degrees) / 2.0
            arrays["q"][tick, 3:7] = np.sin(half), 0.0, 0.0, np.cos(half)

    assert walk(lean).walking_tilt_deg == pytest.approx(4.0)


def test_a_contact_lost_in_a_stance_is_no_step(walk) -> None:
    def lose(arrays):
        arrays["stance"][500:510, 2] = 0
        arrays["contact_states"][500:510, 2] = CONTACT_STATES.index("lost")

    found = walk(lose)
    assert (found.steps, found.lost_contacts) == (STEPS, 1)


def test_scuffing_is_the_way_of_a_loaded_foot_within_one_swing(walk) -> None:
    first = 100 + int(np.ceil(PERIOD / DT))  # tick of the second lift-off

    def scuff(arrays):
        arrays["contact_forces"][first + 5 : first + 11, 0, 2] = 3.0  # six ticks: five ways between them
        arrays["contact_forces"][first + 55 : first + 58, 0, 2] = 3.0

    assert walk(scuff).max_scuff_m == pytest.approx(5 * DT * np.hypot(0.5, 0.1))


def test_the_impact_is_the_peak_just_after_a_touchdown(walk) -> None:
    touchdown = 100 + int(np.ceil(0.5 * PERIOD / DT))  # tick of the first one

    def land(arrays):
        arrays["contact_forces"][touchdown + 2, 0, 2] = 31.0
        arrays["contact_forces"][touchdown + 8, 0, 2] = 40.0  # 32 ms later: no impact
        arrays["contact_forces"][touchdown + 2, 1, 2] = 50.0  # has not just touched down

    assert walk(land).peak_impact_n == 31.0


def test_drift_is_the_estimates_error_over_the_way(walk) -> None:
    def drift(arrays):
        arrays["estimate_q"], arrays["estimate_v"] = arrays["q"].copy(), arrays["v"].copy()
        arrays["estimate_contacts"] = np.ones((1000, 4), dtype=np.int8)
        arrays["estimate_ms"] = np.zeros(1000)
        arrays["estimate_q"][:, :2] += np.linspace(0.0, 1.0, 1000)[:, None] * [0.006, 0.008]

    assert walk(drift).odometry_drift_percent == pytest.approx(100.0 * 0.01 / (2.6 * np.hypot(0.5, 0.1)), rel=1e-6)
    assert walk().odometry_drift_percent is None


def test_stopping_is_counted_in_cycles_from_the_commands_end(walk) -> None:
    def coast(arrays):
        sway(arrays, np.where((TIME >= 3.0) & (TIME < 3.3), 0.05, 0.0))
        arrays["momentum"][:, :2] = MASS * np.gradient(arrays["com"][:, :2], DT, axis=0)
        noise = np.random.default_rng(0).normal(scale=1e-4, size=(len(TIME), 2))  # 2 cm/s if it is differentiated
        arrays["com"][:, :2] += noise  # of an estimate

    assert walk(coast).stop_strides == pytest.approx(0.3 / PERIOD, abs=0.05)

    def step_on(arrays):
        arrays["stance"][TIME >= 3.5, 2] = 0

    stepping = walk(step_on)
    assert stepping.ends_standing is False
    assert stepping.stop_strides is None and stepping.final_foot_error_m is None

    def go_on(arrays):
        arrays["command"][750:] = [0.5, 0.1, 0.0]

    assert walk(go_on).ends_standing is None


def test_feet_end_where_they_were_relative_to_each_other(walk) -> None:
    """Where the base is above them does not count: it differs between the start and the stance on a slope."""

    def spread(arrays):
        arrays["contact_points"][600:, 3, :2] += [0.006, -0.008]

    def shift(arrays):
        spread(arrays)
        arrays["q"][700:, 0] += 0.04

    for change in (spread, shift):
        assert walk(change, yaw_rate=0.4).final_foot_error_m == pytest.approx(0.01)


def test_recovery_is_timed_from_the_end_of_each_push(walk) -> None:
    def push(arrays):
        for begin, length in ((1.0, 0.3), (2.0, 0.5)):
            arrays["push"][(TIME >= begin - 1e-9) & (TIME < begin + 0.1 - 1e-9), 1] = 20.0
            sway(arrays, np.where((TIME >= begin + 2 * DT) & (TIME < begin + length), 0.4, 0.0))

    # The mean over a cycle has forgotten the error when 1/8 of the window is left of it.
    assert walk(push).recovery_time_s == pytest.approx(0.4 + PERIOD * (1.0 - 0.05 / 0.4), abs=3 * DT)

    assert walk(push).velocity_rmse_m_s == pytest.approx(0.0, abs=1e-9), "within half a second of a push"

    def for_good(arrays):
        arrays["push"][(TIME >= 1.0) & (TIME < 1.1), 1] = 20.0
        sway(arrays, np.where((TIME >= 1.0) & WALK, 0.4, 0.0))

    assert walk(for_good).recovery_time_s is None


def test_recovery_goes_on_through_changes_of_the_gait(walk) -> None:
    """Steps against a push have periods of their own: the cycles change, the command does not."""

    def push(arrays, again=0.0):
        arrays["push"][(TIME >= 1.0 - 1e-9) & (TIME < 1.1 - 1e-9), 1] = 20.0
        sway(arrays, np.where((TIME >= 1.0 + 2 * DT) & (TIME < 1.5), 0.4, np.where(TIME >= 2.5, again, 0.0)))
        arrays["gait_period_s"][(TIME >= 1.1) & (TIME < 1.3)] = 0.15

    # The mean is that over a cycle of the gait to which the robot comes back.
    assert walk(push).recovery_time_s == pytest.approx(0.4 + PERIOD * (1.0 - 0.05 / 0.4), abs=3 * DT)
    assert walk(lambda arrays: push(arrays, again=0.4)).recovery_time_s is None, "not for good"


def test_what_comes_after_a_fall_does_not_count(standing) -> None:
    def fall(arrays):
        arrays["q"][600:, 2] = 0.05
        sway(arrays, np.where(TIME > 2.4, 3.0, 0.0))

    metrics = compute_metrics(walking_log(standing, fall))
    assert metrics.fell and metrics.walking is not None
    assert metrics.walking.velocity_rmse_m_s == pytest.approx(0.0, abs=1e-9)


def test_a_fall_before_the_first_commanded_motion_has_no_end_of_it(standing) -> None:
    log = walking_log(standing, lambda arrays: arrays["q"].__setitem__((slice(50, None), 2), 0.05))
    metrics = compute_metrics(log)
    assert metrics.walking is not None and metrics.survived_s == pytest.approx(50 * DT)
    assert (metrics.walking.ends_standing, metrics.walking.stop_strides, metrics.walking.steps) == (None, None, 0)


def test_displacement_and_final_errors_are_measured_from_where_the_command_leads(standing) -> None:
    def stray(arrays):
        arrays["q"][500, 0] += 0.03
        arrays["q"][-1, 1] += 0.004

    metrics = compute_metrics(walking_log(standing, stray, yaw_rate=0.5))
    assert metrics.max_displacement_m == pytest.approx(0.03)
    assert metrics.final_position_error_m == pytest.approx(0.004)
    assert metrics.final_rotation_deg == pytest.approx(0.0, abs=1e-6)


def test_steps_that_nobody_commanded_have_figures(standing) -> None:
    def uncommanded(arrays):
        arrays["command"][:] = 0.0

    walking = compute_metrics(walking_log(standing, uncommanded)).walking
    assert walking is not None and walking.steps > 0
    assert walking.velocity_rmse_m_s is None and walking.stop_strides is None


def test_a_standing_run_has_no_figures_of_walking(standing) -> None:
    assert compute_metrics(standing).walking is None

    def rest(arrays):
        arrays["command"][:] = 0.0
        arrays["stance"][:] = 1

    assert compute_metrics(walking_log(standing, rest)).walking is None
    (reason,) = judge(compute_metrics(standing), Gate(max_cost_of_transport=1.0)).reasons
    assert reason == "max_cost_of_transport was not measured, but the gate limits it to 1"


def test_broken_limits_of_walking_are_reported(standing) -> None:
    metrics = compute_metrics(walking_log(standing, lambda arrays: sway(arrays, np.where(WALK, 0.03, 0.0))))
    verdict = judge(metrics, Gate(max_velocity_bias_m_s=0.01, min_steps=20))
    assert verdict.reasons == (
        "largest mean velocity error at a constant command: 0.03 m/s, allowed at most 0.01 m/s (max_velocity_bias_m_s)",
        "number of swings of all feet: 13, allowed at least 20 (min_steps)",
    )


def test_a_folder_keeps_steps_and_figures(standing, tmp_path: Path) -> None:
    log = walking_log(standing)
    metrics = compute_metrics(log)
    folder = RunFolder.create(tmp_path, "walk")
    folder.write_config("name: walk\n")
    folder.write_arrays(log.decimated(4))
    folder.write_result(RunResult("walk", judge(metrics, Gate()), metrics))
    run = RunFolder.load(folder.path)
    assert run.result.metrics == metrics
    assert run.log.mass_kg == MASS
    for name in ("command", "mode", "stance", "contact_states", "swing_targets", "footholds"):
        np.testing.assert_array_equal(getattr(run.log, name), getattr(log, name)[::4])
    assert {f"walking.{each.name}" for each in fields(WalkingMetrics)} <= flat_metrics(metrics).keys()


def test_half_of_the_steps_is_damage(standing) -> None:
    arrays = walking_log(standing).arrays()
    with pytest.raises(RunFolderError, match="'stance' has shape"):
        RunLog.from_arrays(arrays | {"stance": np.ones((1000, 3), dtype=np.int8)})
    del arrays["footholds"]
    with pytest.raises(RunFolderError, match="log lacks footholds"):
        RunLog.from_arrays(arrays)


def steps(tick: int) -> dict[str, Any]:
    return {
        "command": [0.1 * tick, 0.0, 0.2],
        "gait_period_s": 0.24,
        "mode": 2,
        "stance": [True, tick < 3, True, True],
        "contact_states": [0, 0 if tick < 3 else SWING, 0, 0],
        "swing_targets": FEET,
        "footholds": FEET,
    }


def test_a_recorder_takes_all_channels() -> None:
    with pytest.raises(InputError, match="^channels: got swings;"):
        record_standing(new_recorder(), 1, lambda k: {"swings": 0.0})


def test_recorded_steps_are_logged() -> None:
    recorder = new_recorder(mass=2.5)
    record_standing(recorder, 5, steps)
    log = recorder.log()
    assert log.commanded and log.mass_kg == 2.5
    np.testing.assert_allclose(log.command[:, 0], 0.1 * np.arange(5))
    np.testing.assert_array_equal(log.stance[:, 1], [1, 1, 1, 0, 0])
    np.testing.assert_array_equal(log.contact_states[:, 1], [0, 0, 0, SWING, SWING])
    assert log.contact_states.dtype == np.int8


def test_every_contact_state_has_its_code() -> None:
    assert [state.name.lower() for state in ContactState] == list(CONTACT_STATES)


def test_stride_means_are_those_of_the_windows() -> None:
    values = np.random.default_rng(0).normal(size=(20, 2))
    expected = [values[k : k + 6].mean(axis=0) for k in range(15)]
    np.testing.assert_allclose(stride_mean(values, 6), expected, atol=1e-14)


def test_body_velocity_turns_with_the_base(standing) -> None:
    found = body_velocity(walking_log(standing, yaw_rate=0.8))
    inside = (TIME > 0.42) & (TIME < 2.98)
    np.testing.assert_allclose(found[inside], np.tile([0.5, 0.1, 0.8], (inside.sum(), 1)), atol=1e-4)
