"""The folder of a sweep: its document, one line per finished point, and run folders.

Several processes, also of several machines, may work on one folder: each point is claimed by a lock on a file, which
the operating system releases whenever the process ends.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lgmpc.config.loading import dump_config
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import RunFolderError
from lgmpc.runs import atomic_write
from lgmpc.runs.atomic import reason_of
from lgmpc.sweeps.design import Point, Sweep
from lgmpc.sweeps.results import Results
from lgmpc.sweeps.rows import Row
from lgmpc.sweeps.settings import SweepSettings

__all__ = ["DOCUMENT", "ROWS", "SUMMARY", "Claim", "SweepFolder", "read_document"]

DOCUMENT, ROWS, SUMMARY = "sweep.yaml", "results.jsonl", "summary.json"
_FOLDERS = ("claims", "logs", "scratch")
_FREE = ("logs", "time_limit_s", "memory_limit_gb", "expect")
"""Sections of the document that may differ when a sweep is resumed: results do not depend on them."""


@dataclass(frozen=True)
class Claim:
    """The exclusive right of this process to compute a point; released at the latest when the process ends."""

    file: Path
    descriptor: int

    def release(self) -> None:
        """Release the point."""
        self.file.unlink(missing_ok=True)
        os.close(self.descriptor)


@dataclass(frozen=True)
class SweepFolder:
    """The folder of a sweep.

    Attributes:
        path: the folder.
        results: the finished points.
    """

    path: Path
    results: Results

    @classmethod
    def open(cls, path: Path, sweep: Sweep, *, resume: bool) -> SweepFolder:
        """Create the folder, or open an existing one.

        Args:
            path: the folder.
            sweep: its sweep.
            resume: whether to open an existing folder.

        Raises:
            RunFolderError: if it exists and ``resume`` is false, contains another sweep, or cannot be written.
        """
        document = sweep.settings.model_dump(mode="json")
        there = path / DOCUMENT
        taken_up = there.is_file()
        if taken_up:
            _check_same(path, read_document(there), document)
            if not resume:
                hint = "add --resume to continue, or choose another folder with --out"
                raise RunFolderError(f"{path} already holds results of this sweep: {hint}")
        elif path.exists() and not _is_unfinished(path):
            raise RunFolderError(f"{path} exists and is not the folder of a sweep: choose another one with --out")
        try:
            for name in _FOLDERS:
                (path / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunFolderError(f"cannot create {path}: {reason_of(error)}. Choose another one with --out") from error
        if not taken_up:
            head = "# A sweep; `lgmpc sweep` on this file repeats it, with --out and --resume continues it.\n"
            with atomic_write(there) as file:
                file.write((head + write_yaml(document)).encode())
        return cls(path, Results(path / ROWS))

    @property
    def logs(self) -> Path:
        """Folder of the kept run folders."""
        return self.path / "logs"

    def scratch(self, key: str) -> Path:
        """Return the folder of a point's runs while it is computed."""
        return self.path / "scratch" / key

    def claim(self, key: str) -> Claim | None:
        """Reserve a point for this process; ``None`` if another one computes it or has finished it."""
        file = self.path / "claims" / key
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise RunFolderError(f"cannot write {file}: {reason_of(error)}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        claim = Claim(file, descriptor)
        if key in self.results.rows():  # finished between the reading of the results and the lock
            claim.release()
            return None
        return claim

    def keep_log(self, row: Row, most: int) -> str:
        """Move the run folder of a finished point to the kept ones, at most ``most``, and return its name.

        Failures have priority over passes, earlier points over later ones; a kept pass is removed for a failure.
        """
        scratch = self.scratch(row.key)
        folders = sorted(each for each in scratch.glob("*") if (each / "run.json").is_file())
        name = ""
        if folders and self._has_room(row, most):
            name = f"{'pass' if row.passed else 'fail'}-{row.key[:12]}"
            with suppress(OSError):  # it exists: the same point, computed again
                folders[-1].rename(self.logs / name)
        shutil.rmtree(scratch, ignore_errors=True)
        return name

    def keep_config(self, point: Point) -> None:
        """Save the config of a point that has no run folder, as ``logs/broken-<key>.yaml``, which repeats it."""
        with atomic_write(self.logs / f"broken-{point.key[:12]}.yaml") as file:
            file.write(dump_config(point.config).encode())

    def _has_room(self, row: Row, most: int) -> bool:
        kept = [each for each in self.logs.iterdir() if each.is_dir()]
        if len(kept) < most:
            return True
        passes = [each for each in kept if each.name.startswith("pass-")]
        if row.passed or not passes or most == 0:
            return False
        shutil.rmtree(min(passes), ignore_errors=True)
        return True


def _is_unfinished(path: Path) -> bool:
    """Return whether a folder is that of a sweep whose document has not been written."""
    own = (*_FOLDERS, DOCUMENT, ROWS)
    return path.is_dir() and all(each.name in own or each.name.startswith(f".{DOCUMENT}.") for each in path.iterdir())


def read_document(file: Path) -> dict[str, Any]:
    """Return the content of a document that lgmpc has written into a folder.

    Raises:
        RunFolderError: if it cannot be read, or is not a table of keys.
        ConfigError: if it is not YAML.
    """
    try:
        data, _ = parse_yaml(file.read_text(encoding="utf-8"), str(file))
    except OSError as error:
        raise RunFolderError(f"cannot read {file}: {reason_of(error)}") from error
    except UnicodeDecodeError as error:
        raise RunFolderError(f"{file} is damaged: not UTF-8 text ({error.reason})") from error
    if not isinstance(data, dict):
        raise RunFolderError(f"{file} is damaged: not a table of keys")
    return data


def _check_same(path: Path, there: dict[str, Any], wanted: dict[str, Any]) -> None:
    differing = [name for name in SweepSettings.model_fields if name not in _FREE and there.get(name) != wanted[name]]
    if differing:
        raise RunFolderError(
            f"{path} holds another sweep: {', '.join(differing)} differ"
            f" (there: name {there.get('name')}). Choose another folder with --out, or remove this one"
        )
