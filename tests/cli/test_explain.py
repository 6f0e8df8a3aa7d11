"""``lgmpc explain``: chain of events, JSON, errors."""

import json
import shlex
from pathlib import Path

import pytest
from documents import ARM

from .conftest import Invoke


def test_a_fall_is_explained_in_words_and_as_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke
) -> None:
    monkeypatch.chdir(tmp_path)
    push = "pushes=[{body: base_link, time_s: 0.2, impulse_ns: [0.0, 7.0, 0.0]}]"
    run = ("solo12_stand", push, "duration_s=1.2", "after_fall_s=0.1", "mpc.enabled=false", "--quiet")
    assert invoke("run", *run)[0] == 1
    code, output = invoke("explain", "latest")
    assert code == 0
    assert output.startswith("FAIL  solo12_stand\n  - the robot fell (tilt")
    assert "after the beginning of: push of 7 N.s [0, 7, 0] for 200 ms" in output
    assert "first sign, at 0.2" in output
    lines = output.splitlines()
    kinds = [line.split()[2] for line in map(str.strip, lines) if line[:1].isdigit() and len(line.split()) > 2]
    assert kinds[0] == "cause" and {"limit", "balance", "contact"} <= set(kinds)
    assert sum("FAILURE" in line for line in lines) == 1
    assert "lgmpc report " in lines[-1]
    # The push is the first event: other settings would act from just before it.
    (command,) = (line for line in lines if line.startswith("next: lgmpc run "))
    _, _, _, config, option, change, *_ = shlex.split(command)
    assert (option, change) == ("--set", "changes=[{at_s: 0.19, set: {KEY: VALUE}}]")
    weaker = (change.replace("KEY: VALUE", "mpc.enabled: true"), "gate={}", "--quiet")
    assert invoke("run", config, *weaker)[0] in (0, 1)
    code, output = invoke("explain", Path(config).parent, "--json")
    assert code == 0 and json.loads(output)["events"][0]["name"] == "push"


def test_a_solve_is_explained_by_its_iterations_its_end_and_its_margins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    assert invoke("solve", "arm.yaml", "solver.max_iterations=2", "gate.max_effort_ratio=2", "--quiet")[0] == 1
    code, output = invoke("explain", "latest")
    lines = output.splitlines()
    assert code == 0 and lines[0].startswith("FAIL  arm")
    assert "ended as iteration limit after 2 iterations" in lines[1]
    assert lines[2].startswith("  - cost from ") and "criterion of convergence" in lines[2]
    assert any(line.startswith("effort ratio ") and " 2 " in line for line in lines)
    code, output = invoke("explain", "latest", "--json")
    content = json.loads(output)
    assert code == 0 and content["outcome"] == "fail"
    assert {each["name"] for each in content["nearest"]} >= {"effort ratio", "control"}


def test_what_cannot_be_explained_is_an_error(tmp_path: Path, invoke: Invoke) -> None:
    code, output = invoke("explain", "nowhere", "--runs", tmp_path)
    assert (code, "no run folder nowhere" in output) == (2, True)
