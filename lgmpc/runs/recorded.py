"""Logs as tables, with a column for each entry of each channel: for pandas, CSV and Parquet."""

import csv
import io
import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError, required
from lgmpc.runs.atomic import atomic_write
from lgmpc.runs.channels import ArrayFile, Channel, Quantity

if TYPE_CHECKING:
    from lgmpc.runs.result import RunResult, SolveResult

L_co = TypeVar("L_co", bound=ArrayFile, covariant=True)
R_co = TypeVar("R_co", bound="RunResult | SolveResult", covariant=True)


@dataclass(frozen=True)
class Column:
    """One entry of a channel over time.

    Attributes:
        name: channel and entry, such as ``contact_forces.FL_FOOT.z``.
        unit: its unit; empty for none.
        channel: the channel.
        values: (n,) one for each row.
    """

    name: str
    unit: str
    channel: Channel
    values: NDArray[Any]

    @property
    def title(self) -> str:
        """The name, with the unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def columns_of(log: ArrayFile, table: str) -> list[Column]:
    """Return the columns of a table of a log: first the time, if it has one.

    Raises:
        InputError: there is no such table; names those that there are.
    """
    tables = log.tables()
    if table not in tables:
        raise InputError("table", table, "a table of this run", tuple(tables))
    found: dict[str, Channel] = {e.name: e.metadata["channel"] for e in fields(log) if "channel" in e.metadata}
    names, columns = log.names_along(), []
    for name in tables[table]:
        values = getattr(log, name)
        shape = values.shape[1:]
        channel = found[name]
        # Axes of ticks are not part of a channel's, those of nodes are.
        inner = channel.axes[len(channel.axes) - len(shape) :]
        flat = values.reshape(len(values), math.prod(shape))
        for i, (entry, unit) in enumerate(channel.entries(inner, shape, names)):
            columns.append(Column(f"{name}.{entry}" if entry else name, unit, channel, flat[:, i]))
    if table == "intervals":
        columns.insert(0, Column("times", "s", found["times"], log.times[:-1]))  # type: ignore[attr-defined]
    return columns


@dataclass(frozen=True)
class Recorded(Generic[L_co, R_co]):
    """A finished run of any kind: arrays by the names of their channels, and tables of them.

    Attributes:
        path: the folder.
        config: text of its ``config.yaml``.
        log: the arrays.
        result: the content of its ``run.json``.
    """

    path: Path
    config: str = field(repr=False)
    log: L_co = field(repr=False)
    result: R_co

    @property
    def channels(self) -> dict[str, Quantity]:
        """Shape, unit, frame and meaning of each channel that was recorded."""
        return self.log.channels

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return the array of a channel.

        Raises:
            InputError: there is no channel of this name, or it was not recorded in this run.
        """
        known = {each.name: each.metadata["channel"] for each in fields(self.log) if "channel" in each.metadata}
        if name not in known:
            raise InputError("channel", name, f"a channel of {self.path.name}", tuple(self.channels))
        if getattr(self.log, name) is None:
            raise InputError(
                "channel", name, f"one that was recorded; {self.path.name} has none of: {known[name].about}"
            )
        return getattr(self.log, name)

    def to_pandas(self, table: str | None = None) -> Any:
        """Return a pandas DataFrame with a column for each entry of each channel, indexed by the time, s.

        ``frame.attrs`` has the unit of each column under ``units``.

        Args:
            table: of a closed loop ``ticks`` or ``mpc``, its updates; of a solve ``nodes``, ``intervals`` or
                ``iterations``. The first unless given.

        Raises:
            InputError: there is no such table.
            MissingDependencyError: pandas is not installed.
        """
        pandas = required("pandas", "a DataFrame of a run", "data")
        columns = self._columns(table)
        frame = pandas.DataFrame({each.name: each.values for each in columns})
        frame.attrs["units"] = {each.name: each.unit for each in columns}
        return frame.set_index(columns[0].name) if columns[0].unit == "s" else frame

    def to_csv(self, file: str | Path, table: str | None = None) -> Path:
        """Write a table as CSV, whose header has the units, and whose numbers are those of the log to the last bit.

        Args:
            file: the file.
            table: see :meth:`to_pandas`.

        Returns:
            The file.

        Raises:
            InputError: there is no such table.
            RunFolderError: the file cannot be written.
        """
        columns = self._columns(table)
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow([each.title for each in columns])
        writer.writerows(zip(*(each.values.tolist() for each in columns), strict=True))
        with atomic_write(Path(file)) as stream:
            stream.write(text.getvalue().encode("utf-8"))
        return Path(file)

    def to_parquet(self, file: str | Path, table: str | None = None) -> Path:
        """Write a table as Parquet; fields have unit, frame and meaning in their metadata, the file the config.

        Arguments and errors as :meth:`to_csv`.

        Raises:
            MissingDependencyError: pyarrow is not installed.
        """
        arrow, parquet = (required(name, "a Parquet file", "data") for name in ("pyarrow", "pyarrow.parquet"))
        columns = self._columns(table)
        schema = arrow.schema(
            [
                arrow.field(
                    each.name,
                    arrow.from_numpy_dtype(each.values.dtype),
                    metadata={"unit": each.unit, "frame": each.channel.frame, "about": each.channel.about},
                )
                for each in columns
            ],
            metadata={"name": self.result.name, "config": self.config, "verdict": self.result.verdict.outcome.value},
        )
        data = arrow.table([np.ascontiguousarray(each.values) for each in columns], schema=schema)
        with atomic_write(Path(file)) as stream:
            parquet.write_table(data, stream)
        return Path(file)

    def _columns(self, table: str | None) -> list[Column]:
        return columns_of(self.log, next(iter(self.log.tables())) if table is None else table)
