"""Execution of configs into run folders: simulations of a tenth of a second."""

import math
import resource
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.config import Config, load_config, parse_config
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.execution import FinishedRun, run_config, run_session
from lgmpc.config.session import Notify, RunProgress, Session
from lgmpc.errors import InputError, Interrupted, RunFolderError
from lgmpc.runs import Outcome, RunFolder, RunLog, RunResult
from lgmpc.runs.log import CHANNELS, MPC_CHANNELS
from lgmpc.world import make_world

STAND = Path(__file__).resolve().parents[2] / "configs" / "solo12_stand.yaml"


@pytest.fixture
def short() -> Config:
    return load_config(STAND, ["duration_s=0.1", "mpc.enabled=false", "gate={max_tilt_deg: 5}"])


def test_a_run_stores_the_heights_of_its_world(short: Config, tmp_path: Path) -> None:
    """A replay reads them from the folder: the file may change, or go."""
    np.save(tmp_path / "hill.npy", np.outer(np.hanning(9), np.hanning(21)))
    section = {"kind": "course", "parts": [{"kind": "heights", "file": str(tmp_path / "hill.npy"), "cell_m": 0.1}]}
    config = short.replace({"world": section})
    finished = run_config(config, tmp_path / "runs")
    (tmp_path / "hill.npy").unlink()
    run = RunFolder.load(finished.folder.path)
    assert (run.path / "world_0.npy").is_file()
    again = parse_config(run.config, folder=run.path)
    ground = make_world(again.world, 0.6)
    assert ground.height(np.array([[2.0, 0.0]]))[0] == pytest.approx(1.0)


def test_a_run_is_saved_and_reported(short: Config, tmp_path: Path) -> None:
    notices: list[str] = []
    moved: list[RunProgress] = []
    finished = run_config(short, tmp_path, notify=notices.append, progress=moved.append)
    run = RunFolder.load(finished.folder.path)
    assert finished.folder.path.parent == tmp_path
    assert run.result.verdict.outcome is Outcome.PASS
    assert run.result.metrics == finished.session.metrics
    assert run.log.q.tobytes() == finished.session.log.q.tobytes()
    assert notices
    assert [now.duration_s for now in moved] == [pytest.approx(0.1)] * len(moved)
    assert all(before.time_s < after.time_s for before, after in zip(moved, moved[1:], strict=False))
    assert moved[-1].tilt_deg < 1.0 and moved[-1].real_time_factor > 0.0


Spoil = Callable[[ClosedLoopSession], None]


def spoiled(config: Config, out: Path, spoil: Spoil) -> RunResult:
    """Run a session that was changed after it was built, and return the result that its folder contains."""

    def build(notify: Notify) -> Session:
        session = prepare(config, notify=notify)
        assert isinstance(session, ClosedLoopSession)
        spoil(session)
        return session

    finished = run_session(config, build, out)
    saved = RunFolder.load(finished.folder.path)
    assert finished.exit_code == 1 and saved.result.verdict == finished.session.verdict
    assert saved.log.ticks == finished.session.log.ticks > 0
    return saved.result


def changed(owner: Any, from_s: float, change: Callable[[Any], Any], until_s: float = math.inf) -> None:
    """Let ``change`` act on what ``owner.update`` returns between two times."""
    update = owner.update

    def spoiled(at: Any) -> Any:
        return change(update(at)) if from_s - 1e-9 < at.time < until_s - 1e-9 else update(at)

    owner.update = spoiled


@pytest.mark.parametrize("error", [RuntimeError("broken"), InputError("tau", "nothing", "a torque"), SystemExit(3)])
@pytest.mark.parametrize("part", ["estimator", "controller", "plant"])
def test_the_log_until_any_exception_is_saved_with_its_cause(tmp_path: Path, part: str, error: BaseException) -> None:
    config = load_config("solo12_balance_inekf", ["duration_s=0.2", "mpc.enabled=false", "gate={}"])

    def fail(value: object) -> Any:
        raise error

    def spoil(session: ClosedLoopSession) -> None:
        step = session.plant.step
        if part == "plant":
            session.plant.step = lambda tau: step(tau) if session.recorder.ticks < 51 else fail(tau)  # type: ignore[method-assign]
        else:
            changed(getattr(session, part), 0.05, fail)

    result = spoiled(config, tmp_path, spoil)
    cause = (
        "tau: got nothing" if isinstance(error, InputError) else f"{type(error).__name__}: {error} (test_execution.py"
    )
    assert result.verdict.reasons[0].startswith(f"ended early, at 0.050 s: {cause}")
    assert result.metrics is not None and result.metrics.survived_s == pytest.approx(0.05, abs=1.1e-3)


def test_a_progress_report_that_raises_leaves_the_log(short: Config, tmp_path: Path) -> None:
    """The first report comes with the first tick."""

    def broken(now: RunProgress) -> None:
        raise RuntimeError("broken")

    finished = run_config(short, tmp_path, progress=broken)
    assert finished.session.verdict.reasons[0].startswith("ended early, at 0.000 s: RuntimeError: broken")
    assert RunFolder.load(finished.folder.path).log.ticks == 1


def test_an_exception_before_the_first_tick_is_named(short: Config, tmp_path: Path) -> None:
    def build(notify: Notify) -> Session:
        session = prepare(short, notify=notify)
        session.plant.sense = lambda: 1 / 0  # type: ignore[attr-defined]
        return session

    finished = run_session(short, build, tmp_path)
    saved = RunFolder.load(finished.folder.path)
    assert saved.log.ticks == 0 and saved.result.metrics is None
    assert saved.result.verdict.reasons[0].startswith("ended early, at 0.000 s: ZeroDivisionError: division by zero")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["configuration", "velocity", "torque", "qp", "gains"])
def test_what_is_not_finite_damps_the_joints_and_is_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, part: str, value: float
) -> None:
    """For 20 ms, after which the robot stands on: an estimate, a command, or the solution of the QP."""
    config = load_config("solo12_balance_inekf", ["duration_s=0.4", "pushes=[]", "gate={}", "log.rate_hz=1000"])

    def spoil(session: ClosedLoopSession) -> None:
        wbc, estimator, controller = session.controller.wbc, session.estimator, session.controller
        times = 0.2, 0.22
        if part in ("configuration", "velocity"):
            name = "q" if part == "configuration" else "v"
            changed(
                estimator, times[0], lambda x: x._replace(**{name: np.full_like(getattr(x, name), value)}), times[1]
            )
        elif part == "qp":
            write = wbc.qp.write_torques
            counted = iter(range(10_000))

            def spoiled(tau: np.ndarray) -> None:
                write(tau)
                if 200 <= next(counted) < 220:
                    tau[3] = value

            wbc.qp.write_torques = spoiled  # type: ignore[method-assign]
        else:
            name = "tau" if part == "torque" else "kp"
            changed(controller, times[0], lambda c: c._replace(**{name: np.full(12, value)}), times[1])

    result = spoiled(config, tmp_path, spoil)
    assert result.metrics is not None and not result.metrics.fell and result.metrics.solver_failures >= 20
    words = (
        "whole-body QP NOT_FINITE" if part in ("configuration", "velocity") else "the command at 0.200 s is not finite"
    )
    assert sum(words in each.message for each in caplog.records) == 1


def test_created_parent_folders_are_removed_unless_in_use(tmp_path: Path) -> None:
    config = load_config(STAND, ["robot.model=solo13"])
    with pytest.raises(InputError, match="solo13"):
        run_config(config, tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []

    def begin_another(message: str) -> None:
        (tmp_path / "a" / "another").mkdir(exist_ok=True)

    with pytest.raises(InputError, match="solo13"):
        run_config(config, tmp_path / "a" / "b", notify=begin_another)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["another"]


def test_a_run_without_disk_space_for_its_log_does_not_start(
    short: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=1_040_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    moved: list[RunProgress] = []
    with pytest.raises(RunFolderError, match=r"has 1\.04 MB free, and the run requires about 1\.\d+ MB: free"):
        run_config(short, tmp_path / "runs", progress=moved.append)
    assert not moved and list(tmp_path.iterdir()) == []


def test_the_size_of_the_log_is_known_before_the_run(short: Config, tmp_path: Path) -> None:
    config = load_config(STAND, ["duration_s=0.1", "log.rate_hz=250"])
    foreseen = prepare(config).log_bytes
    log = run_config(config, tmp_path).session.log
    arrays = log.arrays()
    written = sum(arrays[name].nbytes for name in (*CHANNELS, *MPC_CHANNELS))
    assert written <= foreseen <= 1.1 * written


def test_a_config_that_cannot_be_built_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="solo13"):
        run_config(load_config(STAND, ["robot.model=solo13"]), tmp_path)
    assert list(tmp_path.iterdir()) == []


SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def default_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP as a program finds them, whatever this one was started by."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("default_signals")
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_the_run_between_two_ticks_and_keeps_the_log(
    short: Config, tmp_path: Path, number: signal.Signals
) -> None:
    def send(now: RunProgress) -> None:
        if now.time_s > 0.04:
            signal.raise_signal(number)

    before = {each: signal.getsignal(each) for each in SIGNALS}
    finished = run_config(short, tmp_path, progress=send)
    assert finished.session.interrupted
    assert (finished.signal, finished.exit_code) == (number, 128 + number)
    run = RunFolder.load(finished.folder.path)
    assert run.result.verdict.outcome is Outcome.INTERRUPTED
    assert 0.03 < run.log.time[-1] < 0.09
    assert {each: signal.getsignal(each) for each in SIGNALS} == before


@pytest.mark.usefixtures("default_signals")
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_before_the_simulation_leaves_no_folder(short: Config, tmp_path: Path, number: signal.Signals) -> None:
    with pytest.raises(Interrupted) as caught:
        run_config(short, tmp_path / "a" / "b", notify=lambda message: signal.raise_signal(number))
    assert caught.value.exit_code == 128 + number
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("default_signals")
def test_a_signal_whose_exception_is_lost_acts_in_the_next_report(short: Config, tmp_path: Path) -> None:
    """As where CasADi's C++ calls Python, and clears what that raises."""

    def build(announce: Notify) -> Session:
        with suppress(Interrupted):
            signal.raise_signal(signal.SIGTERM)
        announce("building")
        raise AssertionError("it was lost for good")

    with pytest.raises(Interrupted):
        run_session(short, build, tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("default_signals")
def test_a_signal_while_the_folder_is_created_leaves_none(
    short: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create = RunFolder.create

    def interrupted(out: Path, name: str) -> RunFolder:
        folder = create(out, name)
        signal.raise_signal(signal.SIGTERM)
        return folder

    monkeypatch.setattr(RunFolder, "create", interrupted)
    with pytest.raises(Interrupted):
        run_config(short, tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def test_a_second_ctrl_c_acts_at_once(short: Config, tmp_path: Path) -> None:
    def press_twice(now: RunProgress) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("the second one came too late")

    finished = run_config(short, tmp_path, progress=press_twice)
    assert finished.session.interrupted


@pytest.mark.usefixtures("default_signals")
def test_a_closing_terminal_sends_sighup_twice_and_the_log_is_saved(short: Config, tmp_path: Path) -> None:
    write_arrays = RunFolder.write_arrays

    def send_again(folder: RunFolder, log: RunLog) -> None:
        signal.raise_signal(signal.SIGHUP)
        write_arrays(folder, log)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "write_arrays", send_again)
        finished = run_config(short, tmp_path, progress=lambda now: signal.raise_signal(signal.SIGHUP))
    assert finished.exit_code == 129
    assert RunFolder.load(finished.folder.path).log.ticks > 0


@pytest.mark.usefixtures("default_signals")
def test_ignored_signals_stay_ignored(short: Config, tmp_path: Path) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    finished = run_config(short, tmp_path, progress=lambda now: signal.raise_signal(signal.SIGHUP))
    assert finished.exit_code == 0


def test_an_interrupt_while_saving_lets_it_finish(short: Config, tmp_path: Path) -> None:
    write_arrays = RunFolder.write_arrays
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            RunFolder, "write_arrays", lambda *args: (signal.raise_signal(signal.SIGINT), write_arrays(*args))
        )
        finished = run_config(short, tmp_path)
    assert not finished.session.interrupted
    assert RunFolder.load(finished.folder.path).result.verdict.passed


def test_a_run_that_cannot_be_saved_leaves_no_folder(short: Config, tmp_path: Path) -> None:
    def fill_the_disk(now: RunProgress) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with pytest.raises(RunFolderError, match="cannot write .*log.npz: file too large"):
            run_config(short, tmp_path, progress=fill_the_disk)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_run_works_outside_the_main_thread(short: Config, tmp_path: Path) -> None:
    results: list[FinishedRun] = []
    thread = threading.Thread(target=lambda: results.append(run_config(short, tmp_path)))
    thread.start()
    thread.join(timeout=60)
    assert results[0].session.verdict.passed
