"""``lgmpc demo``: the list, the table, the files, the exit code."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import lgmpc.demos as catalogue
from lgmpc.demos import NAMES, SUMMARIES, load_demo
from lgmpc.demos.outcome import Demo, Outcome, Row


@pytest.fixture
def wrong(monkeypatch) -> None:
    """A demonstration whose prediction is not met, in place of all others."""
    outcome = Outcome((Row("pi", 3.0, 3.14159, 0.1), Row("circle", 1.0, float("nan"), 1.0, "m")))
    monkeypatch.setattr("lgmpc.cli.demonstrating.load_demo", lambda name: Demo(name, "shows nothing", lambda: outcome))


def test_the_list_names_every_demonstration(invoke) -> None:
    code, text = invoke("demo")
    assert code == 0
    lines = text.splitlines()
    for name, summary in SUMMARIES.items():
        assert any(line.split() == [name, *summary.split()] for line in lines), f"{name}: on a line of its own"
    assert max(len(line.rstrip()) for line in lines) <= 78  # and the padding of both columns


def test_the_list_reads_no_demonstration() -> None:
    code = "import sys; from lgmpc.cli.demonstrating import list_demos; list_demos(); print(*sys.modules, sep='\\n')"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"casadi", "pinocchio", "scipy", "matplotlib", "lgmpc.mechanics", "lgmpc.demos.cat"}
    assert "lgmpc.demos" in found and not heavy & set(found)


def test_every_module_is_listed() -> None:
    from pathlib import Path

    folder = Path(catalogue.__file__).parent
    found = {
        f.stem.replace("_", "-")
        for f in folder.glob("*.py")
        if "\ndef run() -> Outcome:" in f.read_text(encoding="utf-8")
    }
    assert found == set(NAMES)
    assert all(load_demo(name).name == name for name in NAMES)


def test_a_demonstration_prints_its_table_and_writes_its_files(invoke, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")
    code, text = invoke("demo", "solo12-momentum", "--out", tmp_path / "here", "--no-view")
    assert code == 0, text
    assert "AGREES" in text and "predicted" in text
    assert {file.name for file in (tmp_path / "here").iterdir()} == {
        "solo12-momentum.json",
        "solo12-momentum.png",
        "solo12-momentum.html",
    }


def test_a_prediction_that_is_not_met_is_exit_code_1(invoke, tmp_path, wrong) -> None:
    code, text = invoke("demo", "wrong", "--out", tmp_path)
    assert code == 1
    assert "DIFFERS" in text
    assert text.count("differs") == 2


def test_json_holds_no_nan(invoke, tmp_path, wrong) -> None:
    code, text = invoke("demo", "wrong", "--out", tmp_path, "--json")
    content = json.loads(text[text.index("{") :])
    assert code == 1
    assert content["agrees"] is False
    assert [row["measured"] for row in content["rows"]] == [3.14159, None]
    assert content == json.loads((tmp_path / "wrong.json").read_text(encoding="utf-8"))


def test_an_unknown_name_is_exit_code_2_and_names_the_nearest(invoke, tmp_path) -> None:
    code, text = invoke("demo", "solo12-momentun", "--out", tmp_path)
    assert code == 2
    assert "Did you mean solo12-momentum?" in text


def test_a_folder_that_cannot_be_made_is_exit_code_2(invoke, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    code, text = invoke("demo", "solo12-momentum", "--out", tmp_path / "file" / "below")
    assert code == 2
    assert "--out" in text
