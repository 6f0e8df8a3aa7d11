"""Sweeps of a robot that stands for a tenth of a second, computed in worker processes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lgmpc.config import load_config
from lgmpc.config.execution import run_config
from lgmpc.errors import ConfigError, InputError
from lgmpc.runs import RunFolder, flat_metrics
from lgmpc.sweeps import Ending, SweepProgress, parse_sweep, run_sweep
from lgmpc.sweeps.folder import SweepFolder
from lgmpc.sweeps.pool import Died, Hung, Pool
from lgmpc.sweeps.trial import warm

from .conftest import STAND, Parse

TWO = """
factors: [{key: plant.friction, kind: values, values: [0.5, 0.7]}]
variants:
  light: {plant.mass_scale: 1.0}
  heavy: {plant.mass_scale: 3.0, gate.max_com_error_m: 0.001}
logs: {keep: 1}
"""


@pytest.mark.usefixtures("one_worker")
def test_points_are_what_lgmpc_run_computes_and_resuming_repeats_none(tmp_path: Path, parse: Parse) -> None:
    sweep = parse(TWO)
    seen: list[SweepProgress] = []
    finished = run_sweep(sweep, tmp_path / "out", workers=1, progress=seen.append)
    assert [row.ending for row in map(finished.rows.get, (p.key for p in sweep.points)) if row] == [
        Ending.PASS,
        Ending.FAIL,
        Ending.PASS,
        Ending.FAIL,
    ]
    point = sweep.points[1]
    row = finished.rows[point.key]
    alone = run_config(point.config, tmp_path / "alone")
    assert alone.session.metrics is not None
    expected = {name: value for name, value in flat_metrics(alone.session.metrics).items() if "ms" not in name}
    del expected["real_time_factor"], expected["deadline_misses"]
    assert {name: row.metrics[name] for name in expected} == expected
    assert row.reasons == alone.result.verdict.reasons
    assert (row.base, row.variant, row.levels) == ("solo12_stand", "heavy", {"plant.friction": 0.5})
    assert row.simulated_s == pytest.approx(0.1, abs=0.002)  # of logged ticks, 2 ms apart
    # The one log that stays is that of the first failure, which is a run folder like any other.
    assert [r.log for r in finished.rows.values() if r.log] == ["pass-" + sweep.points[0].key[:12], row.log]
    (folder,) = (tmp_path / "out" / "logs").iterdir()
    assert RunFolder.load(folder).result.verdict == alone.result.verdict
    # Progress counts, and estimates.
    assert [(p.done, p.failed) for p in seen] == [(0, 0), (1, 0), (2, 1), (3, 1), (4, 2)]
    assert seen[-1].remaining_s == 0.0
    assert seen[0].speed is None
    assert finished.progress.simulated_s == pytest.approx(0.4, abs=0.008)
    before = (tmp_path / "out" / "results.jsonl").read_bytes()
    again = run_sweep(sweep, tmp_path / "out", workers=1, resume=True)
    assert again.rows == finished.rows
    assert (tmp_path / "out" / "results.jsonl").read_bytes() == before


@pytest.mark.usefixtures("one_worker")
def test_what_raises_is_a_row_with_its_reason_and_the_sweep_goes_on(tmp_path: Path, parse: Parse) -> None:
    text = """
factors: [{key: robot.posture, kind: values, values: [nowhere, standing]}]
"""
    sweep = parse(text)
    finished = run_sweep(sweep, tmp_path / "out", workers=1)
    bad, good = (finished.rows[point.key] for point in sweep.points)
    assert bad.ending is Ending.RAISED
    assert "nowhere" in bad.reasons[0]
    assert good.ending is Ending.PASS
    (config,) = (tmp_path / "out" / "logs").glob("broken-*.yaml")
    assert "posture: nowhere" in config.read_text()


@pytest.mark.usefixtures("one_worker")
def test_a_sweep_is_run_from_its_content_and_shown_in_a_line_and_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    document = {
        "name": "friction",
        "base": "solo12_stand",
        "set": {"duration_s": 0.1, "mpc.enabled": False},
        "gate": {"max_tilt_deg": 5.0},
        "factors": [{"key": "plant.friction", "kind": "values", "values": [0.5, 0.7]}],
    }
    finished = run_sweep(document, workers=1)
    assert repr(finished) == "FinishedSweep(friction: 2 of 2 points passed, in sweeps/friction)"
    assert "<th>plant.friction</th>" in finished._repr_html_() and "2 of 2 points passed" in finished._repr_html_()
    assert [group.labels for group in finished.summary.groups] == [{"plant.friction": "0.5"}, {"plant.friction": "0.7"}]
    with pytest.raises(ConfigError, match="Did you mean push_map"):
        run_sweep("push_mp")


def test_a_config_that_cannot_be_built_ends_no_process(worker: Pool, parse: Parse) -> None:
    (point,) = parse("factors: [{key: robot.posture, kind: values, values: [nowhere]}]").points
    ((_, result),) = worker.map(warm, [point.config])
    assert result is None


@pytest.mark.usefixtures("one_worker")
def test_a_signal_leaves_no_point_half_claimed_or_half_saved(
    tmp_path: Path, parse: Parse, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal comes where the claim's file is there and its holder not yet known, or the row saved and not freed."""
    sweep = parse(TWO)
    whole: dict[str, Callable[..., object]] = {"claim": SweepFolder.claim, "keep_log": SweepFolder.keep_log}
    for number, name in enumerate(whole):

        def interrupted(self: SweepFolder, *args: object, method: Callable[..., object] = whole[name]) -> object:
            result = method(self, *args)
            os.kill(os.getpid(), signal.SIGTERM)
            return result

        out = tmp_path / name
        with monkeypatch.context() as patch:
            patch.setattr(SweepFolder, name, interrupted)
            finished = run_sweep(sweep, out, workers=1)
        assert (finished.signal, len(finished.rows)) == (signal.SIGTERM, number)
        assert [list((out / folder).iterdir()) for folder in ("claims", "scratch")] == [[], []]


class DoomedPool:
    """Stands for worker processes of which one hangs and one dies."""

    def __init__(self, *_: object) -> None:
        pass

    def __enter__(self) -> "DoomedPool":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def map(self, function: object, tasks: Iterable[Any], workers: int | None = None) -> Iterator[tuple[Any, object]]:
        yield from zip(tasks, (Hung("too long"), Died("killed")), strict=False)


def test_what_hangs_or_dies_is_a_row_with_its_reason_and_a_config_that_repeats_it(
    tmp_path: Path, parse: Parse, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lgmpc.sweeps.execution.Pool", DoomedPool)
    sweep = parse("factors: [{key: seed, kind: values, values: [1, 2]}]")
    finished = run_sweep(sweep, tmp_path / "out")
    rows = [finished.rows[point.key] for point in sweep.points]
    assert [(row.ending, row.reasons) for row in rows] == [(Ending.HUNG, ("too long",)), (Ending.DIED, ("killed",))]
    kept = [tmp_path / "out" / "logs" / f"broken-{point.key[:12]}.yaml" for point in sweep.points]
    assert [load_config(file) for file in kept] == [point.config for point in sweep.points]


CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>

static int calls;
static time_t step(void) { return (++calls % 2 ? 1 : -1) * 3 * 86400; }

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int code = real(clock, now);
    if (clock == CLOCK_REALTIME) now->tv_sec += step();
    return code;
}

int gettimeofday(struct timeval *now, void *zone) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *now) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (now) *now = exact.tv_sec;
    return exact.tv_sec;
}
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux") or shutil.which("cc") is None, reason="preloads a library")
def test_a_clock_that_is_stepped_changes_no_result(tmp_path: Path) -> None:
    """By three days, to and fro at every call: durations and limits are of the clock that is not stepped."""
    source, library = tmp_path / "clock.c", tmp_path / "clock.so"
    source.write_text(CLOCK, encoding="utf-8")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    text = STAND + "factors: [{key: seed, kind: values, values: [1, 2]}]\nmetrics: [max_tilt_deg]\ntime_limit_s: 300.0"
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SCRIPT.format(text=text, out=str(out)) + "    print(time.time() - time.time())", encoding="utf-8")
    environment = os.environ | {"LD_PRELOAD": str(library)}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert abs(float(done.stdout.splitlines()[-1])) > 5.9 * 86400  # the clock is stepped
    sweep = parse_sweep(text)
    rows = SweepFolder.open(out, sweep, resume=True).results.rows()
    for point in sweep.points:
        row, alone = rows[point.key], run_config(point.config, tmp_path / "alone").session.metrics
        assert alone is not None
        assert (row.ending, row.metrics) == (Ending.PASS, {"max_tilt_deg": alone.max_tilt_deg})
        assert 0.0 < row.elapsed_s < 300.0


@pytest.mark.slow
def test_two_processes_share_a_folder_and_no_point_is_computed_twice(tmp_path: Path) -> None:
    text = STAND + "factors: [{key: seed, kind: values, values: [1, 2, 3, 4, 5, 6]}]"
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SCRIPT.format(text=text, out=str(out)), encoding="utf-8")
    both = [subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate(timeout=300)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert all("ended by None" in each for each in said)
    keys = [json.loads(line)["key"] for line in (out / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    assert sorted(keys) == sorted(point.key for point in parse_sweep(text).points)
    assert [list((out / name).iterdir()) for name in ("claims", "scratch")] == [[], []]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not enforce the limit")
def test_what_exhausts_its_memory_is_a_row_with_its_reason(tmp_path: Path) -> None:
    """The log of a simulated hour takes six gigabytes."""
    factor = "memory_limit_gb: 3.0\nfactors: [{key: duration_s, kind: values, values: [3600.0, 0.05]}]"
    sweep = parse_sweep(STAND.replace("duration_s: 0.1, ", "") + factor)
    finished = run_sweep(sweep, tmp_path / "sweep", workers=1)
    hour, moment = (finished.rows[point.key] for point in sweep.points)
    assert (hour.ending, moment.ending) == (Ending.RAISED, Ending.PASS)
    assert "MemoryError" in hour.reasons[0] and "allocate" in hour.reasons[0]


@pytest.mark.usefixtures("one_worker")
def test_points_that_another_process_computes_are_left_to_it(tmp_path: Path, parse: Parse) -> None:
    sweep = parse("factors: [{key: seed, kind: values, values: [1, 2]}]")
    folder = SweepFolder.open(tmp_path / "out", sweep, resume=False)
    claim = folder.claim(sweep.points[0].key)
    assert claim is not None
    # A lock belongs to the open file, so this process excludes itself too.
    finished = run_sweep(sweep, tmp_path / "out", workers=1, resume=True)
    assert set(finished.rows) == {sweep.points[1].key}
    claim.release()


def test_the_number_of_workers_is_checked(tmp_path: Path, parse: Parse) -> None:
    with pytest.raises(InputError, match="workers: got 0"):
        run_sweep(parse(TWO), tmp_path / "out", workers=0)
    assert not (tmp_path / "out").exists()


SCRIPT = """
import sys, time
from pathlib import Path
from lgmpc.sweeps import parse_sweep, run_sweep
if __name__ == "__main__":
    sweep = parse_sweep({text!r})
    done = run_sweep(sweep, Path({out!r}), workers=1, resume=True, progress=lambda now: print(now.done, flush=True))
    print("ended by", done.signal)
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_sweep_goes_on(tmp_path: Path, number: signal.Signals) -> None:
    text = STAND + "factors: [{key: seed, kind: values, values: [1, 2, 3]}]"
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SCRIPT.format(text=text, out=str(out)), encoding="utf-8")
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=dict(os.environ)) as process:
        assert process.stdout is not None
        while process.stdout.readline() != "1\n":
            pass
        process.send_signal(number)
        rest = process.stdout.read()
    if number != signal.SIGKILL:
        assert f"ended by {number!r}" in rest or f"ended by {number}" in rest
        assert process.returncode == 0
        assert list((out / "claims").iterdir()) == []
        assert list((out / "scratch").iterdir()) == []
    sweep = parse_sweep(text)
    before = set(SweepFolder.open(out, sweep, resume=True).results.rows())
    assert 1 <= len(before) < 3
    if number == signal.SIGKILL:
        _wait_until(lambda: not _locked(out))  # its worker notices that it is alone, and ends
    new: list[SweepProgress] = []
    finished = run_sweep(sweep, out, workers=1, resume=True, progress=new.append)
    assert {row.ending for row in finished.rows.values()} == {Ending.PASS}
    assert len(finished.rows) == 3
    assert new[-1].new == 3 - len(before)


def _locked(out: Path) -> bool:
    import fcntl

    for file in (out / "claims").iterdir():
        with file.open() as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
    return False


def _wait_until(holds: Callable[[], bool]) -> None:
    for _ in range(600):
        if holds():
            return
        time.sleep(0.1)
    pytest.fail("waited for a minute")
