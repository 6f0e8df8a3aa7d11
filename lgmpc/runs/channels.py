"""Declarations of logged quantities, with their shapes, types and units, and files of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError

__all__ = ["ArrayFile", "Channel", "channel", "channels_of"]

F = TypeVar("F", bound="ArrayFile")

_SCALARS = {"float": "f", "bool": "b", "int": "iu", "str": "U"}
"""NumPy's kind letters for the annotations of single values."""


@dataclass(frozen=True)
class Channel:
    """Shape, type and unit of one logged quantity.

    Attributes:
        table: name of its table.
        axes: names of the axes ("nq", "nc", ...) or their fixed lengths; in tables of ticks without that of the tick.
        dtype: NumPy type of the entries.
        unit: unit of the entries; empty for numbers without one and for several.
    """

    table: str
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


def channel(
    table: str, *axes: str | int, unit: str = "", dtype: type[np.generic] = np.float64, optional: bool = False
) -> Any:
    """Declare a channel as a field of a dataclass; if it is optional, ``None`` stands for a missing one."""
    metadata = {"channel": Channel(table, axes, dtype, unit)}
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


def channels_of(kind: type, table: str) -> Mapping[str, Channel]:
    """Return the channels of a table that a dataclass declares, by name."""
    found = {each.name: each.metadata["channel"] for each in fields(kind) if "channel" in each.metadata}
    return {name: each for name, each in found.items() if each.table == table}


@dataclass(frozen=True, kw_only=True)
class ArrayFile:
    """Channels and single values that are stored in one ``.npz`` file by name; those that are None are left out."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, as stored in the file."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: np.asarray(value) for name, value in values.items() if value is not None}

    @classmethod
    def from_arrays(cls: type[F], arrays: Mapping[str, NDArray[Any]]) -> F:
        """Return the contents of a file.

        Raises:
            RunFolderError: if a channel is missing or has the wrong shape or type.
        """
        missing = [each.name for each in fields(cls) if each.default is MISSING and each.name not in arrays]
        if missing:
            raise RunFolderError(f"log lacks {', '.join(missing)}")
        values: dict[str, Any] = {}
        for each in fields(cls):
            if each.name in arrays:
                array, kinds = arrays[each.name], _SCALARS.get(str(each.type))
                if kinds and (array.shape != () or array.dtype.kind not in kinds):
                    held = f"shape {array.shape} and holds {array.dtype}"
                    raise RunFolderError(f"entry '{each.name}' has {held}, expected one value")
                values[each.name] = array.item() if kinds else array
        return cls(**values)
