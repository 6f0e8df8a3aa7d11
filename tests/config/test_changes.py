"""Settings that change during a run: bit for bit the same run before, and after where nothing changes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import Config, load_config
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.showing import explain
from lgmpc.errors import ConfigError
from lgmpc.runs import RunFolder, RunLog
from lgmpc.runs.difference import first_difference
from lgmpc.runs.events import EventKind
from lgmpc.sweeps.comparison import compare_folders

PUSH = "pushes=[{body: base_link, time_s: 0.03, duration_s: 0.06, impulse_ns: [0, 1.0, 0.3]}]"
STANDING = [PUSH, "duration_s=0.2", "gate={max_tilt_deg: 5}"]


def session_of(config: Config) -> ClosedLoopSession:
    session = prepare(config)
    assert isinstance(session, ClosedLoopSession)
    return session


def whole(config: Config) -> RunLog:
    return session_of(config).run(lambda now: None).log


def rebuilt(config: Config, time_s: float) -> RunLog:
    """Return the log of a run whose controllers, estimators and sensors are replaced by others at some time."""
    return (
        session_of(config.replace({"changes": [{"at_s": time_s, "set": {"seed": config.seed}}]}))
        .run(lambda now: None)
        .log
    )


CASES = {
    "pushed, on MuJoCo": ("solo12_balance", STANDING, 0.063),
    "pushed, on Pinocchio": (
        "solo12_balance", [*STANDING, "plant.kind=pinocchio", "plant.joint_friction_nm=0.05"], 0.063,
    ),
    "without the MPC": ("solo12_balance", [*STANDING, "mpc.enabled=false"], 0.063),
    "quadratic programmes by ProxQP": (
        "solo12_balance", [*STANDING, "wbc.solver=proxqp", "mpc.qp_solver=osqp"], 0.063,
    ),
    "late, noisy, lossy, with an estimator": (
        "solo12_balance_as_built", [*STANDING, "timing.computing=modelled", "plant.link.dropped_commands=0.05"], 0.063,
    ),
}  # fmt: skip
LONG_CASES = {
    "full body": ("solo12_balance_full_body", STANDING, 0.063),
    "a trot, in a step": ("solo12_velocity", ["duration_s=1.9"], 1.637),
    "rising from the belly": ("solo12_rise", ["duration_s=0.9"], 0.7),
}


@pytest.mark.parametrize("case", [*CASES, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG_CASES)])
def test_a_session_goes_on_bit_for_bit_where_another_one_is(case: str) -> None:
    """What the others received, the new ones have received too: one forgotten number would show."""
    name, changes, at = {**CASES, **LONG_CASES}[case]
    config = load_config(name, changes)
    expected = whole(config)
    assert expected.time[-1] > at + 0.1
    assert first_difference(expected, rebuilt(config, at)) is None


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    return run_config(load_config("solo12_balance", STANDING), tmp_path_factory.mktemp("runs"))


def changed(run: FinishedRun, at: float, values: dict[str, object], out: Path) -> FinishedRun:
    """Return the run that is repeated with other settings from a time on, in place of later changes."""
    earlier = [each for each in run.config.changes if each.at_s < at]
    return run_config(run.config.replace({"changes": [*earlier, {"at_s": at, "set": values}]}), out)


def test_a_run_is_repeated_from_its_folder_bit_for_bit_and_comparison_says_so(
    pushed: FinishedRun, tmp_path: Path
) -> None:
    again = run_config(load_config(pushed.folder.path / "config.yaml"), tmp_path)
    assert first_difference(pushed.session.log, again.session.log) is None
    assert compare_folders(pushed.folder.path, again.folder.path).log == ""
    other = changed(pushed, 0.08, {"mpc.weights.terminal": 40.0}, tmp_path)
    assert " in tau_command[0]: " in compare_folders(pushed.folder.path, other.folder.path).log


def test_other_settings_act_from_the_given_time_on(pushed: FinishedRun, tmp_path: Path) -> None:
    at = 0.08
    other = changed(pushed, at, {"mpc.weights.terminal": 40.0}, tmp_path)
    before, after = pushed.session.log, other.session.log
    assert after.ticks == before.ticks
    found = first_difference(before, after)
    assert found is not None and at <= found.time_s < at + 0.02  # an update of the MPC later at most
    assert first_difference(before, after, until_s=at) is None
    # The state is continuous: within a tick the base moves as it moved before.
    step = np.linalg.norm(np.diff(after.q[:, :3], axis=0), axis=1)
    assert step.max() < 1.5 * np.linalg.norm(np.diff(before.q[:, :3], axis=0), axis=1).max()


def test_the_folder_has_the_change_and_the_log_its_limits(pushed: FinishedRun, tmp_path: Path) -> None:
    finished = changed(pushed, 0.12, {"plant.friction": 0.4}, tmp_path)
    content = json.loads((finished.folder.path / "run.json").read_text(encoding="utf-8"))
    assert content["changes"] == [{"time_s": 0.12, "values": {"plant.friction": [0.6, 0.4]}}]
    loaded = RunFolder.load(finished.folder.path)
    assert loaded.log.friction == 0.4 and loaded.log.time[-1] == pytest.approx(0.198)
    assert load_config(finished.folder.path / "config.yaml").changes[0].set == {"plant.friction": 0.4}


def test_an_explanation_names_the_change_among_the_causes(pushed: FinishedRun, tmp_path: Path) -> None:
    finished = changed(pushed, 0.12, {"plant.friction": 0.4}, tmp_path)
    explanation = explain(finished)
    causes = [(each.name, each.start_s) for each in explanation.events if each.kind is EventKind.CAUSE]
    assert causes == [("push", pytest.approx(0.03)), ("settings", pytest.approx(0.12))]
    assert "settings changed: plant.friction 0.6 -> 0.4" in [each.words for each in explanation.events]
    assert explanation.replay_from_s == 0.02


def test_a_second_change_leaves_what_was_before_it(pushed: FinishedRun, tmp_path: Path) -> None:
    once = changed(pushed, 0.08, {"plant.base_added_mass_kg": 0.3}, tmp_path)
    twice = changed(once, 0.15, {"mpc.enabled": False}, tmp_path)
    assert first_difference(once.session.log, twice.session.log, until_s=0.15) is None
    assert twice.session.log.mpc_time[-1] < 0.15 < once.session.log.mpc_time[-1]
    again = run_config(load_config(twice.folder.path / "config.yaml"), tmp_path)
    assert first_difference(twice.session.log, again.session.log) is None
    assert [change.at_s for change in again.config.changes] == pytest.approx([0.08, 0.15])


@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_the_floor_is_another_one_from_then_on(tmp_path: Path, plant: str) -> None:
    """Engines keep friction coefficients beside their state; the certificate is of the continuation."""
    first = run_config(load_config("solo12_balance", [*STANDING, f"plant.kind={plant}"]), tmp_path)
    log, after = first.session.log, first.session.log.time >= 0.052
    used = np.linalg.norm(log.contact_forces[:, :, :2], axis=2) / np.maximum(log.contact_forces[:, :, 2], 0.1)
    friction = 0.5 * float(used[after].max())
    certificate = changed(first, 0.05, {"plant.friction": round(friction, 3)}, tmp_path).session.certificate
    assert certificate is not None
    check = next(each for each in certificate.checks if each.name == "friction")
    assert check.kept and check.margin < 1e-6  # the feet slide on it


def test_each_part_is_compared_with_its_own_floor_and_torque_limit(pushed: FinishedRun, tmp_path: Path) -> None:
    """The push ends before the change: of the continuation only, it would be within both limits."""
    limits = {"plant.friction": 3.0, "plant.actuators.torque_limit_nm": 4.0}
    continued, metrics = changed(pushed, 0.12, limits, tmp_path), pushed.result.metrics
    found = continued.result.metrics
    assert found is not None and metrics is not None
    assert found.min_friction_margin_n == metrics.min_friction_margin_n
    slack = run_config(pushed.config.replace(limits), tmp_path).result.metrics
    assert slack is not None and slack.min_friction_margin_n is not None
    assert slack.min_friction_margin_n > found.min_friction_margin_n
    log = continued.session.log
    np.testing.assert_array_equal(log.friction_over_time, np.where(log.time < 0.12 - 1e-9, 0.6, 3.0))
    np.testing.assert_array_equal(log.effort_limit_over_time[:, 0], np.where(log.time < 0.12 - 1e-9, 1.8, 4.0))
    used = next(each for each in explain(continued).nearest if each.name == "friction")
    assert used.time_s is not None and used.time_s < 0.12


def test_plans_come_at_another_rate_from_then_on(pushed: FinishedRun, tmp_path: Path) -> None:
    log = changed(pushed, 0.08, {"mpc.rate_hz": 50.0}, tmp_path).session.log
    np.testing.assert_allclose(np.diff(log.mpc_time[log.mpc_time < 0.08]), 0.01)
    np.testing.assert_allclose(np.diff(log.mpc_time[log.mpc_time > 0.08]), 0.02)


def test_changes_of_a_config_act_in_a_run_without_an_earlier_one(tmp_path: Path) -> None:
    changes = "changes=[{at_s: 0.08, set: {plant.friction: 0.4}}, {at_s: 0.15, set: {mpc: {enabled: false}}}]"
    finished = run_config(load_config("solo12_balance", [*STANDING, changes]), tmp_path)
    log = finished.session.log
    np.testing.assert_array_equal(log.friction_over_time, np.where(log.time < 0.08 - 1e-9, 0.6, 0.4))
    assert 0.13 < log.mpc_time[-1] < 0.15
    causes = [each.words for each in explain(finished).events if each.name == "settings"]
    assert causes[0] == "settings changed: plant.friction 0.6 -> 0.4" and "mpc.enabled True -> False" in causes[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("{at_s: 0.2, set: {seed: 1}}", "changes.0.at_s: got 0.2; expected a time after 0 s and before duration_s"),
        ("{at_s: 0.1, set: {}}", "changes.0.set"),
        ("{at_s: 0.1, set: {gate.max_tilt_deg: 3}}", "changes.0.set.gate.max_tilt_deg: got 3; expected no change"),
        ("{at_s: 0.1, set: {plant.friction: high}}", "changes.0.set.plant.friction: got the text 'high'; expected a n"),
        ("{at_s: 0.1, set: {estimator: {kind: inekf}}}", "changes.0.set.estimator.kind"),
        ("{at_s: 0.1, set: {wbc: {rate_hz: 500}}}", "changes.0.set.wbc.rate_hz"),
        ("{at_s: 0.1, set: {plant.kind: pinocchio}}", "plant.kind: got .*; expected no change .*plant.friction"),
        ("{at_s: 0.1, set: {robot.effort_limit_nm: 1.5}}", "robot.effort_limit_nm: got 1.5; expected no change"),
        ("{at_s: 0.1, set: {mpc.nodes: 30}}", "mpc.nodes: got 30; expected 20"),
        ("{at_s: 0.1, set: {joint_friction: {}}}", "joint_friction: got {}; expected estimated from the start or"),
        ("{at_s: 0.1, set: {wbc.weight.com: 1}}", "wbc.weight"),
    ],
)
def test_changes_that_cannot_be_made_are_named(change: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config("solo12_balance", [*STANDING, f"changes=[{change}]"])


def test_a_controller_that_would_have_given_up_says_so(
    pushed: FinishedRun, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    changed(pushed, 0.15, {"modes.fall.tilt_deg": 0.1}, tmp_path)
    assert [each for each in caplog.messages if "give up" in each] == []
    assert "the controller gave up before" in caplog.text


@pytest.mark.parametrize(
    "change",
    [{"wbc.friction_facets": 8}, pytest.param({"mpc": {"model": "full_body", "nodes": 20}}, marks=pytest.mark.slow)],
)
def test_controllers_of_another_structure_continue(
    pushed: FinishedRun, tmp_path: Path, change: dict[str, object]
) -> None:
    finished = changed(pushed, 0.1, change, tmp_path)
    before, after = pushed.session.log, finished.session.log
    np.testing.assert_allclose(after.q[:, :3], before.q[:, :3], atol=1e-3)
    assert first_difference(before, after) is not None
    assert not after.wbc_status.any() and not after.mpc_status.any()


def test_estimates_of_commands_that_did_not_act_are_not_continued(pushed: FinishedRun, tmp_path: Path) -> None:
    """Stiffer regulation would have accelerated the robot otherwise: that is no external wrench."""
    session = session_of(changed(pushed, 0.08, {"wbc.gains.com.kp": 400.0}, tmp_path).config)
    ((old, end),) = session.earlier
    old.advance(lambda now: None, end)
    session._continue(old)
    (was, now) = (each.controller.planner for each in (old, session))
    assert was is not None and now is not None
    np.testing.assert_array_equal(now.observer.wrench, was.observer.wrench)


def test_a_setting_that_has_not_acted_yet_acts_as_from_the_start(pushed: FinishedRun, tmp_path: Path) -> None:
    """Gaits of a robot that stands: the same bits as a run that had them all along."""
    changes = {"locomotion.swing.clearance_m": 0.06, "modes.fall.tilt_deg": 50.0}
    expected = whole(pushed.config.replace(changes))
    assert first_difference(expected, changed(pushed, 0.1, changes, tmp_path).session.log) is None


def test_another_seed_draws_other_numbers_from_then_on(tmp_path: Path) -> None:
    noisy = run_config(
        load_config("solo12_balance_inekf", ["duration_s=0.1", "gate={max_tilt_deg: 5}"]), tmp_path / "a"
    )
    other = changed(noisy, 0.05, {"seed": 5}, tmp_path)
    found = first_difference(noisy.session.log, other.session.log)
    assert found is not None and found.time_s == pytest.approx(0.05)
