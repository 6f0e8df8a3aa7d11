"""Datasets of sweeps, read back by rerun's reader of LeRobot's format and by pyarrow."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.experimental import LeRobotReader

import lgmpc
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


def test_one_run_is_a_dataset_too_and_bad_folders_are_named(sweep: Path, tmp_path: Path) -> None:
    run = sorted((sweep / "logs").iterdir())[0]
    assert write_dataset(run, tmp_path / "one") == (1, 15)
    with pytest.raises(InputError, match="a folder that does not exist yet"):
        write_dataset(run, tmp_path / "one")
    assert [each.name for each in tmp_path.iterdir()] == ["one"]
