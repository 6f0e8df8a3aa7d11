from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from lgmpc.errors import InputError, RunFolderError
from lgmpc.runs import RunLog, push_intervals
from lgmpc.runs.log import CHANNELS, GROUND_CHANNELS, MPC_CHANNELS
from lgmpc.world import SlopeSettings, make_world

from .conftest import FEET, new_recorder, record_standing


def test_log_holds_what_was_recorded_with_its_axes() -> None:
    recorder = new_recorder()
    record_standing(recorder, 37)
    log = recorder.log()
    assert (recorder.ticks, len(log.mpc_time), log.ticks) == (37, 4, 37)
    assert log.q.shape == (37, 19)
    assert log.contact_forces.shape == (37, 4, 3)
    assert log.mpc_horizon_com.shape == (4, 21, 3)
    assert log.wbc_status.dtype == np.int8
    np.testing.assert_allclose(log.time, 0.001 * np.arange(37))
    np.testing.assert_array_equal(log.contact_points[-1, 3], [-0.2, -0.15, 0.0])


def test_buffers_grow_beyond_the_expected_size_without_losing_ticks() -> None:
    recorder = new_recorder(ticks=3, mpc_updates=0)
    record_standing(recorder, 50)
    log = recorder.log()
    assert log.ticks == 50
    assert len(log.mpc_time) == 5
    np.testing.assert_allclose(log.time, 0.001 * np.arange(50))
    assert np.all(log.contact_forces[:, :, 2] == 6.0)


def test_log_is_a_read_only_copy() -> None:
    recorder = new_recorder()
    record_standing(recorder, 5)
    log = recorder.log()
    with pytest.raises(ValueError, match="read-only"):
        log.q[0, 0] = 1.0


def test_an_interrupted_tick_is_not_part_of_the_log() -> None:
    recorder = new_recorder()
    record_standing(recorder, 5)
    tick = {name: np.zeros(recorder.log().arrays()[name].shape[1:]) for name in CHANNELS}
    tick["momentum"] = np.zeros(5)  # does not fit: the row is half written when the error comes
    with pytest.raises(ValueError):
        recorder.append(tick)
    assert recorder.log().ticks == 5


def test_recording_allocates_nothing_while_the_buffers_last() -> None:
    recorder = new_recorder(ticks=1000)
    record_standing(recorder, 10)
    tick = {name: np.zeros(recorder.log().arrays()[name].shape[1:]) for name in CHANNELS}
    row = sum(recorder.log().arrays()[name][0].nbytes for name in CHANNELS)
    tracemalloc.start()
    try:
        for _ in range(500):
            recorder.append(tick)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert recorder.ticks == 510
    assert peak < 5 * row


def test_the_log_is_no_second_copy_of_the_buffers() -> None:
    recorder = new_recorder(ticks=2000)
    record_standing(recorder, 2000)
    tracemalloc.start()
    try:
        log = recorder.log()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 0.5 * sum(array.nbytes for array in log.arrays().values())
    before = log.q.copy()
    record_standing(recorder, 1)
    np.testing.assert_array_equal(log.q, before)


def anonymous_bytes() -> int:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(status.split("RssAnon:")[1].split()[0])


def test_spilled_ticks_are_the_same_and_in_no_memory(tmp_path) -> None:
    kept, spilled = new_recorder(ticks=2000), new_recorder(ticks=2000)
    spilled.spill(tmp_path, log_bytes=1_000_000)
    before = anonymous_bytes()
    record_standing(spilled, 1900)
    log = spilled.log()
    assert anonymous_bytes() - before < 0.3 * sum(each.nbytes for each in log.arrays().values())
    assert list(tmp_path.iterdir()) == []  # nothing is left behind, whatever ends the process
    record_standing(kept, 1900)
    for name, values in kept.log().arrays().items():
        np.testing.assert_array_equal(log.arrays()[name], values)


def test_without_space_ticks_stay_in_memory(tmp_path) -> None:
    recorder = new_recorder()
    recorder.spill(tmp_path, log_bytes=10**17)
    record_standing(recorder, 10)
    assert recorder.log().ticks == 10 and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("changes", "named"), [({"tau": None}, "tau"), ({"tua": np.zeros(12)}, "tua")])
def test_a_tick_has_every_channel_and_no_other(changes, named) -> None:
    recorder = new_recorder()
    record_standing(recorder, 1)
    tick = {name: np.zeros(recorder.log().arrays()[name].shape[1:]) for name in CHANNELS} | changes
    with pytest.raises(InputError, match=rf"channels: got {named}; expected every channel"):
        recorder.append({name: value for name, value in tick.items() if value is not None})
    assert recorder.ticks == 1


def test_channels_may_come_in_any_order() -> None:
    recorder, swapped = new_recorder(), new_recorder()
    record_standing(recorder, 1)
    tick = {name: recorder.log().arrays()[name][0] for name in CHANNELS}
    swapped.append(dict(reversed(tick.items())))
    for name in CHANNELS:
        np.testing.assert_array_equal(swapped.log().arrays()[name][0], tick[name])


def test_a_log_is_as_large_as_expected() -> None:
    recorder = new_recorder(ticks=50, mpc_updates=5)
    expected = recorder.log_bytes()
    record_standing(recorder, 50)
    names = {*CHANNELS, *GROUND_CHANNELS, *MPC_CHANNELS}
    assert expected == sum(np.asarray(a).nbytes for name, a in recorder.log().arrays().items() if name in names)


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"ticks": -1}, "ticks"),
        ({"control_period_s": 0.0}, "control_period_s"),
        ({"mpc_nodes": -2}, "mpc_nodes"),
        ({"joint_names": ("a", "b")}, "joint_names"),
    ],
)
def test_impossible_sizes_are_refused(changes, argument) -> None:
    with pytest.raises(InputError, match=argument):
        new_recorder(**changes)


def test_decimation_keeps_failures(changed) -> None:
    def fail_once(arrays):
        arrays["wbc_status"][503] = -2

    log = changed(fail_once).decimated(10)
    assert log.ticks == 100
    np.testing.assert_allclose(log.time[1] - log.time[0], 0.01)
    assert np.flatnonzero(log.wbc_status).tolist() == [50]
    assert log.mpc_horizon_com.shape == (100, 21, 3)


def test_pushes_are_found_with_their_impulse(changed) -> None:
    def push(arrays):
        arrays["push"][100:300, 1] = 10.0
        arrays["push"][900:, 0] = -5.0

    first, second = push_intervals(changed(push))
    assert (first.start, first.end) == pytest.approx((0.1, 0.3))
    np.testing.assert_allclose(first.impulse, [0.0, 2.0, 0.0])
    np.testing.assert_allclose(second.impulse, [-0.5, 0.0, 0.0])


def test_no_push_no_interval(standing) -> None:
    assert push_intervals(standing) == ()


def test_joints_have_names() -> None:
    names = [f"{leg}_{part}" for leg in ("FL", "FR", "HL", "HR") for part in ("HAA", "HFE", "KFE")]
    assert new_recorder(joint_names=names).log().joint_names.tolist() == names
    assert new_recorder().log().joint_names[11] == "joint 12"


def test_a_log_of_no_tick_is_a_log() -> None:
    log = new_recorder().log()
    assert log.ticks == 0
    assert log.decimated(2).ticks == 0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("tau", np.zeros((1000, 11)), r"'tau' has shape \(1000, 11\), expected \(1000, 12\)"),
        ("com", np.zeros(1000), "'com' has 1 axes, expected 2"),
        ("wbc_status", np.zeros(1000), "'wbc_status' holds float64, expected int8"),
        ("time", np.zeros(1000), "'time' does not increase"),
        ("friction", np.zeros(2), "'friction' has shape"),
        ("joint_names", np.array(["a"]), "'joint_names' has shape"),
    ],
)
def test_wrong_channels_are_named(standing, name, value, message) -> None:
    with pytest.raises(RunFolderError, match=message):
        RunLog.from_arrays(standing.arrays() | {name: value})


def test_missing_channels_are_all_named(standing) -> None:
    arrays = standing.arrays()
    del arrays["com"], arrays["friction"]
    with pytest.raises(RunFolderError, match="com, friction"):
        RunLog.from_arrays(arrays)


def test_limits_that_change_are_channels_of_the_log() -> None:
    recorder = new_recorder()
    record_standing(recorder, 4)
    assert recorder.log().floor_friction is None
    tick = {name: recorder.log().arrays()[name][-1] for name in CHANNELS}
    recorder.set_limits(friction=0.6, effort_limit=np.full(12, 2.5), mass=2.5)
    recorder.set_limits(friction=0.3, effort_limit=np.full(12, 1.8), mass=2.5)
    for time in (0.01, 0.011):
        recorder.append({**tick, "time": time})
    log = RunLog.from_arrays(recorder.log().arrays())
    np.testing.assert_array_equal(log.friction_over_time, [0.6] * 4 + [0.3] * 2)
    np.testing.assert_array_equal(log.effort_limit_over_time, np.full((6, 12), 1.8))
    np.testing.assert_array_equal(log.since(3).friction_over_time, [0.6, 0.3, 0.3])
    np.testing.assert_array_equal(log.decimated(2).friction_over_time, [0.6, 0.6, 0.3])


def test_a_log_says_what_it_contains_in_a_few_lines(standing) -> None:
    assert len(repr(standing).splitlines()) <= 3 and "1000 ticks" in repr(standing)
    assert standing.channels["contact_forces"][:2] == ((1000, 4, 3), "N")
    assert set(standing.channels) <= set(standing.arrays())


def test_contact_points_are_those_of_the_ground() -> None:
    """Spheres of 16 mm whose lowest points lie in z = 0 touch a slope of 30 degrees beside them, and are above it."""
    slope = make_world(SlopeSettings(angle_deg=30.0, height_m=-0.2), 0.6)
    recorder = new_recorder(world=slope)
    record_standing(recorder, 2)
    log, normal = recorder.log(), np.array([-0.5, 0.0, np.sqrt(0.75)])
    centres = FEET + [0.0, 0.0, 0.016]
    np.testing.assert_allclose(log.contact_points[0], centres - 0.016 * normal, rtol=0, atol=1e-15)
    distance = (FEET[:, 2] + 0.016 + 0.2 - np.tan(np.radians(30.0)) * FEET[:, 0]) * np.sqrt(0.75) - 0.016
    np.testing.assert_allclose(log.contact_clearance[0], distance, rtol=0, atol=1e-15)
    np.testing.assert_allclose(log.normal_forces, 6.0 * np.sqrt(0.75))
    np.testing.assert_allclose(log.tangential_forces, 3.0)
    np.testing.assert_allclose(log.base_height, (0.24 + 0.2) * np.sqrt(0.75))
    np.testing.assert_allclose(log.tilt_deg, 30.0)
