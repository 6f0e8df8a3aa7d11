"""Replay from a recorded tick: bit for bit with the same settings, state taken over with others, faults reported."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config import Config, load_config
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.continuing import run_from
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.showing import explain
from lgmpc.errors import ConfigError, InputError, ReplayError, RunFolderError
from lgmpc.runs import RunFolder, RunLog
from lgmpc.runs.difference import first_difference
from lgmpc.runs.events import EventKind

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
        "solo12_balance", [*STANDING, "wbc.solver=proxqp", "mpc.qp_solver=proxqp"], 0.063,
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


def test_a_run_is_repeated_bit_for_bit(pushed: FinishedRun, tmp_path: Path) -> None:
    again = run_from(pushed.folder.path, out=tmp_path)
    assert again.result.origin is not None and again.result.origin.verified_ticks == pushed.session.log.ticks == 100
    assert first_difference(pushed.session.log, again.session.log) is None


def test_other_settings_act_from_the_given_time_on(pushed: FinishedRun, tmp_path: Path) -> None:
    at = 0.08
    changed = run_from(pushed, at, ["mpc.weights.terminal=40"], tmp_path)
    before, after = pushed.session.log, changed.session.log
    assert after.ticks == before.ticks
    found = first_difference(before, after)
    assert found is not None and at <= found.time_s < at + 0.02  # an update of the MPC later at most
    assert first_difference(before, after, until_s=at) is None
    # The state is continuous: within a tick the base moves as it moved before.
    step = np.linalg.norm(np.diff(after.q[:, :3], axis=0), axis=1)
    assert step.max() < 1.5 * np.linalg.norm(np.diff(before.q[:, :3], axis=0), axis=1).max()


def test_the_folder_says_where_it_came_from(pushed: FinishedRun, tmp_path: Path) -> None:
    finished = run_from(pushed, 0.12, ["plant.friction=0.4", "duration_s=0.25"], tmp_path)
    content = json.loads((finished.folder.path / "run.json").read_text(encoding="utf-8"))["from"]
    assert content == {
        "run": str(pushed.folder.path),
        "time_s": pytest.approx(0.12),
        "verified_ticks": 60,
        "changes": {"plant.friction": [0.6, 0.4], "duration_s": [0.2, 0.25]},
    }
    loaded = RunFolder.load(finished.folder.path)
    assert loaded.result.origin == finished.result.origin
    assert loaded.log.friction == 0.4 and loaded.log.time[-1] == pytest.approx(0.248)
    assert "plant.friction 0.6 -> 0.4" in str(loaded.result.origin)
    assert load_config(finished.folder.path / "config.yaml").changes[0].set == {"plant.friction": 0.4}


def test_an_explanation_names_the_change_among_the_causes(pushed: FinishedRun, tmp_path: Path) -> None:
    finished = run_from(pushed, 0.12, ["plant.friction=0.4"], tmp_path)
    explanation, _ = explain(finished)
    causes = [(each.name, each.start_s) for each in explanation.events if each.kind is EventKind.CAUSE]
    assert causes == [("push", pytest.approx(0.03)), ("settings", pytest.approx(0.12))]
    assert "settings changed: plant.friction 0.6 -> 0.4" in [each.words for each in explanation.events]
    assert explanation.replay_from_s == 0.02


def test_a_continued_run_is_itself_repeated_and_continued(pushed: FinishedRun, tmp_path: Path) -> None:
    """Its config has the changes: simulated from there, it is the same run."""
    once = run_from(pushed, 0.08, ["plant.base_added_mass_kg=0.3"], tmp_path)
    again = run_from(once, out=tmp_path)
    assert again.result.origin is not None and again.result.origin.verified_ticks == 100
    twice = run_from(once, 0.15, ["mpc.enabled=false"], tmp_path)
    assert first_difference(once.session.log, twice.session.log, until_s=0.15) is None
    assert twice.session.log.mpc_time[-1] < 0.15 < once.session.log.mpc_time[-1]
    assert first_difference(twice.session.log, run_from(twice, out=tmp_path).session.log) is None
    config = load_config(twice.folder.path / "config.yaml")
    assert first_difference(twice.session.log, run_config(config, tmp_path).session.log) is None
    assert [change.at_s for change in config.changes] == pytest.approx([0.08, 0.15])
    earlier = run_from(twice, 0.1, ["mpc.weights.terminal=40"], tmp_path).config  # in place of the later change
    assert [change.at_s for change in earlier.changes] == pytest.approx([0.08, 0.1])


@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_the_floor_is_another_one_from_then_on(tmp_path: Path, plant: str) -> None:
    """Engines keep friction coefficients beside their state; the certificate is of the continuation."""
    first = run_config(load_config("solo12_balance", [*STANDING, f"plant.kind={plant}"]), tmp_path)
    log, after = first.session.log, first.session.log.time >= 0.052
    used = np.linalg.norm(log.contact_forces[:, :, :2], axis=2) / np.maximum(log.contact_forces[:, :, 2], 0.1)
    friction = 0.5 * float(used[after].max())
    certificate = run_from(first, 0.05, [f"plant.friction={friction:.3f}"], tmp_path).session.certificate
    assert certificate is not None
    check = next(each for each in certificate.checks if each.name == "friction")
    assert check.kept and check.margin < 1e-6  # the feet slide on it


def test_each_part_is_compared_with_its_own_floor_and_torque_limit(pushed: FinishedRun, tmp_path: Path) -> None:
    """The push ends before the change: of the continuation only, it would be within both limits."""
    limits = ["plant.friction=3.0", "plant.actuators.torque_limit_nm=4.0"]
    continued, metrics = run_from(pushed, 0.12, limits, tmp_path), pushed.result.metrics
    found = continued.result.metrics
    assert found is not None and metrics is not None
    assert found.min_friction_margin_n == metrics.min_friction_margin_n
    slack = run_from(pushed, 0.0, limits, tmp_path).result.metrics
    assert slack is not None and slack.min_friction_margin_n is not None
    assert slack.min_friction_margin_n > found.min_friction_margin_n
    log = continued.session.log
    np.testing.assert_array_equal(log.friction_over_time, np.where(log.time < 0.12 - 1e-9, 0.6, 3.0))
    np.testing.assert_array_equal(log.effort_limit_over_time[:, 0], np.where(log.time < 0.12 - 1e-9, 1.8, 4.0))
    explanation, _ = explain(continued)
    used = next(each for each in explanation.nearest if each.name == "friction")
    assert used.time_s is not None and used.time_s < 0.12


def test_plans_come_at_another_rate_from_then_on(pushed: FinishedRun, tmp_path: Path) -> None:
    log = run_from(pushed, 0.08, ["mpc.rate_hz=50"], tmp_path).session.log
    np.testing.assert_allclose(np.diff(log.mpc_time[log.mpc_time < 0.08]), 0.01)
    np.testing.assert_allclose(np.diff(log.mpc_time[log.mpc_time > 0.08]), 0.02)


def test_changes_of_a_config_act_in_a_run_without_an_earlier_one(tmp_path: Path) -> None:
    changes = "changes=[{at_s: 0.08, set: {plant.friction: 0.4}}, {at_s: 0.15, set: {mpc: {enabled: false}}}]"
    finished = run_config(load_config("solo12_balance", [*STANDING, changes]), tmp_path)
    log = finished.session.log
    np.testing.assert_array_equal(log.friction_over_time, np.where(log.time < 0.08 - 1e-9, 0.6, 0.4))
    assert 0.13 < log.mpc_time[-1] < 0.15
    causes = [each.words for each in explain(finished)[0].events if each.name == "settings"]
    assert causes[0] == "settings changed: plant.friction 0.6 -> 0.4" and "mpc.enabled True -> False" in causes[1]
    assert first_difference(log, run_from(finished, out=tmp_path).session.log) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("{at_s: 0.2, set: {seed: 1}}", "changes.0.at_s: got 0.2; expected a time after 0 s and before duration_s"),
        ("{at_s: 0.1, set: {}}", "changes.0.set"),
        ("{at_s: 0.1, set: {gate.max_tilt_deg: 3}}", "changes.0.set.gate.max_tilt_deg: got 3; expected no change"),
        ("{at_s: 0.1, set: {plant.friction: high}}", "changes.0.set.plant.friction: got the text 'high'; expected a n"),
        ("{at_s: 0.1, set: {estimator: {kind: inekf}}}", "changes.0.set.estimator.kind"),
        ("{at_s: 0.1, set: {wbc: {rate_hz: 500}}}", "changes.0.set.wbc.rate_hz"),
    ],
)
def test_changes_that_cannot_be_made_are_named(change: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config("solo12_balance", [*STANDING, f"changes=[{change}]"])


def test_a_controller_that_would_have_given_up_says_so(
    pushed: FinishedRun, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run_from(pushed, 0.15, ["modes.fall.tilt_deg=0.1"], tmp_path)
    assert [each for each in caplog.messages if "give up" in each] == []
    assert "the controller gave up before" in caplog.text


@pytest.mark.parametrize(
    "change", ["wbc.friction_facets=8", pytest.param("mpc={model: full_body, nodes: 20}", marks=pytest.mark.slow)]
)
def test_controllers_of_another_structure_continue(pushed: FinishedRun, tmp_path: Path, change: str) -> None:
    finished = run_from(pushed, 0.1, [change], tmp_path)
    before, after = pushed.session.log, finished.session.log
    np.testing.assert_allclose(after.q[:, :3], before.q[:, :3], atol=1e-3)
    assert first_difference(before, after) is not None
    assert not after.wbc_status.any() and not after.mpc_status.any()


def test_estimates_of_commands_that_did_not_act_are_not_continued(pushed: FinishedRun, tmp_path: Path) -> None:
    """Stiffer regulation would have accelerated the robot otherwise: that is no external wrench."""
    session = session_of(run_from(pushed, 0.08, ["wbc.gains.com.kp=400"], tmp_path).config)
    ((old, end),) = session.earlier
    old.advance(lambda now: None, end)
    session._continue(old)
    (was, now) = (each.controller.planner for each in (old, session))
    assert was is not None and now is not None
    np.testing.assert_array_equal(now.observer.wrench, was.observer.wrench)


def test_a_run_goes_on_beyond_its_end(pushed: FinishedRun, tmp_path: Path) -> None:
    longer = run_from(pushed, changes=["duration_s=0.25"], out=tmp_path)
    expected = whole(load_config("solo12_balance", [*STANDING, "duration_s=0.25"]))
    assert first_difference(expected, longer.session.log) is None


def test_a_setting_that_has_not_acted_yet_acts_as_from_the_start(pushed: FinishedRun, tmp_path: Path) -> None:
    """A push that begins later, gaits of a robot that stands: the same bits as a run that had them all along."""
    changes = ["pushes.0.time_s=0.11", "locomotion.swing.clearance_m=0.06", "modes.fall.tilt_deg=50"]
    start = run_config(load_config("solo12_balance", [*STANDING, "pushes.0.time_s=0.15"]), tmp_path / "start")
    continued = run_from(start, 0.1, changes, tmp_path)
    expected = whole(load_config("solo12_balance", [*STANDING, *changes]))
    assert first_difference(expected, continued.session.log) is None


def test_another_seed_draws_other_numbers_from_then_on(tmp_path: Path) -> None:
    noisy = run_config(
        load_config("solo12_balance_inekf", ["duration_s=0.1", "gate={max_tilt_deg: 5}"]), tmp_path / "a"
    )
    other = run_from(noisy, 0.05, ["seed=5"], tmp_path)
    found = first_difference(noisy.session.log, other.session.log)
    assert found is not None and found.time_s == pytest.approx(0.05)


@pytest.mark.parametrize("channel", ["q", "mpc_forces", "contact_states"])
def test_a_log_that_was_not_made_so_is_reported_with_tick_and_channel(
    pushed: FinishedRun, tmp_path: Path, channel: str
) -> None:
    log = pushed.session.log
    array = np.array(getattr(log, channel))
    at = (7, *(0,) * (array.ndim - 1))
    array[at] = np.nextafter(array[at], np.inf) if array.dtype == np.float64 else array[at] + 1
    folder = RunFolder(tmp_path / "copy")
    folder.path.mkdir()
    for name in ("config.yaml", "run.json"):
        (folder.path / name).write_text((pushed.folder.path / name).read_text(encoding="utf-8"), encoding="utf-8")
    folder.write_arrays(replace(log, **{channel: array}))
    with pytest.raises(ReplayError, match=rf"tick 7 of the log\) in {channel}\[0\]") as caught:
        run_from(folder.path, out=tmp_path / "out")
    assert caught.value.difference.tick == 7  # type: ignore[attr-defined]
    assert caught.value.exit_code == 1
    assert not (tmp_path / "out").exists()
    early = float(log.mpc_time[7] if channel.startswith("mpc") else log.time[7])
    run_from(folder.path, early, ["mpc.weights.terminal=40"], tmp_path / "out")  # what comes later is not repeated


def test_other_versions_are_named(pushed: FinishedRun, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "copy")
    folder.path.mkdir()
    (folder.path / "config.yaml").write_text((pushed.folder.path / "config.yaml").read_text("utf-8"), "utf-8")
    q = np.array(pushed.session.log.q)
    q[20, 3] += 1e-12
    folder.write_arrays(replace(pushed.session.log, q=q))
    folder.write_result(replace(pushed.result, versions={**pushed.result.versions, "mujoco": "3.0.0"}))
    with pytest.raises(ReplayError, match=r"mujoco [0-9.]+ instead of 3\.0\.0"):
        run_from(folder.path, out=tmp_path)


@pytest.mark.parametrize(
    ("time_s", "changes", "message"),
    [
        (0.4, [], r"time_s: got 0.4; expected a time in the log of .*, 0 to 0.2 s"),
        (-0.1, [], "time_s: got -0.1"),
        (
            0.1,
            ["plant.kind=pinocchio"],
            "plant.kind: got pinocchio; expected no change during a run, as of plant.friction",
        ),
        (0.1, ["robot.effort_limit_nm=1.5"], "robot.effort_limit_nm: got 1.5; expected no change"),
        (0.1, ["wbc.rate_hz=500", "log.rate_hz=500"], "mpc.rate_hz"),
        (0.1, ["mpc.nodes=30"], "mpc.nodes: got 30; expected 20"),
        (
            0.1,
            ["joint_friction={}"],
            "joint_friction: got {}; expected estimated from the start or never",
        ),
        (0.1, ["wbc.weight.com=1"], "wbc.weight: got an unknown key .*wbc.weights"),
        (0.1, ["pushes.0.time_s=0.02"], "pushes: got a change of what was before 0.1 s"),
        (0.0, ["duration_s=0.05", "commands=[{at_s: 0.1, gait: fly}]"], "commands.0.gait: got fly"),
        (0.1, ["mpc.enabled=true"], "changes: got the values of the run"),
        (0.18, ["duration_s=0.15"], "duration_s: got 0.15; expected more than the 0.18 s that are repeated"),
        (0.1, ["timing.computing=measured"], "timing.computing: got measured"),
    ],
)
def test_what_cannot_be_continued_is_refused(
    pushed: FinishedRun, tmp_path: Path, time_s: float, changes: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run_from(pushed, time_s, changes, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("missing", ["config.yaml", "log.npz", "run.json"])
def test_an_incomplete_folder_is_refused(pushed: FinishedRun, tmp_path: Path, missing: str) -> None:
    for file in pushed.folder.path.iterdir():
        if file.name != missing:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(RunFolderError, match=missing):
        run_from(tmp_path, out=tmp_path / "out")
