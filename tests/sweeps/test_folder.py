"""The folder of a sweep: lines complete after kills, claims, kept logs."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lgmpc.errors import RunFolderError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.folder import Results, SweepFolder, read_document

from .conftest import Parse

VARIED = "factors: [{key: seed, kind: values, values: [1, 2]}]"
Make = Callable[..., Row]


def test_rows_come_back_as_they_were(tmp_path: Path, row: Make) -> None:
    results = Results(tmp_path / "results.jsonl")
    rows = [
        row("a", metrics={"max_tilt_deg": 1.5, "fell": None}, levels={"plant.friction": 0.6}, draw=3, simulated_s=2.0),
        row("b", Ending.FAIL, reasons=("the robot fell after 1 s",)),
        row("c", boundary=3.5, trials=((1.0, True), (4.0, False)), violations=(2.0,)),
        row("d", Ending.DIED, reasons=("its process ended",)),
    ]
    for each in rows:
        results.append(each)
    assert list(Results(tmp_path / "results.jsonl").rows().values()) == rows
    assert list(results.rows().values()) == rows


@pytest.mark.parametrize("content", [b"name: \xff", b"[1, 2]"])
def test_a_damaged_document_is_reported(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "sweep.yaml").write_bytes(content)
    with pytest.raises(RunFolderError, match=r"sweep\.yaml is damaged: not"):
        read_document(tmp_path / "sweep.yaml")


def test_a_row_that_has_no_number_is_still_json(tmp_path: Path, row: Make) -> None:
    results = Results(tmp_path / "results.jsonl")
    results.append(row("a", metrics={"x": float("nan")}))
    assert results.rows()["a"].metrics == {"x": None}


def test_a_line_cut_off_by_a_kill_costs_only_itself(tmp_path: Path, row: Make) -> None:
    file = tmp_path / "results.jsonl"
    Results(file).append(row("a"))
    whole = file.read_bytes()
    for cut in (1, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole + row("b").to_json().encode()[:cut])
        reader = Results(file)
        assert set(reader.rows()) == {"a"}
        reader.append(row("c"))
        assert set(reader.rows()) == {"a", "c"}
        assert set(Results(file).rows()) == {"a", "c"}


def test_a_full_disk_leaves_the_finished_rows(tmp_path: Path, row: Make) -> None:
    file = tmp_path / "results.jsonl"
    Results(file).append(row("a"))
    script = f"""
import resource, signal, sys
from pathlib import Path
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.folder import Results
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({file.stat().st_size + 20}, {file.stat().st_size + 20}))
Results(Path({str(file)!r})).append(Row("b", Ending.PASS))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert "RunFolderError: cannot write" in done.stderr
    assert set(Results(file).rows()) == {"a"}
    Results(file).append(row("c"))
    assert set(Results(file).rows()) == {"a", "c"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"key": 1}, "key: .*string, got 1"),
        ({"ending": "gone"}, "ending: .*'died', got the text 'gone'"),
        ({"reasons": "why"}, "reasons: .*, got the text 'why'"),
        ({"metrics": [1.0]}, "metrics: .*object"),
        ({"metrics": {"max_tilt_deg": "much"}}, "metrics.max_tilt_deg: .*number, got the text 'much'"),
        ({"boundary": [1.0]}, "boundary: .*number"),
        ({"trials": [[1.0]]}, "trials.0.1: Field required"),
        ({"levels": 3}, "levels: .*object"),
        ({"draw": 1.5}, "draw: .*integer, got 1.5"),
    ],
)
def test_a_damaged_line_is_named(tmp_path: Path, change: dict[str, object], words: str) -> None:
    results = Results(tmp_path / "results.jsonl")
    results.append(Row("a", Ending.PASS))
    assert set(results.rows()) == {"a"}
    line = json.loads(Row("b", Ending.PASS).to_json()) | change
    with (tmp_path / "results.jsonl").open("a") as file:
        file.write(json.dumps(line) + "\n")
    with pytest.raises(RunFolderError, match=rf"results\.jsonl:2 is not a row of a sweep: {words}"):
        results.rows()


@pytest.mark.parametrize("line", [b"{}", b"[1]", b"\xff", b"nothing"])
def test_a_line_that_is_no_row_is_named(tmp_path: Path, line: bytes) -> None:
    (tmp_path / "results.jsonl").write_bytes(line + b"\n")
    with pytest.raises(RunFolderError, match=r"results\.jsonl:1 is not a row of a sweep: "):
        Results(tmp_path / "results.jsonl").rows()


def test_an_existing_folder_is_opened_only_on_request_and_only_by_its_sweep(tmp_path: Path, parse: Parse) -> None:
    folder = tmp_path / "out"
    SweepFolder.open(folder, parse(VARIED), resume=False)
    with pytest.raises(RunFolderError, match="add --resume"):
        SweepFolder.open(folder, parse(VARIED), resume=False)
    SweepFolder.open(folder, parse(VARIED, "logs.keep=2", "time_limit_s=5.0"), resume=True)
    with pytest.raises(RunFolderError, match=r"holds another sweep: set differ.*--out"):
        SweepFolder.open(folder, parse(VARIED, "set.seed=4"), resume=True)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(RunFolderError, match="not the folder of a sweep"):
        SweepFolder.open(tmp_path / "mine", parse(VARIED), resume=True)


def test_a_folder_whose_sweep_was_stopped_before_its_document_was_written_is_taken_up(
    tmp_path: Path, parse: Parse, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(path: Path) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("lgmpc.sweeps.folder.atomic_write", stopped)
        SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)
    SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)
    assert (tmp_path / "out" / "sweep.yaml").is_file()


def test_a_claim_excludes_others_until_its_holder_ends(tmp_path: Path, parse: Parse, row: Make) -> None:
    folder = SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)
    script = f"""
import fcntl, os, sys, time
descriptor = os.open({str(tmp_path / "out" / "claims" / "a")!r}, os.O_RDWR | os.O_CREAT)
fcntl.flock(descriptor, fcntl.LOCK_EX)
print("held", flush=True)
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        assert folder.claim("a") is None
        other.kill()
    claim = folder.claim("a")
    assert claim is not None
    folder.results.append(row("a"))
    claim.release()
    assert folder.claim("a") is None  # finished
    assert os.listdir(tmp_path / "out" / "claims") == []


def test_logs_of_failures_go_first(tmp_path: Path, parse: Parse, row: Make) -> None:
    folder = SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)

    def finish(key: str, ending: Ending) -> str:
        made = folder.scratch(key) / "20260101T000000Z-stand"
        made.mkdir(parents=True)
        (made / "run.json").touch()
        return folder.keep_log(row(key, ending), most=2)

    assert finish("a", Ending.PASS) == "pass-a"
    assert finish("b", Ending.PASS) == "pass-b"
    assert finish("c", Ending.PASS) == ""
    assert finish("d", Ending.FAIL) == "fail-d"
    assert finish("e", Ending.FAIL) == "fail-e"
    assert finish("f", Ending.FAIL) == ""
    assert sorted(each.name for each in folder.logs.iterdir()) == ["fail-d", "fail-e"]
    assert list((tmp_path / "out" / "scratch").iterdir()) == []
