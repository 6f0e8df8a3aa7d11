"""``lgmpc run``: exit codes, the folder, its repetition, and signals."""

import json
import os
import signal
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from lgmpc.config import load_config
from lgmpc.runs import RunFolder

from .conftest import STAND, Invoke, Result, Start

SHORT = ("--set", "duration_s=0.2", "mpc.enabled=false", "gate={max_tilt_deg: 5, max_abs_torque_nm: 1.8}")


def test_a_run_that_keeps_its_gate_exits_with_0_and_can_be_repeated(
    result: Result, invoke: Invoke, tmp_path: Path
) -> None:
    finished = result("run", "solo12_stand", *SHORT)
    assert (finished.returncode, "PASS  solo12_stand" in finished.stdout) == (0, True), finished.stderr
    assert "tilt / deg" in finished.stdout and "simulating 0.2 s" in finished.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert f"lgmpc play runs/{folder.name}" in finished.stdout
    assert "\ncertified: normal force, friction," in finished.stdout and "momentum balance" in finished.stdout
    run = RunFolder.load(folder)
    assert run.log.time[-1] == pytest.approx(0.2, abs=0.01)

    config = load_config(folder / "config.yaml")
    assert config == load_config(STAND, SHORT[1:])
    code, output = invoke("run", folder / "config.yaml", "--json", "--out", tmp_path / "again")
    content = json.loads(output[output.index("{") :])
    assert code == 0
    assert content["verdict"] == "pass"
    assert RunFolder.load(content["folder"]).log.q.tobytes() == run.log.q.tobytes(), "not the same bits"


def test_a_run_that_breaks_its_gate_exits_with_1_and_says_why(invoke: Invoke, tmp_path: Path) -> None:
    code, output = invoke("run", STAND, *SHORT, "gate.max_abs_torque_nm=0.01", "--out", tmp_path)
    assert code == 1
    assert "FAIL  solo12_stand" in output
    assert "broken" in output and "allowed at most 0.01 N.m (max_abs_torque_nm)" in output


def test_quiet_is_quiet(invoke: Invoke, tmp_path: Path) -> None:
    assert invoke("run", STAND, *SHORT, "--quiet", "--out", tmp_path) == (0, "PASS  solo12_stand\n")


@pytest.mark.parametrize("plant", ["mujoco", "pinocchio"])
def test_the_plant_can_be_chosen(plant: str, invoke: Invoke, tmp_path: Path) -> None:
    code, output = invoke("run", STAND, *SHORT, "--plant", plant, "--out", tmp_path)
    assert code == 0, output
    (folder,) = tmp_path.iterdir()
    assert load_config(folder / "config.yaml").plant.kind == plant


@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGTERM, signal.SIGHUP))]
)  # a closed terminal sends the third in the next test; the second has the same handler
def test_a_signal_saves_the_partial_run_and_exits_with_128_and_its_number(
    start: Start, tmp_path: Path, number: signal.Signals
) -> None:
    with start("run", STAND, *SHORT, "duration_s=1000") as process:
        assert process.stderr is not None and process.stdout is not None
        while "simulating" not in (line := process.stderr.readline()):
            assert line, "the run ended before it began"
        time.sleep(0.5)
        process.send_signal(number)
        assert process.wait(timeout=60) == 128 + number
        output, errors = process.stdout.read(), process.stderr.read()
    assert "INTERRUPTED  solo12_stand" in output
    assert "Traceback" not in output + errors
    (folder,) = (tmp_path / "runs").iterdir()
    run = RunFolder.load(folder)
    assert run.result.verdict.outcome.value == "interrupted"
    assert 0.0 < run.log.time[-1] < 1000.0


def test_a_terminal_that_closes_loses_nothing(start: Start, tmp_path: Path) -> None:
    terminal, inside = os.openpty()
    shown = b""
    with start("run", STAND, *SHORT, "duration_s=1000", terminal=inside) as process:
        os.close(inside)
        while b"simulating" not in shown:
            shown += os.read(terminal, 4096)
        os.close(terminal)
        assert process.wait(timeout=60) == 129
    (folder,) = (tmp_path / "runs").iterdir()
    assert RunFolder.load(folder).result.verdict.outcome.value == "interrupted"
    assert not (tmp_path / "state").exists(), "it is no crash"


@pytest.mark.skipif(find_spec("ziglang") is not None, reason="ziglang is installed, which brings a compiler")
def test_without_a_compiler_one_warning_names_the_remedy(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("LGMPC_JIT", raising=False)
    finished = result("run", STAND, "--set", "duration_s=0.02", "gate={max_tilt_deg: 5}")
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("no C compiler found") == 1
    assert "apt install gcc" in finished.stderr
    assert ".py" not in finished.stderr, "no line of code beside it"


def test_a_run_is_replayed_as_one_page(invoke: Invoke, tmp_path: Path) -> None:
    assert invoke("run", STAND, *SHORT, "--out", tmp_path)[0] == 0
    page = tmp_path / "page.html"
    code, output = invoke("play", "latest", "--runs", tmp_path, "--html", page)
    assert code == 0
    assert str(page) in output
    assert page.read_text(encoding="utf-8").lower().startswith("<!doctype html>")
    assert invoke("play", "latest", "--runs", tmp_path)[0] == 0
    (own,) = tmp_path.glob("*/replay.html")
    assert own.read_bytes() == page.read_bytes()
