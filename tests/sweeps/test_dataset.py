"""Datasets of sweeps, read back by rerun's reader of LeRobot's format and by pyarrow."""

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.experimental import LeRobotReader
from typer.testing import CliRunner

import lgmpc
from lgmpc.cli.app import app
from lgmpc.errors import InputError
from lgmpc.runs import Run
from lgmpc.sweeps.dataset import write_dataset


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    for speed, duration in ((0.2, 0.3), (0.4, 0.25)):
        changes = ["pushes=[]", f"duration_s={duration}", f"commands=[{{at_s: 0, velocity_m_s: [{speed}, 0, 0]}}]"]
        lgmpc.run_config(lgmpc.load_config("solo12_velocity", changes), folder / "logs")
    return folder


def test_a_dataset_has_an_episode_for_each_kept_run(sweep: Path, tmp_path: Path) -> None:
    assert write_dataset(sweep, tmp_path / "walks") == (2, 15 + 13)
    info = json.loads((tmp_path / "walks" / "meta" / "info.json").read_text(encoding="utf-8"))
    data = pq.read_table(tmp_path / "walks" / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    assert set(info["features"]) == set(data) and info["total_frames"] == len(data["index"]) == data["index"][-1] + 1
    paths = sorted((sweep / "logs").iterdir())
    for episode, path in enumerate(paths):
        run = lgmpc.load_run(path)
        assert isinstance(run, Run)
        rows = [i for i, number in enumerate(data["episode_index"]) if number == episode]
        ticks = 10 * np.arange(len(rows))  # of 500 Hz
        assert np.allclose([data["timestamp"][i] for i in rows], run["time"][ticks], atol=1e-6)
        assert np.array_equal([data["action"][i] for i in rows], run["tau_command"][ticks].astype(np.float32))
        state = np.column_stack([run[name] for name in ("q", "v", "command")])[ticks].astype(np.float32)
        assert np.array_equal([data["observation.state"][i] for i in rows], state)
    assert info["features"]["action"]["names"][:2] == ["tau_command.FL_HAA", "tau_command.FL_HFE"]
    stats = json.loads((tmp_path / "walks" / "meta" / "stats.json").read_text(encoding="utf-8"))
    assert np.allclose(stats["action"]["mean"], np.mean(data["action"], axis=0), atol=1e-6)


def test_another_reader_of_the_format_reads_it(sweep: Path, tmp_path: Path) -> None:
    write_dataset(sweep, tmp_path / "walks")
    reader = LeRobotReader(tmp_path / "walks")
    assert reader.version == "v3" and reader.episodes() == [0, 1]
    for episode, frames in enumerate((15, 13)):
        chunks = [chunk for chunk in reader.stream(episode) if not chunk.is_static]
        paths = {chunk.entity_path: chunk.num_rows for chunk in chunks}
        assert paths == dict.fromkeys(("/observation.state", "/action", "/task"), frames)
        tasks = next(chunk.to_record_batch() for chunk in chunks if chunk.entity_path == "/task").to_pydict()
        assert any("solo12_velocity" in str(column) for column in tasks.values())


def test_hdf5_has_the_layout_that_robomimic_reads(sweep: Path, tmp_path: Path) -> None:
    """Keys, shapes and attributes of its ``SequenceDataset``."""
    assert write_dataset(sweep, tmp_path / "walks.hdf5") == (2, 15 + 13)
    paths = sorted((sweep / "logs").iterdir())
    with h5py.File(tmp_path / "walks.hdf5") as file:
        data = file["data"]
        assert list(data) == ["demo_0", "demo_1"] and data.attrs["total"] == 28 and data.attrs["fps"] == 50
        assert json.loads(data.attrs["env_args"])["env_name"] == "solo12_velocity"
        for demo, path, count in zip(data.values(), paths, (15, 13), strict=True):
            run = lgmpc.load_run(path)
            assert isinstance(run, Run) and demo.attrs["num_samples"] == count and demo.attrs["run"] == path.name
            ticks = 10 * np.arange(count)  # of 500 Hz
            for name, channel in {
                "actions": "tau_command",
                "obs/q": "q",
                "obs/v": "v",
                "obs/command": "command",
            }.items():
                np.testing.assert_array_equal(demo[name], run[channel][ticks])
                assert len(demo[name].attrs["names"]) == demo[name].shape[1]
            assert demo["actions"].attrs["names"][0] == "tau_command.FL_HAA"
            assert list(demo["dones"]) == [0] * (count - 1) + [1]
            assert sum(demo["rewards"]) == demo["rewards"][-1] == float(run.result.verdict.passed)


def test_a_sweep_writes_its_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    study = tmp_path / "two.yaml"
    study.write_text(
        "name: two\nbase: solo12_velocity\nset: {duration_s: 0.1, pushes: [], gate: {}}\n"
        "factors: [{kind: values, key: seed, values: [1, 2]}]\n",
        encoding="utf-8",
    )
    given = ["sweep", str(study), "--out", str(tmp_path / "out"), "--workers", "1", "--quiet", "--dataset"]
    first, again = (CliRunner().invoke(app, [*given, str(tmp_path / "two.hdf5")]) for _ in range(2))
    assert first.exit_code == 0 and "2 episodes, 10 frames" in first.output
    assert again.exit_code == 2 and "two.hdf5" in again.output and "does not exist yet" in again.output


def test_one_run_is_a_dataset_too_and_bad_folders_are_named(sweep: Path, tmp_path: Path) -> None:
    run = sorted((sweep / "logs").iterdir())[0]
    assert write_dataset(run, tmp_path / "one") == (1, 15)
    with pytest.raises(InputError, match="that does not exist yet"):
        write_dataset(run, tmp_path / "one")
    assert [each.name for each in tmp_path.iterdir()] == ["one"]
