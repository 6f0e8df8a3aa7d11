"""Sweeps of a robot that stands for a tenth of a second, computed in worker processes."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lgmpc.config import load_config
from lgmpc.config.execution import run_config
from lgmpc.errors import ConfigError, InputError
from lgmpc.runs import RunFolder, flat_metrics
from lgmpc.sweeps import Ending, SweepProgress, parse_sweep, run_sweep
from lgmpc.sweeps.folder import ROWS, SweepFolder, read_rows
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
    assert seen[0].speed is None
    assert finished.progress.simulated_s == pytest.approx(0.4, abs=0.008)
    before = (tmp_path / "out" / "results.jsonl").read_bytes()
    again = run_sweep(sweep, tmp_path / "out", workers=1, resume=True)
    assert again.rows == finished.rows
    assert (tmp_path / "out" / "results.jsonl").read_bytes() == before


@pytest.mark.usefixtures("one_worker")
def test_parts_of_several_machines_are_one_sweep(tmp_path: Path, parse: Parse) -> None:
    sweep = parse("factors: [{key: seed, kind: values, values: [0, 1]}]")
    parts = [run_sweep(sweep.part(k, 2), tmp_path / str(k), workers=1) for k in (1, 2)]
    assert [len(each.rows) for each in parts] == [1, 1]
    whole = shutil.copytree(tmp_path / "1", tmp_path / "whole")
    (whole / ROWS).write_bytes(b"".join((tmp_path / k / ROWS).read_bytes() for k in "12"))
    seen: list[SweepProgress] = []
    finished = run_sweep(sweep, whole, resume=True, progress=seen.append)
    assert (seen, finished.summary.count) == ([], "2 of 2 points passed")
    with pytest.raises(InputError, match="part: got 3/2; expected K/N, K from 1 to N"):
        sweep.part(3, 2)


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
def test_a_sweep_is_run_from_its_content_and_shown_in_a_line_and_as_a_table(
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
    table = finished.to_pandas()
    assert table["ending"].tolist() == ["pass", "pass"] and len(set(table["plant.friction"])) == 2
    assert [group.labels for group in finished.summary.groups] == [{"plant.friction": "0.5"}, {"plant.friction": "0.7"}]
    with pytest.raises(ConfigError, match="Did you mean push_map"):
        run_sweep("push_mp")


def test_a_config_that_cannot_be_built_ends_no_process(worker: Pool, parse: Parse) -> None:
    (point,) = parse("factors: [{key: robot.posture, kind: values, values: [nowhere]}]").points
    ((_, result),) = worker.map(warm, [point.config])
    assert result is None


@pytest.mark.usefixtures("one_worker")
def test_a_signal_leaves_no_point_half_saved(tmp_path: Path, parse: Parse, monkeypatch: pytest.MonkeyPatch) -> None:
    """The signal comes where the log is kept and the row not yet written."""

    def interrupted(self: SweepFolder, *args: object, keep: Callable[..., object] = SweepFolder.keep_log) -> object:
        result = keep(self, *args)
        os.kill(os.getpid(), signal.SIGTERM)
        return result

    monkeypatch.setattr(SweepFolder, "keep_log", interrupted)
    finished = run_sweep(parse(TWO), tmp_path / "out", workers=1)
    assert (finished.signal, len(finished.rows)) == (signal.SIGTERM, 1)
    assert not (tmp_path / "out" / "scratch").exists()


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


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not enforce the limit")
def test_what_exhausts_its_memory_is_a_row_with_its_reason(tmp_path: Path) -> None:
    """The log of a simulated hour takes six gigabytes."""
    factor = "memory_limit_gb: 3.0\nfactors: [{key: duration_s, kind: values, values: [3600.0, 0.05]}]"
    sweep = parse_sweep(STAND.replace("duration_s: 0.1, ", "") + factor)
    finished = run_sweep(sweep, tmp_path / "sweep", workers=1)
    hour, moment = (finished.rows[point.key] for point in sweep.points)
    assert (hour.ending, moment.ending) == (Ending.RAISED, Ending.PASS)
    assert "MemoryError" in hour.reasons[0] and "allocate" in hour.reasons[0]


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
        assert not (out / "scratch").exists()
    sweep = parse_sweep(text)
    before = set(read_rows(out / ROWS))
    assert 1 <= len(before) < 3
    new: list[SweepProgress] = []
    finished = run_sweep(sweep, out, workers=1, resume=True, progress=new.append)
    assert {row.ending for row in finished.rows.values()} == {Ending.PASS}
    assert len(finished.rows) == 3
    assert len(new) == 4 - len(before)
