from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.runs import compute_metrics, flat_metrics, metric_names
from lgmpc.runs.log import CHANNELS, tilt_deg
from lgmpc.runs.metrics import LinkDistances, rpy_deg

from .conftest import new_recorder, record_standing


def about(axis: int, degrees: float) -> np.ndarray:
    """Unit quaternion x y z w of a turn about a coordinate axis."""
    half = np.radians(degrees) / 2.0
    quaternion = np.zeros(4)
    quaternion[axis], quaternion[3] = np.sin(half), np.cos(half)
    return quaternion


def times(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Quaternion product, x y z w."""
    (a, w), (b, u) = (first[:3], first[3]), (second[:3], second[3])
    return np.append(w * b + u * a + np.cross(a, b), w * u - a @ b)


def test_standing_still_has_zero_errors(standing) -> None:
    metrics = compute_metrics(standing, elapsed_s=0.25)
    assert metrics.survived_s == pytest.approx(1.0)
    assert not metrics.fell
    assert metrics.max_tilt_deg == metrics.max_displacement_m == metrics.max_slip_m == metrics.com_rms_error_m == 0.0
    assert metrics.min_base_height_m == pytest.approx(0.24)
    assert metrics.max_abs_torque_nm == 0.5
    assert metrics.torque_saturation_fraction == 0.0
    assert metrics.min_friction_margin_n == pytest.approx(0.6 * 6.0)
    assert (metrics.solver_failures, metrics.deadline_misses) == (0, 0)
    assert metrics.real_time_factor == pytest.approx(4.0)
    assert metrics.wbc_ms is not None and metrics.wbc_ms.p50 == 0.1
    assert metrics.mpc_ms is not None and metrics.mpc_ms.max == 0.5


def test_roll_pitch_and_yaw_agree_with_pinocchio() -> None:
    quaternions = np.random.default_rng(4).normal(size=(50, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    for quaternion in quaternions:
        expected = pin.rpy.matrixToRpy(pin.Quaternion(quaternion).toRotationMatrix())
        np.testing.assert_allclose(rpy_deg(quaternion[None])[0], np.degrees(expected), atol=1e-11)


@pytest.mark.parametrize("axis", [0, 2])
def test_a_turn_goes_on_beyond_half_a_turn(axis) -> None:
    angles = np.linspace(0.0, 500.0, 30)
    turned = rpy_deg(np.array([about(axis, angle) for angle in angles]))
    np.testing.assert_allclose(turned[:, axis], angles, atol=1e-11)


@pytest.mark.parametrize("degrees", [0.0, 1e-9, 1e-4, 3.0, 44.0, 90.0, 179.0, 180.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_tilt_is_the_angle_whatever_the_yaw_and_the_sign(degrees, axis) -> None:
    tilted = about(axis, degrees)
    turned = times(about(2, 137.0), tilted)
    angles = tilt_deg(np.array([tilted, -tilted, turned]))
    np.testing.assert_allclose(angles, degrees, rtol=1e-12, atol=1e-13)


def test_tilt_is_relative_to_the_reference_posture(standing) -> None:
    """A base whose frame lies on its side in the reference posture is upright when it lies on its side."""
    reference, q, target = about(0, 90.0), standing.q.copy(), standing.base_reference.copy()
    q[:, 3:7], q[1, 3:7], target[:, 3:7] = reference, times(about(1, 4.0), reference), reference
    log = replace(standing, q=q, base_reference=target, upright_axis=np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(log.tilt_deg[:3], [0.0, 4.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("least", "count"), [([0.1, 0.0, 0.1], 0), ([0.1, -0.01, -0.02, 0.1, -0.01], 2), ([-0.01, 0.1], 1), ([], 0)]
)
def test_collisions_of_links_are_counted_once_each(changed, least, count) -> None:
    distances = LinkDistances(0.02 * np.arange(len(least)), 0.5 * np.array(least), [""] * len(least), np.array(least))
    metrics = compute_metrics(changed(lambda arrays: None), distances=distances)
    assert (metrics.leg_collisions, metrics.max_self_penetration_m) == (
        count,
        -0.5 * min(least, default=0.0) if count else 0.0,
    )


def test_links_that_were_not_compared_have_no_collisions(changed) -> None:
    assert compute_metrics(changed(lambda arrays: None)).leg_collisions is None


def test_displacement_and_final_errors(changed) -> None:
    def move(arrays):
        arrays["q"][500, :2] += [0.03, 0.04]
        arrays["q"][700, 3:7] = about(0, 5.0)
        arrays["q"][-1, 0] += 0.002
        arrays["q"][-1, 3:7] = times(about(2, 2.0), about(1, 1.0))

    metrics = compute_metrics(changed(move))
    assert metrics.max_displacement_m == pytest.approx(0.05)
    assert metrics.max_tilt_deg == pytest.approx(5.0)
    assert metrics.final_position_error_m == pytest.approx(0.002)
    assert metrics.final_tilt_deg == pytest.approx(1.0)
    # cos(angle / 2) = cos(yaw / 2) cos(pitch / 2)
    expected = 2.0 * np.degrees(np.arccos(np.cos(np.radians(1.0)) * np.cos(np.radians(0.5))))
    assert metrics.final_rotation_deg == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 30.0, 179.0, 180.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rotation_does_not_depend_on_the_sign_of_its_quaternion(changed, degrees, sign) -> None:
    def turn(arrays):
        arrays["q"][-1, 3:7] = sign * about(2, degrees)

    assert compute_metrics(changed(turn)).final_rotation_deg == pytest.approx(degrees, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("column", "value", "kind"), [(2, 0.119, "low"), (3, np.sin(np.radians(23.0)), "tilted"), (5, np.nan, "not finite")]
)
def test_a_fall_is_dated(changed, column, value, kind) -> None:
    def fall(arrays):
        arrays["q"][620:, column] = value
        if kind == "tilted":
            arrays["q"][620:, 6] = np.cos(np.radians(23.0))

    metrics = compute_metrics(changed(fall))
    assert metrics.fell
    assert metrics.survived_s == pytest.approx(0.62)


def test_non_finite_ticks_do_not_affect_the_metrics_before_them(changed) -> None:
    def blow_up(arrays):
        arrays["q"][620:] = np.nan
        arrays["tau"][700:] = 99.0

    metrics = compute_metrics(changed(blow_up))
    assert metrics.max_displacement_m == 0.0
    assert metrics.max_abs_torque_nm == 0.5


def test_a_log_without_finite_ticks_is_refused(changed) -> None:
    with pytest.raises(InputError, match="none finite"):
        compute_metrics(changed(lambda arrays: arrays["q"].fill(np.nan)))
    with pytest.raises(InputError, match="0 ticks"):
        compute_metrics(new_recorder().log())


def test_slip_is_horizontal_and_counts_from_the_stance(changed) -> None:
    def slide(arrays):
        arrays["contact_points"][400:, 1, :2] += [0.003, 0.004]
        arrays["contact_points"][400:, 2, 2] += 0.05

    metrics = compute_metrics(changed(slide))
    assert metrics.max_slip_m == pytest.approx(0.005)
    assert metrics.max_foot_displacement_m == pytest.approx(0.005)


def test_a_step_is_no_slip_but_moves_the_foot(changed) -> None:
    def step(arrays):
        arrays["contact_forces"][400:500, 1] = 0.0
        arrays["contact_points"][450:, 1, 0] += 0.06

    metrics = compute_metrics(changed(step))
    assert metrics.max_slip_m == 0.0
    assert metrics.max_foot_displacement_m == pytest.approx(0.06)


def test_chattering_contact_does_not_hide_slip(changed) -> None:
    """A foot that loses contact for 10 ms at a time while it creeps has slipped the whole way."""

    def creep(arrays):
        for start in range(100, 900, 20):
            arrays["contact_forces"][start : start + 10, 1] = 0.0
        arrays["contact_points"][:, 1, 0] += np.linspace(0.0, 0.02, 1000)

    assert compute_metrics(changed(creep)).max_slip_m == pytest.approx(0.02)


def test_friction_margin_ignores_open_contacts(changed) -> None:
    def load(arrays):
        arrays["contact_forces"][:, 0] = 0.0
        arrays["contact_forces"][300, 2] = [1.2, -1.6, 4.0]

    assert compute_metrics(changed(load)).min_friction_margin_n == pytest.approx(0.6 * 4.0 - 2.0)
    flying = changed(lambda arrays: arrays["contact_forces"].fill(0.0))
    assert compute_metrics(flying).min_friction_margin_n is None


def test_torque_and_saturation(changed) -> None:
    def saturate(arrays):
        arrays["tau"][100:150, 3] = -1.8
        arrays["tau"][140:160, 4] = 1.8

    metrics = compute_metrics(changed(saturate))
    assert metrics.max_abs_torque_nm == 1.8
    assert metrics.torque_saturation_fraction == pytest.approx(0.06)


def test_steady_state_errors_start_at_the_given_time(changed) -> None:
    def err(arrays):
        arrays["com_reference"][:500, 0] += 1.0
        arrays["com_reference"][500:, 1] += 0.004
        arrays["v"][:500, 6:] = 3.0
        arrays["v"][500:, 6:] = -0.01
        arrays["v"][:, :6] = 7.0  # the base is not a joint

    metrics = compute_metrics(changed(err), steady_from_s=0.5)
    assert metrics.com_rms_error_m == pytest.approx(0.004)
    assert metrics.max_com_error_m == pytest.approx(0.004)
    assert metrics.rms_joint_velocity_rad_s == pytest.approx(0.01)
    late = compute_metrics(changed(err), steady_from_s=2.0)
    assert late.com_rms_error_m is None and late.rms_joint_velocity_rad_s is None


def test_a_torque_is_saturated_from_a_billionth_below_the_limit(changed) -> None:
    limit = 1.8

    def saturate(arrays):
        arrays["tau"][:4, 0] = limit, (1.0 - 1e-9) * limit, (1.0 - 0.9e-9) * limit, (1.0 - 1.1e-9) * limit

    assert compute_metrics(changed(saturate)).torque_saturation_fraction == pytest.approx(3 / 1000, rel=1e-12)


def test_a_tick_that_takes_its_whole_period_is_in_time(changed) -> None:
    def spend(arrays):
        arrays["mpc_ms"][:] = 0.0
        arrays["wbc_ms"][1:3] = 1.0, np.nextafter(1.0, 2.0)

    assert compute_metrics(changed(spend)).deadline_misses == 1


def test_planning_counts_against_the_period_of_its_tick(changed) -> None:
    def spend(arrays):
        arrays["wbc_ms"][:] = 0.5
        arrays["mpc_ms"][:] = 0.4
        arrays["mpc_ms"][[2, 5]] = 0.6, 4.3

    assert compute_metrics(changed(spend)).deadline_misses == 2


def test_failures_and_missed_deadlines_are_counted(changed) -> None:
    def fail(arrays):
        arrays["wbc_status"][[3, 500]] = -1, 2
        arrays["mpc_status"][7] = 1
        arrays["wbc_ms"][[10, 11, 12]] = 1.5, 0.99, 1.01
        arrays["mpc_ms"][[0, 1]] = 0.95, 0.85

    metrics = compute_metrics(changed(fail))
    assert metrics.solver_failures == 3
    assert metrics.deadline_misses == 3
    assert metrics.wbc_ms is not None
    assert metrics.wbc_ms.max == 1.5


def test_forecasts_count_against_the_period_and_are_a_metric() -> None:
    recorder = new_recorder(optional=("forecast",))
    record_standing(recorder, 50, lambda k: {"forecast_ms": {21: 0.85, 31: 0.95}.get(k, 0.0)})  # each tick takes 0.1
    metrics = compute_metrics(recorder.log())
    assert metrics.forecast_ms is not None and metrics.forecast_ms.max == 0.95
    assert metrics.deadline_misses == 1
    without = new_recorder()
    record_standing(without, 50)
    assert compute_metrics(without.log()).forecast_ms is None


def test_without_mpc_there_is_no_mpc_timing() -> None:
    recorder = new_recorder(mpc_nodes=0, mpc_period_s=0.0, mpc_updates=0)
    identity = [0.0, 0.0, 0.24, 0.0, 0.0, 0.0, 1.0]
    q = np.array(identity + 12 * [0.0])
    zeros = np.zeros
    row = (
        0.0, q, zeros(18), zeros(12), zeros(12), zeros((4, 3)), zeros((4, 3)), zeros((4, 3)), zeros((4, 3)), zeros(3),
        zeros(3), zeros(6), q[:7], zeros(6), zeros(3), 0, 0.1, zeros(3), 2, 1.0, np.ones(4), zeros(4), zeros((4, 3)),
        zeros((4, 3)),
    )  # fmt: skip
    recorder.append(dict(zip(CHANNELS, row, strict=True)))
    metrics = compute_metrics(recorder.log())
    assert metrics.mpc_ms is None
    assert metrics.survived_s == pytest.approx(0.001)
    assert metrics.real_time_factor is None


def test_fixed_base_robots_have_no_base_to_move() -> None:
    recorder = new_recorder(
        nq=7, nv=7, effort_limit=np.full(7, 80.0), contact_frames=(), floating_base=False, mpc_nodes=0
    )
    zeros = np.zeros
    for k in range(10):
        row = (
            0.001 * k, np.full(7, 0.1 * k), np.full(7, 2.0), zeros(7), zeros(7), zeros((0, 3)), zeros((0, 3)),
            zeros((0, 3)), zeros((0, 3)), zeros(3), zeros(3), zeros(6), np.array([0, 0, 0, 0, 0, 0, 1.0]), zeros(6),
            zeros(3), 0, 0.1, zeros(3), 2, 1.0, zeros(0), zeros(0), zeros((0, 3)), zeros((0, 3)),
        )  # fmt: skip
        recorder.append(dict(zip(CHANNELS, row, strict=True)))
    metrics = compute_metrics(recorder.log())
    assert not metrics.fell
    assert metrics.max_displacement_m == metrics.max_slip_m == 0.0
    assert metrics.rms_joint_velocity_rad_s == pytest.approx(2.0)


def test_metrics_by_name(standing) -> None:
    metrics = compute_metrics(standing)
    found = flat_metrics(metrics)
    assert list(found) == [name for name in metric_names() if name in found]
    assert (found["max_tilt_deg"], found["real_time_factor"]) == (metrics.max_tilt_deg, None)
    assert [name for name in found if name.startswith("mpc_ms")] == ["mpc_ms.p50", "mpc_ms.p99", "mpc_ms.max"]
    assert not any(name.startswith("mpc_ms") for name in flat_metrics(replace(metrics, mpc_ms=None)))
