"""``lgmpc compare``: tables, JSON, exit codes."""

import json
from pathlib import Path

import pytest

from .conftest import Invoke


def test_two_runs_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> None:
    monkeypatch.chdir(tmp_path)
    short = ("solo12_stand", "duration_s=0.1", "mpc.enabled=false", "gate={max_com_error_m: 0.1}", "--quiet")
    assert invoke("run", *short)[0] == 0
    assert invoke("run", *short, "plant.mass_scale=3.0")[0] == 0
    light, heavy = sorted(Path("runs").iterdir(), key=lambda path: (path / "run.json").stat().st_mtime_ns)
    code, output = invoke("compare", light, "latest", "--margin", "0.0001")
    assert code == 1
    assert "plant.mass_scale" in output
    assert "max_com_error_m" in output
    assert "WORSE  B, beyond a margin of 0.01 %" in output
    code, output = invoke("compare", heavy, light.name, "--quiet")
    assert (code, output) == (0, "NOT WORSE  B, beyond a margin of 5 %\n")
    code, output = invoke("compare", light, heavy, "--json", "--margin", "0.0001")
    assert code == 1
    assert json.loads(output)["differences"] == [{"key": "plant.mass_scale", "first": 1.0, "second": 3.0}]
    assert invoke("compare", light, "nowhere")[0] == 2
