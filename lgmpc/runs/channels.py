"""Declarations of logged quantities, tables of channels with their shapes, types and units, and their checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError

__all__ = ["Channel", "Table", "single"]


@dataclass(frozen=True)
class Channel:
    """Shape, type and unit of one logged quantity.

    Attributes:
        axes: names of the axes ("nq", "nc", ...) or their fixed lengths; in tables of ticks without that of the tick.
        dtype: NumPy type of the entries.
        unit: unit of the entries; empty for numbers without one and for several.
    """

    axes: tuple[str | int, ...] = ()
    dtype: type[np.generic] = np.float64
    unit: str = ""

    def check(self, name: str, array: NDArray[Any], sizes: dict[str, int], *first: str) -> None:
        """Check shape and type of an array, and make it read-only.

        Args:
            name: name of the array.
            array: the array.
            sizes: lengths of the axes by name; those not yet known are added.
            first: axes before those of the channel.

        Raises:
            RunFolderError: it has another number of axes, another length of one, or another type.
        """
        axes = (*first, *self.axes)
        if array.ndim != len(axes):
            raise RunFolderError(f"'{name}' has {array.ndim} axes, expected {len(axes)}")
        lengths = zip(axes, array.shape, strict=True)
        wanted = tuple(axis if isinstance(axis, int) else sizes.setdefault(axis, size) for axis, size in lengths)
        if array.shape != wanted:
            raise RunFolderError(f"'{name}' has shape {array.shape}, expected {wanted}")
        if array.dtype != self.dtype and not array.dtype.kind == np.dtype(self.dtype).kind == "U":
            raise RunFolderError(f"'{name}' holds {array.dtype}, expected {np.dtype(self.dtype)}")
        array.setflags(write=False)


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
    """A table of channels: its call declares one of them as a field of a dataclass.

    Args:
        name: name of the table.
        optional: whether its channels may be lacking, which are ``None`` then.
    """

    def __init__(self, name: str, *, optional: bool = False) -> None:
        self._name, self._optional = name, optional

    def __call__(self, *axes: str | int, unit: str = "", dtype: type[np.generic] = np.float64) -> Any:
        """Return the field; arguments as in :class:`Channel`."""
        metadata = {self._name: Channel(axes, dtype, unit)}
        return field(default=None, metadata=metadata) if self._optional else field(metadata=metadata)

    def of(self, kind: type) -> Mapping[str, Channel]:
        """Return the channels of this table that a dataclass declares, by name."""
        return {each.name: each.metadata[self._name] for each in fields(kind) if self._name in each.metadata}
