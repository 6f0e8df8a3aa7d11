"""``lgmpc ablate``: table, JSON, resumption, errors."""

import json
from pathlib import Path

import pytest

from .conftest import Invoke


@pytest.mark.usefixtures("one_worker")
def test_parts_are_taken_away_in_pairs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> None:
    monkeypatch.chdir(tmp_path)
    shorter = ("--set", "duration_s=0.3", "--set", "mpc.enabled=false", "--set", "gate={max_tilt_deg: 2.0}")
    command = (
        "ablate",
        "solo12_stand",
        "wbc.weights.base_orientation",
        "wbc.gains.com.kp=0.0",
        *shorter,
        "--workers",
        "1",
    )
    code, output = invoke(*command)
    assert code == 0
    assert "nothing  " in output and "the complete controller" in output
    assert "wbc.weights.base_orientation=0.0" in output and "task of the base's orientation" in output
    assert "saved in sweeps/ablation-solo12_stand" in output
    code, output = invoke(*command, "--resume", "--json")
    content = json.loads(output[output.index("{") :])
    assert code == 0 and content["complete"]["value"] == 1.0
    assert {each["part"]["key"] for each in content["parts"]} == {"wbc.weights.base_orientation", "wbc.gains.com.kp"}
    assert len((tmp_path / "sweeps/ablation-solo12_stand/results.jsonl").read_text().splitlines()) == 3


def test_a_key_that_is_none_is_an_error(invoke: Invoke) -> None:
    code, output = invoke("ablate", "solo12_stand", "wbc.weights.postur")
    assert (code, "wbc.weights.posture" in output) == (2, True)
