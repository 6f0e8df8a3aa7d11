"""Lookup of run folders."""

import os
from pathlib import Path

import pytest

from lgmpc.errors import RunFolderError
from lgmpc.runs import find_run


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    for age, name in enumerate(["20260101T000000Z-b", "20260101T000000Z-a", "20250101T000000Z-old"]):
        (tmp_path / name).mkdir()
        result = tmp_path / name / "run.json"
        result.write_text("{}", encoding="utf-8")
        os.utime(result, ns=(10**18 - age, 10**18 - age))
    (tmp_path / "20270101T000000Z-unfinished").mkdir()
    return tmp_path


def test_latest_is_the_newest_that_is_complete(runs: Path) -> None:
    assert find_run("latest", runs).name == "20260101T000000Z-b"


def test_a_run_is_found_by_path_or_name(runs: Path) -> None:
    folder = runs / "20250101T000000Z-old"
    assert find_run(str(folder), Path("nowhere")) == folder
    assert find_run(folder.name, runs) == folder


def test_a_misspelt_name_gets_a_hint(runs: Path) -> None:
    with pytest.raises(RunFolderError, match="Did you mean 20260101T000000Z-"):
        find_run("20260101T00000Z-a", runs)


def test_no_runs_say_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="lgmpc run solo12_balance"):
        find_run("latest", tmp_path / "runs")
