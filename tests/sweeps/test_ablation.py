"""Effects of parts, from rows that are made up; parts that can be removed."""

from collections.abc import Callable
from pathlib import Path

import pytest

from lgmpc.config import load_config
from lgmpc.errors import InputError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.ablation import COMPLETE, ablation_sweep, parts_of, worths

ROOT = Path(__file__).resolve().parents[2]


def test_the_usual_parts_are_those_that_a_config_uses() -> None:
    standing = {part.key for part in parts_of(load_config("solo12_balance"), ())}
    assert {"mpc.enabled", "mpc.uprighting_rate_hz", "wbc.weights.posture"} <= standing
    assert not any(key.startswith("locomotion") for key in standing)
    walking = {part.key for part in parts_of(load_config("solo12_velocity"), ())}
    assert "locomotion.footholds.feedback" in walking
    assert "locomotion.reaction.enabled" not in walking  # off already
    assert "locomotion.reaction.enabled" in {part.key for part in parts_of(load_config("solo12_step_recovery"), ())}
    without = {part.key for part in parts_of(load_config("solo12_balance", ["mpc.enabled=false"]), ())}
    assert "mpc.enabled" not in without


@pytest.mark.parametrize(
    ("wanted", "name"),
    [
        ("mpc", "mpc.enabled=false"),
        ("mpc.enabled", "mpc.enabled=false"),
        ("wbc.weights.posture", "wbc.weights.posture=0.0"),
        ("mpc.weights.com", "mpc.weights.com=[0.0, 0.0, 0.0]"),
        ("mpc.wrench_decay_s", "mpc.wrench_decay_s=0.001"),
        ("wbc.gains.com.kp=10", "wbc.gains.com.kp=10"),
        ("wbc.solver=proxqp", 'wbc.solver="proxqp"'),
    ],
)
def test_a_key_has_a_neutral_value(wanted: str, name: str) -> None:
    (part,) = parts_of(load_config("solo12_balance"), [wanted])
    assert part.name == name


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ("mpc.weight", "mpc.weights"),
        ("wbc.weights", "wbc.weights: got a table; expected one value of it"),
        ("mpc.model", "KEY=VALUE"),
        ("mpc.nodes", "mpc.nodes=VALUE .0 is refused: .*2"),
        ("locomotion.reaction", "which it is already"),
        ("mpc.nodes=1", "mpc.nodes: got 1"),
        ("wbc.friction=0.6", "which it is already"),
    ],
)
def test_what_cannot_be_taken_away_is_an_error_with_key_and_remedy(wanted: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parts_of(load_config("solo12_balance"), [wanted])


def test_parts_are_ranked_by_lost_passes_then_by_what_the_gate_limits(row: Callable[..., Row]) -> None:
    wanted = ["mpc", "wbc.weights.posture", "wbc.weights.base_orientation"]
    sweep, parts = ablation_sweep("solo12_balance", wanted, ["gate.max_tilt_deg=10"], seeds=2)
    assert [point.config.seed for point in sweep.points if point.variant == COMPLETE] == [0, 1]
    tilts = {COMPLETE: (1.0, 3.0), parts[0].name: (2.0, 6.0), parts[1].name: (1.0, 4.0), parts[2].name: (9.0, 15.0)}
    rows = {}
    for point in sweep.points:
        tilt = tilts[point.variant][point.config.seed]
        metrics = {"max_tilt_deg": tilt, "rms_joint_velocity_rad_s": 0.1, "survived_s": 9.0, "mpc_ms.p50": tilt}
        rows[point.key] = row(point.key, Ending.PASS if tilt < 10.0 else Ending.FAIL, metrics=metrics)
    orientation, mpc, posture = worths(sweep, rows, parts)
    assert [each.part for each in (orientation, mpc, posture)] == [parts[2], parts[0], parts[1]]
    assert (orientation.passed.value, orientation.lost) == (0.5, 0.5)
    change = mpc.changes[0]
    assert (change.name, change.first, change.second, change.limit) == ("max_tilt_deg", 2.0, 4.0, 10.0)
    assert change.worsening == pytest.approx(0.2)
    assert [each.name for each in mpc.changes] == ["max_tilt_deg", "rms_joint_velocity_rad_s", "survived_s"]


def test_points_without_a_verdict_make_no_pair(row: Callable[..., Row]) -> None:
    sweep, parts = ablation_sweep("solo12_balance", ["mpc"])
    endings = {COMPLETE: Ending.PASS, parts[0].name: Ending.DIED}
    (worth,) = worths(sweep, {p.key: row(p.key, endings[p.variant]) for p in sweep.points}, parts)
    assert (worth.passed.count, worth.lost, worth.changes) == (0, 0.0, ())


def test_seeds_and_parts_must_be_there() -> None:
    with pytest.raises(InputError, match="seeds: got 0"):
        ablation_sweep("solo12_balance", ["mpc"], seeds=0)
