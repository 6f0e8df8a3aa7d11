"""The folder of a sweep: lines complete after kills, claims, kept logs."""

import json
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from lgmpc.errors import RunFolderError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.folder import ROWS, SweepFolder, read_document, read_rows

from .conftest import Parse

VARIED = "factors: [{key: seed, kind: values, values: [1, 2]}]"
Make = Callable[..., Row]


@pytest.fixture
def folder(tmp_path: Path, parse: Parse) -> Iterator[SweepFolder]:
    with closing(SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)) as opened:
        yield opened


def test_rows_come_back_as_they_were(folder: SweepFolder, row: Make) -> None:
    rows = [
        row("a", metrics={"max_tilt_deg": 1.5, "fell": None}, levels={"plant.friction": 0.6}, draw=3, simulated_s=2.0),
        row("b", Ending.FAIL, reasons=("the robot fell after 1 s",)),
        row("c", boundary=3.5, trials=((1.0, True), (4.0, False))),
        row("d", Ending.DIED, reasons=("its process ended",)),
        row("e", metrics={"x": float("nan")}),
    ]
    for each in rows:
        folder.append(each)
    assert list(folder.rows.values()) == rows
    *others, last = read_rows(folder.path / ROWS).values()
    assert others == rows[:-1] and last.metrics == {"x": None}


@pytest.mark.parametrize("content", [b"name: \xff", b"[1, 2]"])
def test_a_damaged_document_is_reported(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "sweep.yaml").write_bytes(content)
    with pytest.raises(RunFolderError, match=r"sweep\.yaml is damaged: not"):
        read_document(tmp_path / "sweep.yaml")


def test_a_line_cut_off_by_a_kill_costs_only_itself(tmp_path: Path, parse: Parse, row: Make) -> None:
    file = tmp_path / "out" / ROWS
    with closing(SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)) as folder:
        folder.append(row("a"))
    whole = file.read_bytes()
    for cut in (1, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole + row("b").to_json().encode()[:cut])
        assert set(read_rows(file)) == {"a"}
        with closing(SweepFolder.open(tmp_path / "out", parse(VARIED), resume=True)) as folder:
            folder.append(row("c"))
        assert set(read_rows(file)) == {"a", "c"}


def test_a_full_disk_leaves_the_finished_rows(folder: SweepFolder, row: Make) -> None:
    folder.append(row("a"))
    size = (folder.path / ROWS).stat().st_size + 20
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        with pytest.raises(RunFolderError, match="cannot write .*the disk is full.*--resume"):
            folder.append(row("b"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    folder.append(row("c"))
    assert set(folder.rows) == set(read_rows(folder.path / ROWS)) == {"a", "c"}


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
    lines = [Row("a", Ending.PASS).to_json(), json.dumps(json.loads(Row("b", Ending.PASS).to_json()) | change)]
    (tmp_path / ROWS).write_text("".join(f"{line}\n" for line in lines))
    with pytest.raises(RunFolderError, match=rf"results\.jsonl:2 is not a row of a sweep: {words}"):
        read_rows(tmp_path / ROWS)


@pytest.mark.parametrize("line", [b"{}", b"[1]", b"\xff", b"nothing"])
def test_a_line_that_is_no_row_is_named(tmp_path: Path, line: bytes) -> None:
    (tmp_path / ROWS).write_bytes(line + b"\n")
    with pytest.raises(RunFolderError, match=r"results\.jsonl:1 is not a row of a sweep: "):
        read_rows(tmp_path / ROWS)


def test_an_existing_folder_is_opened_only_on_request_and_only_by_its_sweep(tmp_path: Path, parse: Parse) -> None:
    folder = tmp_path / "out"
    SweepFolder.open(folder, parse(VARIED), resume=False).close()
    with pytest.raises(RunFolderError, match="add --resume"):
        SweepFolder.open(folder, parse(VARIED), resume=False)
    SweepFolder.open(folder, parse(VARIED, "logs.keep=2", "time_limit_s=5.0"), resume=True).close()
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
    SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False).close()
    assert (tmp_path / "out" / "sweep.yaml").is_file()


def test_one_process_at_a_time_works_on_a_folder(tmp_path: Path, parse: Parse) -> None:
    with (
        closing(SweepFolder.open(tmp_path / "out", parse(VARIED), resume=False)),
        pytest.raises(RunFolderError, match="another process works on .*out"),
    ):
        SweepFolder.open(tmp_path / "out", parse(VARIED), resume=True)
    SweepFolder.open(tmp_path / "out", parse(VARIED), resume=True).close()


def test_logs_of_failures_go_first(folder: SweepFolder, row: Make) -> None:
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
    assert list((folder.path / "scratch").iterdir()) == []
