from __future__ import annotations

import json
import os
import pickle
import zipfile
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest

from lgmpc.errors import RunFolderError
from lgmpc.runs import Gate, RunFolder, RunResult, atomic_write, compute_metrics, judge
from lgmpc.runs.log import RunLog

NOON = datetime(2026, 3, 1, 12, 0, 5, tzinfo=timezone.utc)


@pytest.fixture
def result(standing) -> RunResult:
    metrics = compute_metrics(standing)
    return RunResult("solo12_balance", judge(metrics, Gate(max_mpc_p50_ms=0.1)), metrics, seed=4)


@pytest.fixture
def folder(tmp_path: Path, standing, result) -> RunFolder:
    folder = RunFolder.create(tmp_path / "runs", "solo12_balance", NOON)
    folder.write_config("name: solo12_balance\n")
    folder.write_arrays(standing)
    folder.write_result(result)
    return folder


def names(path: Path) -> list[str]:
    return sorted(child.name for child in path.iterdir())


def test_a_written_folder_is_read_back(folder, standing, result) -> None:
    assert folder.path.name == "20260301T120005Z-solo12_balance"
    assert names(folder.path) == ["config.yaml", "log.npz", "run.json"]
    run = RunFolder.load(folder.path)
    assert run.config == "name: solo12_balance\n"
    assert run.result == result
    for name, array in standing.arrays().items():
        np.testing.assert_array_equal(run.log.arrays()[name], array, err_msg=name)


def test_run_json_is_as_the_format_says(folder) -> None:
    content = json.loads((folder.path / "run.json").read_text())
    assert content["schema"] == 1
    assert content["verdict"] == "fail"
    assert content["reasons"] == ["median duration of an MPC update: 0.5 ms, allowed at most 0.1 ms (max_mpc_p50_ms)"]
    assert content["seed"] == 4
    assert {"python", "lgmpc", "pin", "mujoco", "numpy"} <= set(content["versions"])
    assert content["host"]["cores"] >= 1
    assert {
        "survived_s", "max_tilt_deg", "max_displacement_m", "min_base_height_m", "final_position_error_m",
        "final_tilt_deg", "max_slip_m", "max_abs_torque_nm", "torque_saturation_fraction", "min_friction_margin_n",
        "solver_failures", "deadline_misses", "mpc_ms", "wbc_ms", "real_time_factor",
    } <= set(content["metrics"])  # fmt: skip
    assert set(content["metrics"]["mpc_ms"]) == {"p50", "p99", "max"}


def test_non_finite_values_become_null(tmp_path, changed) -> None:
    metrics = compute_metrics(changed(lambda arrays: arrays["com"].fill(np.nan)))
    folder = RunFolder.create(tmp_path, "x")
    folder.write_result(RunResult("x", judge(metrics, Gate()), metrics))
    assert json.loads((folder.path / "run.json").read_text())["metrics"]["com_rms_error_m"] is None


def test_an_interrupted_run_of_no_tick_has_no_metrics(result) -> None:
    partial = RunResult("x", result.verdict, None)
    assert RunResult.from_json(partial.to_json()) == partial


def test_two_runs_in_one_second_get_two_folders(tmp_path) -> None:
    paths = [RunFolder.create(tmp_path, "a", NOON).path.name for _ in range(3)]
    assert paths == ["20260301T120005Z-a", "20260301T120005Z-a-2", "20260301T120005Z-a-3"]


@pytest.mark.parametrize(
    ("name", "slug"), [("../../etc/x y", "etc-x-y"), ("", "run"), ("...", "run"), ("Größe 2", "Gr-e-2")]
)
def test_names_cannot_refer_to_other_folders(tmp_path, name, slug) -> None:
    path = RunFolder.create(tmp_path, name, NOON).path
    assert path == tmp_path / f"20260301T120005Z-{slug}"


def test_the_log_is_not_pickled(folder) -> None:
    with np.load(folder.path / "log.npz", allow_pickle=False) as archive:
        assert all(archive[name].dtype != object for name in archive.files)


def test_a_folder_that_cannot_be_made_says_why(tmp_path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(RunFolderError, match="cannot create a run folder in .*file/runs: not a directory.*--out"):
        RunFolder.create(blocker / "runs", "a")
    with pytest.raises(RunFolderError, match="file is a file, not a folder for runs.*--out"):
        RunFolder.create(blocker, "a")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_says_so(tmp_path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(RunFolderError, match="permission denied"):
        RunFolder.create(tmp_path, "a")


def test_a_vanished_folder_is_one_error(folder, standing) -> None:
    for file in folder.path.iterdir():
        file.unlink()
    folder.path.rmdir()
    with pytest.raises(RunFolderError, match="no such file"):
        folder.write_arrays(standing)


def test_a_pipe_or_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(RunFolderError, match="not a regular file"), atomic_write(pipe) as file:
        file.write(b"content")
    assert pipe.is_fifo() and os.listdir(tmp_path) == ["pipe"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError])
def test_an_interrupted_write_leaves_the_old_file_and_no_half_one(tmp_path, interruption) -> None:
    target = tmp_path / "file"
    target.write_bytes(b"old")
    with pytest.raises(interruption), atomic_write(target) as file:
        file.write(b"half of the n")
        file.flush()
        raise interruption
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


def test_a_full_disk_is_an_error_and_leaves_nothing(folder, standing, monkeypatch) -> None:
    (folder.path / "log.npz").unlink()

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RunFolderError, match="log.npz: no space left on device"):
        folder.write_arrays(standing)
    assert names(folder.path) == ["config.yaml", "run.json"]


def test_a_written_file_is_as_readable_as_the_umask_says(tmp_path) -> None:
    old = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "file") as file:
            file.write(b"x")
    finally:
        os.umask(old)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o640


def test_loading_missing_folders(tmp_path) -> None:
    with pytest.raises(RunFolderError, match="does not exist"):
        RunFolder.load(tmp_path / "nothing")
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="is not a folder"):
        RunFolder.load(tmp_path / "file")


def test_the_folder_above_names_its_newest_run(folder) -> None:
    with pytest.raises(RunFolderError, match=r"contains 1 run folders; the newest is .*05Z-solo12_balance"):
        RunFolder.load(folder.path.parent)


@pytest.mark.parametrize("name", ["config.yaml", "log.npz", "run.json"])
def test_a_missing_file_is_named(folder, name) -> None:
    (folder.path / name).unlink()
    with pytest.raises(RunFolderError, match=f"no {name}"):
        RunFolder.load(folder.path)


def test_a_truncated_log_is_damaged(folder) -> None:
    log = folder.path / "log.npz"
    log.write_bytes(log.read_bytes()[:-4000])
    with pytest.raises(RunFolderError, match="log.npz is damaged"):
        RunFolder.load(folder.path)


def test_a_pickle_in_the_log_is_refused(folder, tmp_path) -> None:
    log = folder.path / "log.npz"
    evil = tmp_path / "time.npy"
    with evil.open("wb") as file:
        np.lib.format.write_array(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(log, "w") as archive:
        archive.write(evil, "time.npy")
    with pytest.raises(RunFolderError, match="damaged.*allow_pickle"):
        RunFolder.load(folder.path)
    log.write_bytes(pickle.dumps({"time": 1}))
    with pytest.raises(RunFolderError, match="damaged"):
        RunFolder.load(folder.path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(schema=99), "schema 99.*update lgmpc"),
        (lambda c: c.pop("schema"), "no schema number"),
        (lambda c: c.pop("seed"), "damaged.*seed"),
        (lambda c: c["metrics"].pop("max_slip_m"), "damaged.*max_slip_m"),
        (lambda c: c.update(verdict="maybe"), "damaged.*maybe"),
    ],
)
def test_a_damaged_result_is_reported(folder, change, message) -> None:
    path = folder.path / "run.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(RunFolderError, match=message):
        RunFolder.load(folder.path)


def test_text_that_is_not_json_is_reported(folder) -> None:
    (folder.path / "run.json").write_text("{")
    with pytest.raises(RunFolderError, match="run.json is not JSON"):
        RunFolder.load(folder.path)
    (folder.path / "run.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RunFolderError, match="not UTF-8"):
        RunFolder.load(folder.path)


@pytest.mark.parametrize("frames", [[["s/1", "s/2"]], ["s/1", "s/2"]])
def test_flags_of_corners_that_are_no_numbers_and_tables_of_names_are_refused(frames: list[object]) -> None:
    flags = {"contact_frames": np.array(frames), "stance": np.array([["a", "b"]] * 3)}
    with pytest.raises(RunFolderError):
        RunLog.from_arrays(flags)
