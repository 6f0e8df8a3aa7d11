"""The estimate in log and metrics: known by construction, absent without an estimator and in older runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError, RunFolderError
from lgmpc.runs import Gate, RunFolder, RunLog, RunResult, compute_metrics, flat_metrics, judge
from lgmpc.runs.channels import channels_of
from lgmpc.runs.metrics import tilt_and_yaw_deg

from .conftest import new_recorder, record_standing


def about(axis: np.ndarray, degrees: float) -> np.ndarray:
    half = np.radians(degrees) / 2.0
    return np.append(np.sin(half) * axis / np.linalg.norm(axis), np.cos(half))


@pytest.fixture(scope="module")
def estimated() -> RunLog:
    """The standing log; the estimate drifts by 4 mm along x and 2 degrees about z, is 0.3 m/s off, one foot wrong."""
    recorder, n = new_recorder(optional=("estimate",)), 1000
    q, v = np.zeros(19), np.zeros(18)
    q[2], v[1] = 0.24, -0.3

    def drifting(k: int) -> dict[str, Any]:
        share = (k + 1) / n
        q[0], q[3:7] = 0.004 * share, about(np.array([0.0, 0.0, 1.0]), -2.0 * share)
        return estimate(q, v, [1, 1, k < 100, 2 if k < 30 else 1], 0.05)

    record_standing(recorder, n, drifting)
    return recorder.log()


def estimate(q: np.ndarray, v: np.ndarray, contacts: list[int], ms: float) -> dict[str, Any]:
    return {"estimate_q": q, "estimate_v": v, "estimate_contacts": contacts, "estimate_ms": ms}


def test_errors_are_those_that_were_made(estimated: RunLog) -> None:
    metrics = compute_metrics(estimated)
    errors = metrics.estimator
    assert errors is not None
    assert errors.max_position_m == errors.final_position_m == pytest.approx(0.004)
    assert errors.max_yaw_deg == errors.final_yaw_deg == pytest.approx(2.0)
    assert errors.max_tilt_deg == pytest.approx(0.0, abs=1e-9)
    assert errors.rms_velocity_m_s == errors.max_velocity_m_s == pytest.approx(0.3)
    assert errors.wrong_contact_fraction == pytest.approx(0.25 * 0.9)
    assert errors.rejected_measurements == 30
    assert metrics.estimator_ms is not None and metrics.estimator_ms.p50 == pytest.approx(0.05)
    assert metrics.max_displacement_m == 0.0  # that of the truth


def test_the_estimators_time_counts_for_the_deadline() -> None:
    recorder = new_recorder(optional=("estimate",))
    late = estimate(np.zeros(19), np.zeros(18), [0] * 4, 0.95)  # + 0.1 ms of the controller's
    record_standing(recorder, 10, lambda tick: late)
    assert compute_metrics(recorder.log()).deadline_misses == 10


@pytest.mark.parametrize("seed", range(4))
def test_a_rotation_is_a_tilt_after_a_yaw(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tilt, yaw = rng.uniform(0.0, 170.0), rng.uniform(-170.0, 170.0)
    horizontal = np.append(rng.normal(size=2), 0.0)
    truth = pin.Quaternion(*rng.normal(size=4)).normalized()
    turned = pin.Quaternion(about(horizontal, tilt)) * pin.Quaternion(about(np.array([0.0, 0.0, 1.0]), yaw)) * truth
    for sign in (1.0, -1.0):
        found = tilt_and_yaw_deg(sign * turned.coeffs()[None], truth.coeffs()[None])
        np.testing.assert_allclose(np.ravel(found), [tilt, yaw], atol=1e-9)


def test_a_folder_keeps_it(estimated: RunLog, tmp_path: Path) -> None:
    metrics = compute_metrics(estimated)
    folder = RunFolder.create(tmp_path, "estimated")
    folder.write_config("name: estimated\n")
    folder.write_arrays(estimated.decimated(4))
    folder.write_result(RunResult("estimated", judge(metrics, Gate()), metrics))
    run = RunFolder.load(folder.path)
    assert run.result.metrics == metrics
    for name in channels_of(RunLog, "estimate"):
        np.testing.assert_array_equal(getattr(run.log, name), getattr(estimated, name)[::4])


def test_runs_without_an_estimate_are_read_as_before(standing: RunLog) -> None:
    assert standing.estimate_q is None and set(channels_of(RunLog, "estimate")).isdisjoint(standing.arrays())
    again = RunLog.from_arrays(standing.arrays())
    assert again.estimate_q is None and again.decimated(2).estimate_ms is None
    metrics = compute_metrics(again)
    assert metrics.estimator is None and metrics.estimator_ms is None
    content = json.loads(RunResult("old", judge(metrics, Gate()), metrics).to_json())
    del content["metrics"]["estimator"], content["metrics"]["estimator_ms"]  # as written by version 0.1
    assert RunResult.from_json(json.dumps(content)).metrics == metrics


def test_the_errors_are_metrics_by_name(estimated: RunLog, standing: RunLog) -> None:
    without, found = flat_metrics(compute_metrics(standing)), flat_metrics(compute_metrics(estimated))
    assert "estimator" not in found and "estimator.max_yaw_deg" not in without
    assert found["estimator.max_yaw_deg"] == pytest.approx(2.0)
    assert found["estimator_ms.p50"] == pytest.approx(0.05)


def test_an_incomplete_estimate_is_damage(estimated: RunLog) -> None:
    arrays = estimated.arrays()
    del arrays["estimate_v"]
    with pytest.raises(RunFolderError, match="log lacks estimate_v"):
        RunLog.from_arrays(arrays)
    with pytest.raises(RunFolderError, match="'estimate_q' has shape"):
        RunLog.from_arrays(estimated.arrays() | {"estimate_q": np.zeros((3, 19))})


def test_a_recorder_takes_all_channels_of_an_estimate_or_none() -> None:
    channels = estimate(np.zeros(19), np.zeros(18), [0] * 4, 0.0)
    with pytest.raises(InputError, match="^channels: got estimate_contacts, estimate_ms, estimate_q, estimate_v"):
        record_standing(new_recorder(), 1, lambda tick: channels)
    del channels["estimate_ms"]
    with pytest.raises(InputError, match="^channels: got estimate_ms"):
        record_standing(new_recorder(optional=("estimate",)), 1, lambda tick: channels)


def test_a_tick_cut_in_half_leaves_no_estimate() -> None:
    recorder = new_recorder(optional=("estimate",))
    whole = estimate(np.zeros(19), np.zeros(18), [0] * 4, 0.0)
    with pytest.raises(ValueError):
        record_standing(recorder, 6, lambda tick: whole if tick < 5 else {**whole, "estimate_q": np.zeros(18)})
    log = recorder.log()
    assert log.ticks == 5 and log.estimate_q is not None and len(log.estimate_q) == 5
