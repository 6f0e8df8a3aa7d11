"""Declarations of logged quantities: tables of channels with their shapes, types and units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError

__all__ = ["Channel", "Table", "single"]


@dataclass(frozen=True)
class Channel:
    """Shape, type and unit of one logged quantity; the first axis is the tick.

    Attributes:
        axes: names of the axes after the tick ("nq", "nc", ...) or their fixed lengths.
        dtype: NumPy type of the entries.
        unit: unit of the entries; empty for numbers without one and for several.
    """

    axes: tuple[str | int, ...] = ()
    dtype: type[np.generic] = np.float64
    unit: str = ""


def single(name: str, array: NDArray[Any], kinds: str) -> Any:
    """Return the single value of an entry of a log file.

    Args:
        name: name of the entry.
        array: the entry.
        kinds: NumPy's kind letters of the allowed types.

    Raises:
        RunFolderError: the entry has several values, or another type.
    """
    if array.shape != () or array.dtype.kind not in kinds:
        raise RunFolderError(f"entry '{name}' has shape {array.shape} and holds {array.dtype}, expected one value")
    return array.item()


class Table:
    """A table of channels: its call declares one of them as a field of :class:`RunLog`.

    Args:
        name: name of the table.
        optional: whether some runs lack its channels, which are ``None`` then.
    """

    def __init__(self, name: str, *, optional: bool = False) -> None:
        self._name, self._optional = name, optional

    def __call__(self, *axes: str | int, unit: str = "", dtype: type[np.generic] = np.float64) -> Any:
        """Return the field; arguments as in :class:`Channel`."""
        metadata = {self._name: Channel(axes, dtype, unit)}
        return field(default=None, metadata=metadata) if self._optional else field(metadata=metadata)
