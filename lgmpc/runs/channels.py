"""Declarations of logged quantities, with meaning, shape, type, unit and frame, and files of them.

Each is declared once, as a field of its log. Docstrings, the guide's table (:func:`channel_rows`) and every export
read these declarations.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import RunFolderError

F = TypeVar("F", bound="ArrayFile")
C = TypeVar("C", bound=type)

_ENTRIES = {3: "x y z", 6: "x y z rx ry rz", 7: "x y z qx qy qz qw"}
"""Names of the entries along axes of these lengths: vectors; pairs of them, linear first; poses."""

_SCALARS = {"float": "f", "bool": "b", "int": "iu", "str": "U"}
"""NumPy's kind letters for the annotations of single values."""


@dataclass(frozen=True)
class Channel:
    """One logged quantity.

    Attributes:
        table: name of its table.
        about: its meaning.
        axes: names of the axes ("nq", "nc", ...) or their fixed lengths; in tables of ticks without that of the tick.
        dtype: NumPy type of the entries.
        unit: unit of the entries; of several one for each entry along the last axis, the last of them repeated, 1 for
            none. Empty for numbers without one.
        frame: axes in which it is expressed; empty for numbers that have none.
    """

    table: str
    about: str
    axes: tuple[str | int, ...] = ()
    dtype: type[np.generic] = np.float64
    unit: str = ""
    frame: str = ""

    @property
    def units(self) -> str:
        """The different units, with commas between them."""
        return ", ".join(dict.fromkeys(self.unit.split()))

    def entries(
        self, axes: Sequence[str | int], shape: Sequence[int], names: Mapping[str, Sequence[str]]
    ) -> Iterator[tuple[str, str]]:
        """Yield name and unit of each entry of one value, in order of the flattened array; a scalar has no name.

        Args:
            axes: of the value.
            shape: of the value.
            names: of the entries along named axes; those along others are numbered.
        """
        labels = []
        for axis, size in zip(axes, shape, strict=True):
            known = names.get(axis, ()) if isinstance(axis, str) else _ENTRIES.get(size, "").split()
            labels.append(known if len(known) == size else list(map(str, range(size))))
        units = self.unit.split() or [""]
        if shape and axes[-1] in ("nq", "nv") and labels[-1][0] not in ("x", "vx"):  # without a base
            units = units[-1:]
        for place in np.ndindex(*shape):
            unit = units[min(place[-1] if shape else 0, len(units) - 1)]
            yield ".".join(label[i] for label, i in zip(labels, place, strict=True)), "" if unit == "1" else unit

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


class Quantity(NamedTuple):
    """A channel of one log: its shape, unit, frame and meaning."""

    shape: tuple[int, ...]
    unit: str
    frame: str
    about: str


def channel(
    table: str,
    about: str,
    *axes: str | int,
    unit: str = "",
    frame: str = "",
    dtype: type[np.generic] = np.float64,
    optional: bool = False,
) -> Any:
    """Declare a channel as a field of a dataclass; if it is optional, ``None`` stands for a missing one."""
    metadata = {"channel": Channel(table, about, axes, dtype, unit, frame)}
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


def channels_of(kind: type, table: str) -> Mapping[str, Channel]:
    """Return the channels of a table that a dataclass declares, by name."""
    found = {each.name: each.metadata["channel"] for each in fields(kind) if "channel" in each.metadata}
    return {name: each for name, each in found.items() if each.table == table}


def channel_rows(kind: type, first: str = "n") -> list[tuple[str, str, str, str, str]]:
    """Return name, shape, unit, frame and meaning of every channel of a log, for tables.

    Args:
        kind: class of the log.
        first: name of the number of ticks.
    """
    counts = {"entry": (), "update": ("m",), "array": ()}
    found = {each.name: each.metadata["channel"] for each in fields(kind) if "channel" in each.metadata}
    return [
        (name, _shape_words((*counts.get(each.table, (first,)), *each.axes)), each.units, each.frame, each.about)
        for name, each in found.items()
    ]


def _shape_words(axes: Sequence[str | int]) -> str:
    return f"({', '.join(map(str, axes))}{',' if len(axes) == 1 else ''})"


def described(kind: C) -> C:
    """Add the channels that a log declares to its docstring."""
    rows = [
        f"        {name}: {shape} {about}{f'; {frame} axes' if frame else ''}{f'; {unit}' if unit else ''}."
        for name, shape, unit, frame, about in channel_rows(kind)
    ]
    kind.__doc__ = (kind.__doc__ or "").replace("    Attributes:\n", "\n".join(["    Attributes:", *rows, ""]))
    return kind


@dataclass(frozen=True, kw_only=True)
class ArrayFile:
    """Channels and single values that are stored in one ``.npz`` file by name; those that are None are left out."""

    def tables(self) -> dict[str, list[str]]:
        """Return the names of the tables that this file has, and of the channels in each."""
        raise NotImplementedError

    def names_along(self) -> dict[str, list[str]]:
        """Return the names of the entries along axes, by the name of the axis."""
        raise NotImplementedError

    @property
    def channels(self) -> dict[str, Quantity]:
        """Shape, unit, frame and meaning of each channel that this file has."""
        found = {each.name: each.metadata["channel"] for each in fields(self) if "channel" in each.metadata}
        return {
            name: Quantity(getattr(self, name).shape, found[name].units, found[name].frame, found[name].about)
            for names in self.tables().values()
            for name in names
        }

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
                array, kinds = arrays[each.name], _SCALARS.get(getattr(each.type, "__name__", str(each.type)))
                if kinds and (array.shape != () or array.dtype.kind not in kinds):
                    held = f"shape {array.shape} and holds {array.dtype}"
                    raise RunFolderError(f"entry '{each.name}' has {held}, expected one value")
                values[each.name] = array.item() if kinds else array
        return cls(**values)
