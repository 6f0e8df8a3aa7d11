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
    lists; levels of a key that are neither all numbers, all texts nor all vectors are texts.

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
    columns: dict[str, list[Any]] = {
        "key": [point.key for point, _ in found],
        "base": [point.base for point, _ in found],
        "variant": [point.variant for point, _ in found],
        "draw": [point.draw for point, _ in found],
        "ending": [row.ending.value for _, row in found],
        "passed": [row.passed for _, row in found],
        "reasons": [list(row.reasons) for _, row in found],
        "boundary": [row.boundary for _, row in found],
        "simulated_s": [row.simulated_s for _, row in found],
        "elapsed_s": [row.elapsed_s for _, row in found],
        "log": [row.log for _, row in found],
    }
    for key in dict.fromkeys(key for point, _ in found for key in point.levels):
        columns[f"level.{key}"] = _alike([point.levels.get(key) for point, _ in found])
    for name in dict.fromkeys(name for _, row in found for name in row.metrics):
        columns[f"metric.{name}"] = [row.metrics.get(name) for _, row in found]
    # Columns without any value must have a type too.
    types = {"draw": pyarrow.int64(), "boundary": pyarrow.float64(), "reasons": pyarrow.list_(pyarrow.string())}
    types |= {name: pyarrow.float64() for name in columns if name.startswith("metric.")}
    table = pyarrow.table({name: pyarrow.array(values, types.get(name)) for name, values in columns.items()})
    with atomic_write(file) as stream:
        pyarrow.parquet.write_table(table, stream)
    return file


def _alike(values: list[Any]) -> list[Any]:
    """Return values of one type: numbers, texts, lists of numbers; else texts."""
    if all(isinstance(each, bool) for each in values) or all(isinstance(each, str) for each in values):
        return values
    if all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in values):
        return values if all(isinstance(each, int) for each in values) else [float(each) for each in values]
    vectors = all(isinstance(each, (list, tuple)) for each in values)
    if vectors and all(isinstance(part, (int, float)) for each in values for part in each):
        return [[float(part) for part in each] for each in values]
    return [str(each) for each in values]
