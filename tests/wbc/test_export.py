"""Whole-body tick and MPC update in C: compiled by a C compiler alone, they repeat recorded runs bit for bit."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from lgmpc import load_config, run_config
from lgmpc.cli.app import app
from lgmpc.config.exporting import export_controller
from lgmpc.errors import InputError
from lgmpc.wbc import NumericTask, WholeBodyController, WholeBodySettings
from lgmpc.wbc.export import TickRecorder
from lgmpc.wbc.settings import Gain

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def build(folder: Path, *arguments: str) -> Path:
    """Compile the folder's sources with the flags of its own build file, and further arguments."""
    if (folder.name) == "mpc":  # with the tick, as one program has both
        arguments = (*arguments, *(str(path) for path in folder.parent.glob("*.c") if path.name != "replay.c"))
    flags = re.search(r"add_compile_options\((.*?) \$<", (folder / "CMakeLists.txt").read_text()).group(1).split()
    sources = [str(path) for path in folder.glob("*.c") if path.name != "replay.c" or "-shared" not in arguments]
    target = folder / ("tick.so" if "-shared" in arguments else "replay")
    subprocess.run(["cc", *flags, "-march=native", *arguments, *sources, "-lm", "-o", target], check=True)
    return target


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "changes", "updates"),
    [
        ("solo12_velocity", ["duration_s=3.0"], 312),
        ("solo12_slope", ["duration_s=1.5"], 157),  # forces in axes that are not the world's
        ("talos_stand", ["duration_s=0.7"], 0),  # sums over soles
    ],
)
def test_recorded_runs_are_repeated_bit_for_bit(
    tmp_path: Path, config: str, changes: list[str], updates: int, caplog: pytest.LogCaptureFixture
) -> None:
    run = run_config(load_config(config, changes), out=tmp_path / "runs")
    ticks, found = export_controller(run.folder.path, tmp_path / "tick")
    assert found == updates
    if updates:
        mpc = tmp_path / "tick" / "mpc"
        program, file = build(mpc), mpc / "records.bin"
        replayed = subprocess.run([program, file], capture_output=True, text=True)
        assert f"{updates} updates: 0 with other plans" in replayed.stdout and replayed.returncode == 0
        recorded = np.fromfile(file).reshape(updates, -1)
        recorded[5, -1] += 1e-9  # a force
        recorded[7, 2] = np.nan  # the centre of mass
        recorded[:10].tofile(file)
        replayed = subprocess.run([program, file], capture_output=True, text=True)
        assert "1 with another status" in replayed.stdout and replayed.returncode == 1
        assert re.search(r"(\d+) with other plans", replayed.stdout).group(1) != "0"
    else:
        assert "the MPC's update is not written: robot.feet: got 8 points" in caplog.text
    assert ticks == round(run.session.metrics.survived_s / 1e-3)
    replayed = subprocess.run(
        [build(tmp_path / "tick"), tmp_path / "tick" / "records.bin"], capture_output=True, text=True
    )
    assert f"{ticks} ticks: 0 with other torques" in replayed.stdout and replayed.returncode == 0


@needs_compiler
@pytest.mark.slow
def test_other_torques_and_other_states_are_found(tmp_path: Path) -> None:
    """The comparison can fail, and a state that is not finite has its status."""
    run = run_config(load_config("solo12_balance", ["duration_s=0.1"]), out=tmp_path / "runs")
    folder = tmp_path / "tick"
    written = CliRunner().invoke(app, ["export", str(run.folder.path), "--c", str(folder)])
    assert written.exit_code == 0 and "100 ticks" in written.output
    replay, file = build(folder), folder / "records.bin"
    recorded = np.fromfile(file).reshape(100, -1)
    changed = recorded.copy()
    changed[50, -31] += 1e-12  # the first force comes after twelve torques; the acceleration has 18 numbers
    changed[50, -18 - 12 - 1] += 1e-12
    changed.tofile(file)
    result = subprocess.run([replay, file], capture_output=True, text=True)
    assert "1 with other torques" in result.stdout and result.returncode == 1
    assert subprocess.run([replay, file, "1e-9"], capture_output=True).returncode == 0
    changed[50] = recorded[50]
    changed[50, 1] = np.nan
    changed.tofile(file)
    assert "1 with another status" in subprocess.run([replay, file], capture_output=True, text=True).stdout
    library = ctypes.CDLL(str(build(folder, "-shared", "-fPIC", "-fvisibility=default")))
    library.lgmpc_tick_create.restype = ctypes.c_void_p
    tick = ctypes.c_void_p(library.lgmpc_tick_create())
    results = np.full(12 + 12 + 18, 7.0)
    given = np.ascontiguousarray(changed[50, 1:])
    assert (
        library.lgmpc_tick_solve(tick, given.ctypes.data_as(ctypes.c_void_p), results.ctypes.data_as(ctypes.c_void_p))
        == 2
    )
    assert (results == 7.0).all()
    library.lgmpc_tick_destroy(tick)


class Lifted(NumericTask):
    """A task in Python."""

    dim = 1

    def update(self, terms) -> None:
        """Leave the rows at zero."""


def test_what_cannot_be_written_in_c_is_named(tmp_path: Path, solo12) -> None:
    tasks = [Lifted(solo12, Gain(kp=1.0), 1.0, "lifted")]
    with pytest.raises(InputError, match=r"^wbc.tasks: got 'lifted' in Python"):
        TickRecorder(WholeBodyController(solo12, WholeBodySettings(), tasks))
    with pytest.raises(InputError, match=r"^wbc.solver: got proxqp"):
        TickRecorder(WholeBodyController(solo12, WholeBodySettings(solver="proxqp")))
    measured = load_config("solo12_balance", ["duration_s=0.02", "timing.computing=measured"])
    measured = run_config(measured, out=tmp_path / "measured")
    with pytest.raises(InputError, match=r"^timing.computing: got measured.*--set timing.computing=modelled"):
        export_controller(measured.folder.path, tmp_path / "tick")
    run = run_config(load_config("solo12_balance", ["duration_s=0.02"]), out=tmp_path / "runs")
    (tmp_path / "mine").write_text("mine")
    with pytest.raises(InputError, match=r"^--c: .*a new or an empty folder"):
        export_controller(run.folder.path, tmp_path)
    assert (tmp_path / "mine").read_text() == "mine"
