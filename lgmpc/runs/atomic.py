"""Files that are either complete or not there."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from lgmpc.errors import RunFolderError

__all__ = ["atomic_write", "reason_of"]


def reason_of(error: OSError) -> str:
    """Return why the operating system refused, in words, without the errno and the repeated path."""
    return (error.strerror or str(error)).lower()


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside ``path`` that takes its name only when the block ends without an exception.

    A reader therefore sees the old file, or the new one, never a part of it; an exception or an interrupt leaves the
    old file as it was and no temporary one behind.

    Args:
        path: the file to write; its folder must exist.

    Yields:
        The open binary file.

    Raises:
        RunFolderError: if the folder cannot be written or the disk is full.
    """
    path = Path(path)
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {reason_of(error)}") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        # mkstemp made it private (0600); a result file is as readable as the user's umask would have made it.
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {reason_of(error)}") from error
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
