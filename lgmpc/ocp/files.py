"""Files of arrays (npz, without pickle) that name what they contain."""

from __future__ import annotations

import os
import secrets
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError
from lgmpc.typing import instance

__all__ = ["read_arrays", "write_arrays"]

_SCHEMA = "schema"


def write_arrays(path: str | Path, schema: str, arrays: Mapping[str, Any]) -> Path:
    """Write a file of arrays, complete or not at all.

    Args:
        path: of the file.
        schema: kind of content, with its version.
        arrays: by name.

    Returns:
        The path.

    Raises:
        InputError: it cannot be written.
    """
    instance("path", path, (str, os.PathLike), "a path")
    path = Path(path)
    partial = path.parent / f".{path.name}-{secrets.token_hex(4)}"
    try:
        try:
            with open(partial, "xb") as file:
                np.savez(file, **{_SCHEMA: np.array(schema), **arrays})
            os.replace(partial, path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError("path", f"'{path}', which cannot be written ({error})", "a file that can be") from error
    return path


def read_arrays(path: str | Path, schema: str, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file.

    Raises:
        InputError: it cannot be read, contains something else, or lacks an array.
    """
    instance("path", path, (str, os.PathLike), "a path")
    expected = f"a file with '{schema}'"
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise InputError("path", f"'{path}', which cannot be read ({error})", expected) from error
    kind = str(found.get(_SCHEMA, "nothing that names its content"))
    if kind != schema:
        raise InputError("path", f"'{path}' with '{kind}'", expected)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError("path", f"'{path}' without {', '.join(missing)}", expected)
    return found
