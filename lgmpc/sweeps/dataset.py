"""Datasets for imitation: the kept runs of a sweep in the format of LeRobot, version 3.0.

Each run is an episode. ``observation.state`` has configuration, velocity and limited command, ``action`` the commanded
torques, by the names of :mod:`lgmpc.runs.recorded`; the task is the name of the run's config. LeRobot's own loader and
rerun's read the folder; there are no pictures.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.errors import InputError, RunFolderError, required
from lgmpc.runs import Run, load_run
from lgmpc.runs.atomic import reason_of
from lgmpc.runs.recorded import columns_of
from lgmpc.typing import Array

__all__ = ["write_dataset"]

FPS = 50
_FEATURES = {"observation.state": ("q", "v", "command"), "action": ("tau_command",)}
_FILE = "chunk-000/file-000.parquet"


def write_dataset(source: Path, folder: Path) -> tuple[int, int]:
    """Write the kept runs of a sweep, or one run, as a dataset at 50 frames a second.

    Args:
        source: the sweep's folder, or a run folder.
        folder: the dataset, which must not exist.

    Returns:
        Number of episodes and of frames.

    Raises:
        InputError: the folder exists, there is no run of a closed loop, or their robots differ.
        RunFolderError: a run is damaged, or the folder cannot be written.
        MissingDependencyError: pandas or pyarrow is not installed.
    """
    pandas, _ = (required(name, "a dataset", "data") for name in ("pandas", "pyarrow.parquet"))
    if folder.exists():
        raise InputError("--dataset", folder, "a folder that does not exist yet")
    paths = sorted(each.parent for each in (source / "logs").glob("*/run.json")) or [source]
    loaded = (load_run(path) for path in paths)
    runs = [run for run in loaded if isinstance(run, Run) and run.log.ticks]
    if not runs:
        raise InputError("--dataset", source, "a run of a closed loop, or a sweep that keeps some (its `logs`)")
    names, tables, episodes, tasks = _names(runs[0]), [], [], list(dict.fromkeys(run.result.name for run in runs))
    first = 0
    for number, run in enumerate(runs):
        if _names(run) != names:
            raise InputError("--dataset", source, f"runs of one robot: {run.path.name} has other joints")
        frames = _frames(run)
        count = len(frames["action"])
        table: dict[str, Any] = {key: list(values.astype(np.float32)) for key, values in frames.items()}
        frame = np.arange(count)
        table |= {
            "timestamp": (frame / FPS).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.full(count, number),
            "index": first + frame,
            "task_index": np.full(count, tasks.index(run.result.name)),
        }
        tables.append(pandas.DataFrame(table))
        episodes.append(
            {
                "episode_index": number,
                "tasks": [run.result.name],
                "length": count,
                "data/chunk_index": 0,
                "data/file_index": 0,
                "dataset_from_index": first,
                "dataset_to_index": first + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                "run": run.path.name,
                "verdict": run.result.verdict.outcome.value,
                **{f"stats/{key}/{k}": v for key, each in frames.items() for k, v in _statistics(each).items()},
            }
        )
        first += count
    data = pandas.concat(tables, ignore_index=True)
    wholes = {key: np.stack(data[key].to_list()) for key in _FEATURES}
    features: dict[str, Any] = {
        key: {"dtype": "float32", "shape": [len(each)], "names": each} for key, each in names.items()
    }
    kinds = {"timestamp": "float32"} | dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")
    features |= {key: {"dtype": kind, "shape": [1], "names": None} for key, kind in kinds.items()}
    info = {
        "codebase_version": "v3.0",
        "robot_type": tasks[0],
        "total_episodes": len(runs),
        "total_frames": first,
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": f"0:{len(runs)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    try:
        with tempfile.TemporaryDirectory(prefix=".dataset.", dir=folder.parent) as draft:
            meta = Path(draft, "dataset", "meta")
            for part in ("episodes/chunk-000", "../data/chunk-000"):
                (meta / part).mkdir(parents=True)
            data.to_parquet(meta / "../data" / _FILE, index=False)
            pandas.DataFrame(episodes).to_parquet(meta / "episodes" / _FILE, index=False)
            pandas.DataFrame({"task_index": range(len(tasks))}, index=tasks).to_parquet(meta / "tasks.parquet")
            (meta / "info.json").write_text(json.dumps(info, indent=2), encoding="utf-8")
            statistics = {key: _statistics(each) for key, each in wholes.items()}
            (meta / "stats.json").write_text(json.dumps(statistics, indent=2), encoding="utf-8")
            shutil.move(Path(draft, "dataset"), folder)
    except OSError as error:
        raise RunFolderError(f"cannot write {folder}: {reason_of(error)}") from error
    return len(runs), first


def _names(run: Run) -> dict[str, list[str]]:
    columns = [each.name for each in columns_of(run.log, "ticks")]
    return {
        key: [name for channel in channels for name in columns if name.partition(".")[0] == channel]
        for key, channels in _FEATURES.items()
    }


def _frames(run: Run) -> dict[str, Array]:
    """Return the features of a run at the ticks nearest to the frames' times, up to the first that is not finite."""
    log = run.log
    elapsed = log.time[: max(log.finite_ticks, 1)] - log.time[0]
    times = np.arange(int(elapsed[-1] * FPS + 1e-6) + 1) / FPS
    ticks = np.clip(np.searchsorted(elapsed, times - 0.5 * log.control_period_s), 0, len(elapsed) - 1)
    return {key: np.column_stack([run[name][ticks] for name in each]) for key, each in _FEATURES.items()}


def _statistics(values: Array) -> dict[str, list[float]]:
    found = {name: getattr(values, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return {**found, "count": [len(values)]}
