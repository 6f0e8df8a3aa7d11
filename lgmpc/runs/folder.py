"""The run folder: ``config.yaml``, ``run.json``, and ``log.npz`` or ``trajectory.npz``, each complete or absent.

A run of a robot also has ``deployment.json``.
"""

import re
import shutil
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lgmpc.errors import RunFolderError, nearest
from lgmpc.runs.atomic import atomic_write, reason_of
from lgmpc.runs.log import RunLog
from lgmpc.runs.recorded import Recorded
from lgmpc.runs.result import RESULT_FILE, RunResult, SolveResult, kind_of
from lgmpc.runs.trajectory import TrajectoryLog
from lgmpc.typing import typed

A = TypeVar("A", RunLog, TrajectoryLog)
R = TypeVar("R", RunResult, SolveResult)

_OTHER_FILES = 1_000_000
"""Upper bound of the size of config, result and the arrays' headers, B."""

CONFIG_FILE, LOG_FILE, TRAJECTORY_FILE = "config.yaml", "log.npz", "trajectory.npz"
DEPLOYMENT_FILE = "deployment.json"
"""Figures of the link and of the loop's timing, in the folder of a run of a robot."""


@dataclass(frozen=True)
class Run(Recorded[RunLog, RunResult]):
    """A closed loop's run folder; ``run["tau"]`` is a channel of its ``log``."""


@dataclass(frozen=True)
class SolvedRun(Recorded[TrajectoryLog, SolveResult]):
    """A solved problem's run folder; ``run["xs"]`` is a channel of its ``log``, the trajectory."""


@dataclass(frozen=True)
class RunFolder:
    """The folder of a run's results."""

    path: Path

    @classmethod
    def create(cls, out: Path | str, name: str, now: datetime | None = None) -> "RunFolder":
        """Create ``out/<UTC time>-<name>/`` and check that it can be written.

        Called before a run starts, so that an unwritable folder is reported at once. Two runs that start in the same
        second have different folders.

        Args:
            out: parent folder, created if it does not exist.
            name: the run's name; characters that are not allowed in a file name become "-".
            now: the time in the name; the current time unless given.

        Raises:
            RunFolderError: if it cannot be created or written, with the reason.
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
            raise RunFolderError(f"{out} is a file, not a folder for runs: choose another one with --out") from error
        except OSError as error:
            raise RunFolderError(
                f"cannot create a run folder in {out}: {reason_of(error)}; choose another one with --out"
            ) from error
        return cls(path)

    def check_space(self, log_bytes: int) -> None:
        """Check, before a run starts, that the disk has space for its arrays.

        Args:
            log_bytes: size of the arrays, an estimate.

        Raises:
            RunFolderError: if it has too little.
        """
        free = shutil.disk_usage(self.path).free
        if free < log_bytes + _OTHER_FILES:
            raise RunFolderError(
                f"{self.path.parent} has {_megabytes(free)} free, and the run requires about"
                f" {_megabytes(log_bytes + _OTHER_FILES)}: free some space, or choose another folder with --out"
            )

    def write_config(self, text: str) -> None:
        """Write the resolved configuration, YAML."""
        self._write(CONFIG_FILE, text)

    def write_arrays(self, arrays: RunLog | TrajectoryLog) -> None:
        """Write the arrays of a closed loop or of a solved problem: numbers and strings only, nothing is pickled."""
        values: dict[str, Any] = arrays.arrays()
        with atomic_write(self.path / (LOG_FILE if isinstance(arrays, RunLog) else TRAJECTORY_FILE)) as file:
            np.savez(file, **values)

    def write_result(self, result: RunResult | SolveResult) -> None:
        """Write ``run.json``: last, because a folder that has it is complete."""
        self._write(RESULT_FILE, result.to_json())

    def _write(self, name: str, text: str) -> None:
        with atomic_write(self.path / name) as file:
            file.write(text.encode("utf-8"))

    @staticmethod
    def load(path: Path | str) -> Run:
        """Return the checked contents of a closed loop's run folder.

        Raises:
            RunFolderError: if it is not a run folder, or a file is missing, damaged, or of a newer schema.
        """
        path = Path(path)
        return Run(path, *_read(path, RunLog, RunResult))


def find_run(text: str, runs: str | Path = "runs") -> Path:
    """Return a run folder.

    Args:
        text: a path, the name of a folder in ``runs``, or ``latest``.
        runs: folder of run folders.

    Raises:
        RunFolderError: if there is none; names the nearest.
    """
    runs = Path(runs)
    finished = sorted(file.parent for file in runs.glob(f"*/{RESULT_FILE}"))
    if text != "latest":
        for path in (Path(text), runs / text):
            if path.is_dir():
                return path
        near = nearest(text, [path.name for path in finished])
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise RunFolderError(f"no run folder {text}, neither here nor in {runs}/.{hint}")
    if not finished:
        raise RunFolderError(f"no finished run in {runs}/ yet. Make one: lgmpc run solo12_balance")
    return max(finished, key=lambda path: ((path / RESULT_FILE).stat().st_mtime_ns, path.name))


@typed
def load_run(run: str | Path, runs: str | Path = "runs") -> Run | SolvedRun:
    """Return the checked contents of a run folder: of a closed loop with its log, or of a solved problem.

    ``run["contact_forces"]`` is the array of a channel; ``run.channels`` has shape, unit, frame and meaning of those
    that the run has; ``run.to_pandas()`` and ``run.to_csv(file)`` are tables of them.

    Args:
        run: the folder; as text also its name in ``runs``, or ``latest``.
        runs: folder of run folders.

    Raises:
        RunFolderError: if it is not a run folder, or a file is missing, damaged, or of a newer schema.
    """
    path = find_run(run, runs) if isinstance(run, str) else run
    solved = kind_of(_texts(path)[1], str(path / RESULT_FILE)) == SolveResult.kind
    return SolvedRun(path, *_read(path, TrajectoryLog, SolveResult)) if solved else RunFolder.load(path)


def _read(path: Path, arrays: type[A], result: type[R]) -> tuple[str, A, R]:
    """Return config, arrays and result of a folder."""
    config, text = _texts(path)
    parsed = result.from_json(text, str(path / RESULT_FILE))
    return config, _read_arrays(path / (TRAJECTORY_FILE if arrays is TrajectoryLog else LOG_FILE), arrays), parsed


def _texts(path: Path) -> tuple[str, str]:
    """Return the texts of config and result."""
    if not path.is_dir():
        raise RunFolderError(f"{path} is not a folder" if path.exists() else f"{path} does not exist")
    arrays = TRAJECTORY_FILE if (path / TRAJECTORY_FILE).is_file() else LOG_FILE
    missing = [name for name in (CONFIG_FILE, arrays, RESULT_FILE) if not (path / name).is_file()]
    if missing:
        runs = sorted(child.name for child in path.iterdir() if (child / RESULT_FILE).is_file())
        hint = f". It contains {len(runs)} run folders; the newest is {path / runs[-1]}" if runs else ""
        raise RunFolderError(f"{path} is not a complete run folder: no {', no '.join(missing)}{hint}")
    return _text(path / CONFIG_FILE), _text(path / RESULT_FILE)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise RunFolderError(f"cannot read {file.parent}: {reason_of(error)}") from error
    except UnicodeDecodeError as error:
        raise RunFolderError(f"cannot read {file.parent}: not UTF-8 text ({error.reason})") from error


def _read_arrays(path: Path, kind: type[A]) -> A:
    try:
        # Opened here, because np.load does not close a damaged file.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {reason_of(error)}") from error
    except Exception as error:  # NumPy, zipfile and zlib raise many kinds for changed headers and contents
        raise RunFolderError(f"{path} is damaged: {type(error).__name__} {error}") from error
    try:
        return kind.from_arrays(arrays)
    except RunFolderError as error:
        raise RunFolderError(f"{path}: {error}") from error


def _megabytes(size: int) -> str:
    return f"{1e-6 * size:.3g} MB"
