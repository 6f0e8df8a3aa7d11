"""Datasets for imitation: the kept runs of a sweep in the format of LeRobot, version 3.0, or in that of robomimic.

Each run is an episode. Observations are configuration, velocity and limited command, actions the commanded torques, by
the names of :mod:`lgmpc.runs.recorded`; the task is the name of the run's config. LeRobot's own loader and rerun's read
the folder; there are no pictures.
"""

import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.errors import InputError, RunFolderError, required
from lgmpc.runs import Run, atomic_write, load_run, versions
from lgmpc.runs.atomic import reason_of
from lgmpc.runs.recorded import columns_of
from lgmpc.typing import Array, IntArray

FPS = 50
_FEATURES = {"observation.state": ("q", "v", "command"), "action": ("tau_command",)}
_FILE = "chunk-000/file-000.parquet"
_HDF5 = (".hdf5", ".h5")


def check_dataset(target: Path) -> None:
    """Check that a dataset can be written, before its runs are computed.

    Raises:
        InputError: the target exists.
        MissingDependencyError: h5py, or for a folder pandas or pyarrow, is not installed.
    """
    for name in ("h5py",) if target.suffix in _HDF5 else ("pandas", "pyarrow.parquet"):
        required(name, "a dataset", "data")
    if target.exists():
        raise InputError("--dataset", target, "a folder, or .hdf5 file, that does not exist yet")


def write_dataset(source: Path, target: Path) -> tuple[int, int]:
    """Write the kept runs of a sweep, or one run, as a dataset at 50 frames a second.

    Args:
        source: the sweep's folder, or a run folder.
        target: a folder in LeRobot's format, or a file that ends in .hdf5 in robomimic's; it must not exist.

    Returns:
        Number of episodes and of frames.

    Raises:
        InputError: the target exists, there is no run of a closed loop, or their robots differ.
        RunFolderError: a run is damaged, or the target cannot be written.
        MissingDependencyError: a package is not installed, see :func:`check_dataset`.
    """
    check_dataset(target)
    paths = sorted(each.parent for each in (source / "logs").glob("*/run.json")) or [source]
    loaded = (load_run(path) for path in paths)
    runs = [run for run in loaded if isinstance(run, Run) and run.log.ticks]
    if not runs:
        raise InputError("--dataset", source, "a run of a closed loop, or a sweep that keeps some (its `logs`)")
    for run in runs[1:]:
        if _names(run, "q", "v", "tau_command") != _names(runs[0], "q", "v", "tau_command"):
            raise InputError("--dataset", source, f"runs of one robot: {run.path.name} has other joints")
    try:
        frames = (_write_hdf5 if target.suffix in _HDF5 else _write_lerobot)(runs, target)
    except OSError as error:
        raise RunFolderError(f"cannot write {target}: {reason_of(error)}") from error
    return len(runs), frames


def _write_hdf5(runs: Sequence[Run], file: Path) -> int:
    """Write robomimic's layout: ``data/demo_i`` with actions, rewards, dones and obs; return the number of frames.

    The reward is that of success: 1 in the last frame of a run that passed. Columns are named in the attribute
    ``names`` of each array.
    """
    total = 0
    with atomic_write(file) as opened, required("h5py", "a dataset", "data").File(opened, "w") as root:
        data = root.create_group("data")
        for number, run in enumerate(runs):
            demo, ticks = data.create_group(f"demo_{number}"), _ticks(run)
            last = np.arange(len(ticks)) == len(ticks) - 1
            columns = {f"obs/{name}": name for name in _FEATURES["observation.state"]} | {"actions": "tau_command"}
            for path, channel in columns.items():
                demo[path] = run[channel][ticks]
                demo[path].attrs["names"] = _names(run, channel)
            demo["dones"] = last.astype(np.int64)
            demo["rewards"] = (last & run.result.verdict.passed).astype(np.float64)
            demo.attrs.update(num_samples=len(ticks), task=run.result.name, run=run.path.name)
            total += len(ticks)
        environment = {"env_name": runs[0].result.name, "env_version": versions()["lgmpc"], "type": 2, "env_kwargs": {}}
        data.attrs.update(total=total, fps=FPS, env_args=json.dumps(environment))
    return total


def _write_lerobot(runs: Sequence[Run], folder: Path) -> int:
    """Write a folder in LeRobot's format; return the number of frames."""
    pandas = required("pandas", "a dataset", "data")
    tables, episodes, tasks = [], [], list(dict.fromkeys(run.result.name for run in runs))
    names = {key: _names(runs[0], *channels) for key, channels in _FEATURES.items()}
    first = 0
    for number, run in enumerate(runs):
        ticks = _ticks(run)
        frames = {key: np.column_stack([run[name][ticks] for name in each]) for key, each in _FEATURES.items()}
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
    return first


def _names(run: Run, *channels: str) -> list[str]:
    """Return the names of the columns of some channels, in their order."""
    columns = [each.name for each in columns_of(run.log, "ticks")]
    return [name for channel in channels for name in columns if name.partition(".")[0] == channel]


def _ticks(run: Run) -> IntArray:
    """Return the ticks nearest to the frames' times, up to the first that is not finite."""
    log = run.log
    elapsed = log.time[: max(log.finite_ticks, 1)] - log.time[0]
    times = np.arange(int(elapsed[-1] * FPS + 1e-6) + 1) / FPS
    return np.clip(np.searchsorted(elapsed, times - 0.5 * log.control_period_s), 0, len(elapsed) - 1)


def _statistics(values: Array) -> dict[str, list[float]]:
    found = {name: getattr(values, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return {**found, "count": [len(values)]}
