"""Running a config into its folder, with the real thing for a tenth of a second."""

import resource
import signal
import threading
from pathlib import Path

import pytest

from lgmpc.config import Config, load_config
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.session import Progress
from lgmpc.errors import InputError, RunFolderError
from lgmpc.runs import Outcome, RunFolder

STAND = Path(__file__).resolve().parents[2] / "configs" / "solo12_stand.yaml"


@pytest.fixture
def short() -> Config:
    return load_config(STAND, ["duration_s=0.1", "mpc.enabled=false", "gate={max_tilt_deg: 5}"])


def test_a_run_is_saved_and_told_about(short: Config, tmp_path: Path) -> None:
    told: list[str] = []
    moved: list[Progress] = []
    finished = run_config(short, tmp_path, notify=told.append, progress=moved.append)
    run = RunFolder.load(finished.folder.path)
    assert finished.folder.path.parent == tmp_path
    assert run.result.verdict.outcome is Outcome.PASS
    assert run.result.metrics == finished.session.metrics
    assert run.log.q.tobytes() == finished.session.log.q.tobytes()
    assert told
    assert [now.duration_s for now in moved] == [pytest.approx(0.1)] * len(moved)
    assert all(before.time_s < after.time_s for before, after in zip(moved, moved[1:], strict=False))
    assert moved[-1].tilt_deg < 1.0 and moved[-1].real_time_factor > 0.0


def test_a_run_that_breaks_leaves_no_folder(short: Config, tmp_path: Path) -> None:
    def broken(now: Progress) -> None:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        run_config(short, tmp_path, progress=broken)
    assert list(tmp_path.iterdir()) == []


def test_a_config_that_cannot_be_built_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="solo13"):
        run_config(load_config(STAND, ["robot.model=solo13"]), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_ends_the_run_between_two_ticks_and_keeps_the_log(short: Config, tmp_path: Path) -> None:
    def press(now: Progress) -> None:
        if now.time_s > 0.04:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    finished = run_config(short, tmp_path, progress=press)
    assert finished.session.interrupted
    run = RunFolder.load(finished.folder.path)
    assert run.result.verdict.outcome is Outcome.INTERRUPTED
    assert 0.03 < run.log.time[-1] < 0.09
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_interrupt_acts_at_once(short: Config, tmp_path: Path) -> None:
    def press_twice(now: Progress) -> None:
        signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("the second one came too late")

    finished = run_config(short, tmp_path, progress=press_twice)
    assert finished.session.interrupted


def test_an_interrupt_while_saving_lets_it_finish(short: Config, tmp_path: Path) -> None:
    write_log = RunFolder.write_log
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "write_log", lambda *args: (signal.raise_signal(signal.SIGINT), write_log(*args)))
        finished = run_config(short, tmp_path)
    assert not finished.session.interrupted
    assert RunFolder.load(finished.folder.path).result.verdict.passed


def test_a_run_that_cannot_be_saved_leaves_no_folder(short: Config, tmp_path: Path) -> None:
    def fill_the_disk(now: Progress) -> None:
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
