"""``lgmpc report``: of runs, solved problems and sweeps."""

from pathlib import Path

import pytest
from documents import ARM

from lgmpc.viz import plots

from .conftest import Invoke


def test_runs_and_solved_problems_are_reported_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke
) -> None:
    monkeypatch.chdir(tmp_path)
    some = ("base", "torques")  # all of them are drawn in tests/viz/test_report.py
    monkeypatch.setattr(plots, "FIGURES", {name: plots.FIGURES[name] for name in some})
    assert invoke("run", "solo12_stand", "duration_s=0.1", "mpc.enabled=false", "gate={}", "--quiet")[0] == 0
    code, output = invoke("report", "latest")
    assert code == 0 and output.startswith("wrote runs/") and "report.html" in output
    page = next(Path("runs").glob("*/report.html")).read_text(encoding="utf-8")
    assert '<span class="verdict pass">' in page and "it passed" in page
    Path("arm.yaml").write_text(ARM, encoding="utf-8")
    assert invoke("solve", "arm.yaml", "--quiet")[0] == 0
    code, output = invoke("report", "latest", "--html", "reach.html")
    assert (code, output[:16]) == (0, "wrote reach.html")
    page = Path("reach.html").read_text(encoding="utf-8")
    assert "Load the replay" in page and "Figures of merit" in page and "position error / mm" in page


def test_what_cannot_be_reported_on_is_an_error(tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "empty").mkdir()
    code, output = invoke("report", tmp_path / "empty")
    assert (code, "not a complete run folder" in output) == (2, True)
    assert invoke("report", "nothing", "--runs", tmp_path)[0] == 2
