"""The results of a sweep: one line of JSON per finished point, in an append-only file."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from lgmpc.errors import RunFolderError
from lgmpc.runs.atomic import reason_of
from lgmpc.sweeps.rows import Row

__all__ = ["Results"]


class Results:
    """The file; several processes may append to it.

    Args:
        file: file, created with the first row.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._read = self._lines = 0
        self._rows: dict[str, Row] = {}

    def rows(self) -> dict[str, Row]:
        """Return the finished points by their keys; reads only what was added since the last call.

        An incomplete last line is ignored: another process is writing it, or was killed while writing it.

        Raises:
            RunFolderError: if the file cannot be read or a line in it is not a row.
        """
        try:
            with self._file.open("rb") as file:
                file.seek(self._read)
                added = file.read()
        except FileNotFoundError:
            return self._rows
        except OSError as error:
            raise RunFolderError(f"cannot read {self._file}: {reason_of(error)}") from error
        whole = added[: added.rfind(b"\n") + 1]
        lines = whole.splitlines()
        for number, line in enumerate(lines, self._lines + 1):
            row = Row.from_json(line, f"{self._file}:{number}")
            self._rows[row.key] = row
        self._lines += len(lines)
        self._read += len(whole)
        return self._rows

    def append(self, row: Row) -> None:
        """Save a finished point: its line is on the disk when this returns.

        Raises:
            RunFolderError: if it cannot be written; the file is then unchanged.
        """
        try:
            descriptor = os.open(self._file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                _cut_torn_line(descriptor)
                data = f"{row.to_json()}\n".encode()
                if os.write(descriptor, data) < len(data):
                    _cut_torn_line(descriptor)
                    raise RunFolderError(f"cannot write {self._file}: the disk is full. Free some space, then --resume")
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        except OSError as error:
            reason = reason_of(error)
            raise RunFolderError(f"cannot write {self._file}: {reason}. --resume continues from here") from error


def _cut_torn_line(descriptor: int) -> None:
    """Remove an incomplete last line, left by a killed process or a full disk."""
    size = os.lseek(descriptor, 0, os.SEEK_END)
    end = size
    while end > 0:
        start = max(0, end - 4096)
        at = os.pread(descriptor, end - start, start).rfind(b"\n")
        if at >= 0:
            end = start + at + 1
            break
        end = start
    if end < size:
        os.ftruncate(descriptor, end)
