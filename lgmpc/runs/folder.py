"""The run folder: ``config.yaml``, ``run.json``, and ``log.npz`` or ``trajectory.npz``, each complete or absent."""

from __future__ import annotations

import re
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError
from lgmpc.runs.atomic import atomic_write, reason_of
from lgmpc.runs.log import RunLog
from lgmpc.runs.result import RESULT_FILE, RunResult, SolveResult, kind_of
from lgmpc.runs.trajectory import TrajectoryLog

__all__ = ["CONFIG_FILE", "LOG_FILE", "TRAJECTORY_FILE", "Run", "RunFolder", "SolvedRun"]

T = TypeVar("T")

_DAMAGE = (
    ValueError,
    TypeError,
    KeyError,
    EOFError,
    RuntimeError,
    MemoryError,
    OverflowError,
    SyntaxError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)
"""What NumPy, zipfile and zlib raise for files whose headers or contents were changed."""

_OTHER_FILES = 1_000_000
"""Bytes for config, result and the arrays' headers: more than they ever take."""

CONFIG_FILE, LOG_FILE, TRAJECTORY_FILE = "config.yaml", "log.npz", "trajectory.npz"


@dataclass(frozen=True)
class Run:
    """A run folder, read.

    Attributes:
        path: the folder.
        config: text of its ``config.yaml``.
        log: its arrays.
        result: its ``run.json``.
    """

    path: Path
    config: str
    log: RunLog
    result: RunResult


@dataclass(frozen=True)
class SolvedRun:
    """The folder of a solved problem, read.

    Attributes:
        path: the folder.
        config: text of its ``config.yaml``.
        trajectory: its arrays.
        result: its ``run.json``.
    """

    path: Path
    config: str
    trajectory: TrajectoryLog
    result: SolveResult


@dataclass(frozen=True)
class RunFolder:
    """A folder that a run writes its results into."""

    path: Path

    @classmethod
    def create(cls, out: Path | str, name: str, now: datetime | None = None) -> RunFolder:
        """Make ``out/<UTC time>-<name>/`` and prove that it can be written.

        Called before a run starts, so that a folder that cannot be written is reported at once. Two runs that start in
        the same second get two folders.

        Args:
            out: parent folder, made if it does not exist.
            name: the run's name; characters that do not belong into a file name become "-".
            now: the time to put into the name; the current time if not given.

        Raises:
            RunFolderError: if it cannot be made or written, with the reason.
        """
        out = Path(out)
        stamp = (now or datetime.now(timezone.utc)).astimezone(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        slug = re.sub(r"[^A-Za-z0-9_.]+", "-", name).strip("-.") or "run"
        try:
            out.mkdir(parents=True, exist_ok=True)
            count = 1
            while True:
                path = out / (f"{stamp}-{slug}" if count == 1 else f"{stamp}-{slug}-{count}")
                try:
                    path.mkdir()
                    break
                except FileExistsError:
                    count += 1
        except FileExistsError as error:
            raise RunFolderError(
                f"{out} is a file, not a folder to make runs in. Choose another one with --out"
            ) from error
        except OSError as error:
            raise RunFolderError(
                f"cannot make a run folder in {out}: {reason_of(error)}. Choose another one with --out"
            ) from error
        return cls(path)

    def check_space(self, log_bytes: int) -> None:
        """Check that the disk has room for a run's arrays, before the run starts.

        Args:
            log_bytes: size of the arrays, an estimate.

        Raises:
            RunFolderError: if it has not.
        """
        free = shutil.disk_usage(self.path).free
        if free < log_bytes + _OTHER_FILES:
            raise RunFolderError(
                f"{self.path.parent} has {_megabytes(free)} free, and the run needs about"
                f" {_megabytes(log_bytes + _OTHER_FILES)}: make room, or choose another folder with --out"
            )

    def write_config(self, text: str) -> None:
        """Write the resolved configuration, YAML."""
        self._write(CONFIG_FILE, text)

    def write_log(self, log: RunLog) -> None:
        """Write the arrays. :class:`RunLog` holds plain numbers and strings only, so nothing in the file is pickled."""
        self._write_arrays(LOG_FILE, log.arrays())

    def write_trajectory(self, trajectory: TrajectoryLog) -> None:
        """Write the arrays of a solved problem; nothing in the file is pickled."""
        self._write_arrays(TRAJECTORY_FILE, trajectory.arrays())

    def write_result(self, result: RunResult | SolveResult) -> None:
        """Write ``run.json``: last, because a folder that has it is complete."""
        self._write(RESULT_FILE, result.to_json())

    def _write_arrays(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        with atomic_write(self.path / name) as file:
            values: dict[str, Any] = dict(arrays)
            np.savez(file, **values)

    def _write(self, name: str, text: str) -> None:
        with atomic_write(self.path / name) as file:
            file.write(text.encode("utf-8"))

    @staticmethod
    def load(path: Path | str) -> Run:
        """Read the run folder of a closed loop and check it.

        Raises:
            RunFolderError: if it is not one, or a file is missing, damaged, or of a newer schema.
        """
        path = Path(path)
        config, result = _texts(path)
        parsed = RunResult.from_json(result, str(path / RESULT_FILE))
        return Run(path, config, _read_arrays(path / LOG_FILE, RunLog.from_arrays), parsed)

    @staticmethod
    def load_solved(path: Path | str) -> SolvedRun:
        """Read the run folder of a solved problem and check it; errors as :meth:`load`."""
        path = Path(path)
        config, result = _texts(path)
        parsed = SolveResult.from_json(result, str(path / RESULT_FILE))
        return SolvedRun(path, config, _read_arrays(path / TRAJECTORY_FILE, TrajectoryLog.from_arrays), parsed)

    @staticmethod
    def load_any(path: Path | str) -> Run | SolvedRun:
        """Read a run folder of either kind and check it; errors as :meth:`load`."""
        path = Path(path)
        solved = kind_of(_texts(path)[1], str(path / RESULT_FILE)) == SolveResult.kind
        return RunFolder.load_solved(path) if solved else RunFolder.load(path)


def _texts(path: Path) -> tuple[str, str]:
    """Return the texts of config and result."""
    if not path.is_dir():
        raise RunFolderError(f"{path} is not a folder" if path.exists() else f"{path} does not exist")
    arrays = TRAJECTORY_FILE if (path / TRAJECTORY_FILE).is_file() else LOG_FILE
    missing = [name for name in (CONFIG_FILE, arrays, RESULT_FILE) if not (path / name).is_file()]
    if missing:
        raise RunFolderError(f"{path} is not a complete run folder: no {', no '.join(missing)}{_hint(path)}")
    try:
        return (path / CONFIG_FILE).read_text(encoding="utf-8"), (path / RESULT_FILE).read_text(encoding="utf-8")
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {reason_of(error)}") from error
    except UnicodeDecodeError as error:
        raise RunFolderError(f"cannot read {path}: not UTF-8 text ({error.reason})") from error


def _read_arrays(path: Path, build: Callable[[dict[str, NDArray[Any]]], T]) -> T:
    try:
        # Opened here, because np.load leaves a damaged file open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {reason_of(error)}") from error
    except _DAMAGE as error:
        raise RunFolderError(f"{path} is damaged: {type(error).__name__} {error}") from error
    try:
        return build(arrays)
    except RunFolderError as error:
        raise RunFolderError(f"{path}: {error}") from error


def _megabytes(size: int) -> str:
    return f"{1e-6 * size:.3g} MB"


def _hint(path: Path) -> str:
    """If ``path`` holds run folders instead of being one, name the newest."""
    runs = sorted(child.name for child in path.iterdir() if (child / RESULT_FILE).is_file())
    return f". It holds {len(runs)} run folders; the newest is {path / runs[-1]}" if runs else ""
