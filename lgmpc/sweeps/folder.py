"""The folder of a sweep: its document, one line per finished point, and run folders."""

import errno
import fcntl
import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from lgmpc.config.loading import dump_config
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import RunFolderError
from lgmpc.runs import atomic_write
from lgmpc.runs.atomic import reason_of
from lgmpc.sweeps.design import Point, Sweep
from lgmpc.sweeps.rows import Row

DOCUMENT, ROWS, SUMMARY = "sweep.yaml", "results.jsonl", "summary.json"
_HEAD = "# A sweep; `lgmpc sweep` on this file repeats it, with --out and --resume continues it.\n"
_FREE = ("logs", "time_limit_s", "memory_limit_gb", "expect")
"""Sections of the document that may differ when a sweep is resumed: results do not depend on them."""


def _prepare(path: Path, sweep: Sweep, *, resume: bool) -> None:
    """Create the folder of a sweep with its document, or check that an existing one has the same.

    Raises:
        RunFolderError: if it exists and ``resume`` is false, contains something else, or cannot be written.
    """
    file, text = path / DOCUMENT, write_yaml(sweep.settings.model_dump(mode="json"))
    continued = file.is_file()
    if continued:
        there, wanted = read_document(file), parse_yaml(text, DOCUMENT)[0]
        differing = [key for key in wanted if key not in _FREE and there.get(key) != wanted[key]]
        if differing:
            hint = "Choose another folder with --out, or remove this one"
            raise RunFolderError(f"{path} holds another sweep: {', '.join(differing)} differ. {hint}")
        if not resume:
            hint = "add --resume to continue, or choose another folder with --out"
            raise RunFolderError(f"{path} already holds results of this sweep: {hint}")
    # A temporary file of the document may be there, of a process that was killed while it wrote it.
    elif path.exists() and not (path.is_dir() and all(e.name.startswith(f".{DOCUMENT}.") for e in path.iterdir())):
        raise RunFolderError(f"{path} exists and is not the folder of a sweep: choose another one with --out")
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not continued:
            with atomic_write(file) as stream:
                stream.write((_HEAD + text).encode())
        for inside in ("logs", "scratch"):
            (path / inside).mkdir(exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot create {path}: {reason_of(error)}. Choose another one with --out") from error


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


def read_rows(file: Path) -> dict[str, Row]:
    """Return the finished points in a file, by their keys.

    An incomplete last line is ignored: another process is writing it, or was killed while writing it.

    Raises:
        RunFolderError: if the file cannot be read or a line in it is not a row.
    """
    try:
        content = file.read_bytes()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise RunFolderError(f"cannot read {file}: {reason_of(error)}") from error
    lines = content[: content.rfind(b"\n") + 1].splitlines()
    rows = (Row.from_json(line, f"{file}:{number}") for number, line in enumerate(lines, 1))
    return {row.key: row for row in rows}


@dataclass(frozen=True)
class SweepFolder:
    """The folder of a sweep, which one process at a time works on.

    Attributes:
        path: the folder.
        rows: the finished points by their keys.
        file: file of the finished points, one line of JSON each; locked until this process ends or closes it.
    """

    path: Path
    rows: dict[str, Row]
    file: FileIO

    @classmethod
    def open(cls, path: Path, sweep: Sweep, *, resume: bool) -> "SweepFolder":
        """Create the folder, or open an existing one.

        Args:
            path: the folder.
            sweep: the sweep.
            resume: whether to continue in an existing folder.

        Raises:
            RunFolderError: it exists and ``resume`` is false, contains something else, or cannot be written.
        """
        _prepare(path, sweep, resume=resume)
        try:
            file = (path / ROWS).open("ab+", buffering=0)
        except OSError as error:
            raise RunFolderError(f"cannot write {path / ROWS}: {reason_of(error)}") from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.close()
            raise RunFolderError(f"another process works on {path}: wait for it, or choose another --out") from error
        rows = read_rows(path / ROWS)  # raises before anything is written
        file.truncate((path / ROWS).read_bytes().rfind(b"\n") + 1)  # a killed process left an incomplete last line
        return cls(path, rows, file)

    def close(self) -> None:
        """Remove what is unfinished, and unlock the folder."""
        shutil.rmtree(self.path / "scratch", ignore_errors=True)
        self.file.close()

    @property
    def logs(self) -> Path:
        """Folder of the kept run folders."""
        return self.path / "logs"

    def scratch(self, key: str) -> Path:
        """Return the folder of a point's runs while it is computed."""
        return self.path / "scratch" / key

    def append(self, row: Row) -> None:
        """Save a finished point: its line is on the disk when this returns.

        Raises:
            RunFolderError: if it cannot be written; the file is then unchanged.
        """
        data, end = f"{row.to_json()}\n".encode(), self.file.seek(0, os.SEEK_END)
        try:
            if self.file.write(data) < len(data):
                raise OSError(errno.ENOSPC, "the disk is full")
            os.fsync(self.file.fileno())
        except OSError as error:
            self.file.truncate(end)
            words = f"cannot write {self.path / ROWS}: {reason_of(error)}. --resume continues from here"
            raise RunFolderError(words) from error
        self.rows[row.key] = row

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
