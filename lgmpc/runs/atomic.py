"""Files: atomic writing, the reason of a failure, values in the form of JSON."""

import contextlib
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, BinaryIO

from pydantic import BeforeValidator

from lgmpc.errors import RunFolderError

Number = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]
"""A number read from JSON, where those that are not finite are null."""


def reason_of(error: OSError) -> str:
    """Return the operating system's reason in words, without the errno and the path."""
    return (error.strerror or str(error)).lower()


def json_values(value: Any) -> Any:
    """Return a value, table or list in the form of JSON, where NaN and infinity, which it lacks, are null."""
    if isinstance(value, Mapping):
        return {str(key): json_values(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(each) for each in value]
    if isinstance(value, Enum):
        return value.value
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file in the folder of ``path``, renamed to it when the block ends without an exception.

    Readers see the old file or the complete new one; after an exception or an interrupt the old file is unchanged and
    the temporary one is removed.

    Args:
        path: the file to write; its folder must exist.

    Yields:
        The open binary file.

    Raises:
        RunFolderError: if the folder cannot be written, the disk is full, or the path is not that of a regular file.
    """
    path = Path(path)
    if path.exists() and not path.is_file():  # a device or a pipe would be replaced by a file
        raise RunFolderError(f"cannot write {path}: {'is a directory' if path.is_dir() else 'not a regular file'}")
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {reason_of(error)}") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        # mkstemp creates private files (0600); results have the permissions of the user's umask.
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
