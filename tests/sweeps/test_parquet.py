"""Results as Parquet."""

from collections.abc import Callable
from pathlib import Path

import pytest

from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.parquet import write_parquet

from .conftest import Parse

pytest.importorskip("pyarrow")


def test_rows_come_back_with_levels_and_metrics(tmp_path: Path, parse: Parse, row: Callable[..., Row]) -> None:
    import pyarrow.parquet

    sweep = parse("""
factors:
  - {key: plant.friction, kind: values, values: [0.4, 1]}
  - {key: plant.base_com_offset_m, kind: directions, count: 2, size: 0.01}
  - {key: plant.initial_posture, kind: values, values: [lying, {"*_KFE": 1.0}]}
""")
    rows = {
        point.key: row(
            point.key,
            Ending.FAIL if i == 0 else Ending.PASS,
            reasons=("it fell",) if i == 0 else (),
            metrics={"max_tilt_deg": float(i), "walking.steps": None},
        )
        for i, point in enumerate(sweep.points[:-1])
    }
    table = pyarrow.parquet.read_table(write_parquet(sweep, rows, tmp_path / "results.parquet"))
    assert table.num_rows == 7
    assert table.column("level.plant.friction").to_pylist() == [0.4] * 4 + [1.0] * 3
    assert table.column("level.plant.base_com_offset_m")[0].as_py() == pytest.approx([0.01, 0.0, 0.0])
    assert table.column("level.plant.initial_posture").to_pylist()[:2] == ["lying", "{'*_KFE': 1.0}"]
    assert table.column("metric.max_tilt_deg").to_pylist() == [float(i) for i in range(7)]
    assert str(table.schema.field("metric.walking.steps").type) == "double"
    assert table.column("passed").to_pylist() == [False] + [True] * 6
    assert table.column("reasons")[0].as_py() == ["it fell"]
    assert table.column("boundary").null_count == 7
