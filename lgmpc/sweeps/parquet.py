"""A sweep's results as a Parquet table, for pandas, Polars, DuckDB and the like."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lgmpc.errors import MissingDependencyError
from lgmpc.runs import atomic_write
from lgmpc.sweeps.design import Sweep
from lgmpc.sweeps.rows import Row

__all__ = ["check_pyarrow", "write_parquet"]


_OF_POINTS = ("key", "base", "variant", "draw")
_OF_ROWS = ("ending", "passed", "reasons", "boundary", "simulated_s", "elapsed_s", "log")


def check_pyarrow() -> None:
    """Check that pyarrow is installed, before a sweep computes for hours.

    Raises:
        MissingDependencyError: if it is not installed.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise MissingDependencyError("pyarrow", "a Parquet file", 'pip install "lgmpc[parquet]"')


def write_parquet(sweep: Sweep, rows: Mapping[str, Row], file: Path) -> Path:
    """Write a row for each finished point: its place in the sweep, its ending, its metrics.

    Columns: ``key``, ``base``, ``variant``, ``draw``, ``ending``, ``passed``, ``reasons``, ``boundary``,
    ``simulated_s``, ``elapsed_s``, ``log``, ``level.<key>`` for every factor and draw, ``metric.<name>``. Vectors are
    lists; levels of a key that are of several kinds are texts.

    Args:
        sweep: its document and points.
        rows: the finished points by their keys.
        file: the file to write.

    Returns:
        The file.

    Raises:
        MissingDependencyError: if pyarrow is not installed.
        RunFolderError: if the file cannot be written.
    """
    check_pyarrow()
    import pyarrow
    import pyarrow.parquet

    found = [(point, rows[point.key]) for point in sweep.points if point.key in rows]
    columns: dict[str, Any] = {name: [getattr(point, name) for point, _ in found] for name in _OF_POINTS}
    columns |= {name: [getattr(row, name) for _, row in found] for name in _OF_ROWS}
    columns["ending"] = [row.ending.value for _, row in found]
    # Columns without any value must have a type too.
    types = {"draw": pyarrow.int64(), "boundary": pyarrow.float64(), "reasons": pyarrow.list_(pyarrow.string())}
    for name in dict.fromkeys(name for _, row in found for name in row.metrics):
        columns[f"metric.{name}"] = [row.metrics.get(name) for _, row in found]
        types[f"metric.{name}"] = pyarrow.float64()
    arrays = {name: pyarrow.array(values, types.get(name)) for name, values in columns.items()}
    for key in dict.fromkeys(key for point, _ in found for key in point.levels):
        levels = [point.levels.get(key) for point, _ in found]
        try:
            arrays[f"level.{key}"] = pyarrow.array(levels)
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
            arrays[f"level.{key}"] = pyarrow.array(list(map(str, levels)))
    with atomic_write(file) as stream:
        pyarrow.parquet.write_table(pyarrow.table(arrays), stream)
    return file
