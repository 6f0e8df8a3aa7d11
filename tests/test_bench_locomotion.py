"""The benchmark of locomotion: its own computations and the library's figures."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from bench_locomotion import CONFIG, Bench, Motion, Pushes, falls, largest, tick_ms, velocities


@pytest.mark.parametrize("limit", [0.04, 1.9, 3.33, 7.99])
def test_the_largest_impulse_is_found_within_the_resolution(limit: float) -> None:
    assert largest(lambda impulse: impulse <= limit, 0.1) == pytest.approx(limit, abs=0.1)
    assert largest(lambda impulse: False, 0.1) == 0.0


def test_a_tick_that_plans_takes_the_time_of_its_plan_too() -> None:
    time = 0.001 * np.arange(6)
    log = SimpleNamespace(time=time, wbc_ms=np.full(6, 0.1), mpc_time=time[[0, 3]], mpc_ms=np.array([0.5, 0.7]))
    np.testing.assert_allclose(tick_ms(log), [0.6, 0.1, 0.1, 0.8, 0.1, 0.1])


def test_a_push_is_simulated_once_for_both_criteria() -> None:
    calls = []

    def push(motion: Motion, body: str, time: float, impulse: float, angle: float) -> SimpleNamespace:
        calls.append(impulse)
        return SimpleNamespace(
            fell=impulse > 3.0, walking=SimpleNamespace(recovery_time_s=None if impulse > 2.0 else 0.4)
        )

    runs = Pushes(SimpleNamespace(push=push), Motion(0.5), "base_link", 1.0, 0.0)
    assert largest(runs.survived, 0.25) == 3.0
    assert largest(runs.recovered, 0.25) == 2.0
    assert len(calls) == len(set(calls))


def test_a_robot_that_stood_has_recovered_once_its_feet_are_back() -> None:
    def push(motion: Motion, body: str, time: float, impulse: float, angle: float) -> SimpleNamespace:
        error = None if impulse > 3.0 else 0.01 * impulse
        return SimpleNamespace(fell=False, walking=SimpleNamespace(recovery_time_s=0.1, final_foot_error_m=error))

    def unmoved(motion: Motion, body: str, time: float, impulse: float, angle: float) -> SimpleNamespace:
        return SimpleNamespace(fell=False, walking=None, max_foot_displacement_m=0.01 * impulse)

    held = Pushes(SimpleNamespace(push=unmoved), Motion(), "base_link", 1.0, 0.0)
    assert held.recovered(1.9) and not held.recovered(2.1)
    runs = Pushes(SimpleNamespace(push=push), Motion(), "base_link", 1.0, 0.0)
    assert runs.recovered(1.9) and not runs.recovered(2.1) and not runs.recovered(3.1)
    assert Pushes(SimpleNamespace(push=push), Motion(0.5), "base_link", 1.0, 0.0).recovered(3.1)


def test_falls_are_counted_by_direction_over_the_phases() -> None:
    def push(motion: Motion, body: str, time: float, impulse: float, angle: float) -> SimpleNamespace:
        return SimpleNamespace(fell=impulse * np.cos(angle) > 4.0 + time)

    def run(motion: Motion, duration: float) -> tuple[SimpleNamespace, None]:
        return SimpleNamespace(gait_period_s=np.array([0.2, 0.4])), None

    bench = SimpleNamespace(push=push, run=run)
    assert Motion(0.5).reached_s == 1.0  # pushes at 2.0, 2.1, 2.2 and 2.3 s
    found = falls(bench, Motion(0.5), "base_link", 4, 4, [5.0, 6.15, 7.0])
    assert found["falls"] == [[0, 0, 0, 0], [2, 0, 0, 0], [4, 0, 0, 0]]


@pytest.mark.slow
def test_the_table_has_the_librarys_figures(capsys: pytest.CaptureFixture[str]) -> None:
    (row,) = velocities(Bench(CONFIG, "trot", []), (Motion(0.5),))
    assert row["fell"] is False
    assert f"{row['cost_of_transport']:.2f}" in capsys.readouterr().out
