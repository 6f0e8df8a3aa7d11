"""``lgmpc sweep``: tables, JSON, exit codes, errors."""

import json
from pathlib import Path

import pytest

from .conftest import Invoke

SWEEP = """
# A robot stands.
name: stand
base: solo12_stand
set: {duration_s: 0.1, mpc.enabled: false}
gate: {max_tilt_deg: 5.0}
factors: [{key: plant.mass_scale, kind: values, values: [1.0, 9.0]}]
metrics: [max_tilt_deg, com_rms_error_m]
"""


@pytest.fixture
def sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "my.yaml"
    file.write_text(SWEEP, encoding="utf-8")
    return file


def test_a_sweep_is_run_saved_shown_and_resumed(sweep: Path, invoke: Invoke) -> None:
    code, output = invoke("sweep", sweep, "--workers", "1", "gate.max_com_error_m=0.0005")
    assert code == 0
    assert "plant.mass_scale  points" in output
    assert "DONE  stand: 1 of 2 points passed" in output
    assert "1 of 2 points" in output and " left" in output, "the progress"
    assert "simulated seconds per second and core" in output
    code, output = invoke("sweep", sweep, "--resume", "--json", "gate.max_com_error_m=0.0005")
    assert code == 0
    content = json.loads(output[output.index("{") :])
    assert content["passed"] and content["finished"] == 2
    assert [group["endings"] for group in content["groups"]] == [{"pass": 1}, {"fail": 1}]
    assert set(content["groups"][0]["metrics"]) == {"max_tilt_deg", "com_rms_error_m"}
    assert json.loads(Path("sweeps/stand/summary.json").read_text())["groups"] == content["groups"]
    code, output = invoke("sweep", sweep, "--resume", "expect.min_pass_fraction=0.9", "gate.max_com_error_m=0.0005")
    assert code == 1
    assert "50 % passed, expected at least 90 %" in output
    code, output = invoke("sweep", sweep, "gate.max_com_error_m=0.0005")
    assert (code, "--resume" in output) == (2, True)
    code, output = invoke("sweep", sweep, "--resume", "set.seed=1")
    assert (code, "holds another sweep" in output) == (2, True)


def test_bad_input_is_one_error_with_key_and_remedy(sweep: Path, invoke: Invoke) -> None:
    code, output = invoke("sweep", sweep, "factors.0.key=plant.mass_scal")
    assert code == 2
    assert "Did you mean plant.mass_scale" in output
    code, output = invoke("sweep", "push_mp")
    assert code == 2
    assert "push_map" in output
    assert invoke("sweep", sweep, "--workers", "0")[0] == 2
    assert not Path("sweeps").exists()
