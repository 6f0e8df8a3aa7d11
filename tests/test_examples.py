"""The examples of ``scripts/`` run and reach their targets."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.errors import InputError

SCRIPTS = Path(__file__).parent.parent / "scripts"


def example(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_optimise_com_circle() -> None:
    solution, error = example("optimise_com_circle").solve()
    assert solution.status.name == "CONVERGED", solution.explain()
    assert np.abs(solution.defects()).max() < 1e-9
    assert error.max() < 0.002  # measured 1.1 mm, with the cost of effort
    assert np.abs(solution.us).max() < 1.8  # unconstrained here, yet within the motors' reach


SAGGING = """
name: sagging
base: solo12_stand
set: {duration_s: 0.3, mpc.enabled: false, gate: {}, wbc.gains.com.kp: 2.0}
factors: [{key: plant.base_added_mass_kg, kind: values, values: [0.3]}]
"""


@pytest.mark.slow
def test_tune_finds_a_stiffer_gain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot that stands sinks by less the stiffer the gain is; here it begins with a soft one."""
    monkeypatch.chdir(tmp_path)
    Path("sagging.yaml").write_text(SAGGING)
    command = ["sagging.yaml", "--objective", "com_rms_error_m", "--keys", "wbc.gains.com.kp=1:200:log"]
    main = example("tune").main
    assert main([*command, "--trials", "3", "--workers", "1"]) == 0
    assert "held out, com_rms_error_m: -" in capsys.readouterr().out
    assert main([*command, "--trials", "4", "--workers", "1"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("\ntrial ") + shown.startswith("trial 3") == 1, "the first three are in the journal"
    with pytest.raises(InputError, match=r"wbc.gains.com.kp: got soft; expected a range around 2\.0"):
        main([*command[:-1], "wbc.gains.com.kp=soft"])
