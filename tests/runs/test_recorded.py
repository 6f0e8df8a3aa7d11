"""Channels by name, and tables of them: every format is read back and compared with the log to the last bit."""

import csv
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from documents import ARM

import lgmpc
from lgmpc.config.showing import export
from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.runs import Run, SolvedRun
from lgmpc.runs.channels import channel_rows
from lgmpc.runs.log import RunLog
from lgmpc.runs.recorded import columns_of
from lgmpc.runs.trajectory import TrajectoryLog


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("runs")
    changes = ["duration_s=0.4", "commands=[{at_s: 0.1, velocity_m_s: [0.3, 0, 0]}]", "pushes=[]"]
    run = lgmpc.load_run(lgmpc.run_config(lgmpc.load_config("solo12_velocity", changes), out).folder.path)
    assert isinstance(run, Run)
    return run


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> SolvedRun:
    out = tmp_path_factory.mktemp("solves")
    (out / "arm.yaml").write_text(ARM, encoding="utf-8")
    run = lgmpc.load_run(lgmpc.solve_config(lgmpc.load_solve_config(out / "arm.yaml"), out).folder.path)
    assert isinstance(run, SolvedRun)
    return run


def test_a_channel_is_its_array_and_says_what_it_is(walk: Run) -> None:
    assert walk["contact_forces"] is walk.log.contact_forces
    forces = walk.channels["contact_forces"]
    assert forces == ((len(walk["time"]), 4, 3), "N", "world", "forces on the robot, measured by the plant")
    assert walk.channels["momentum"].unit == "N.s, N.m.s" and walk.channels["v"].frame == "base"
    assert set(walk.channels) == {name for names in walk.log.tables().values() for name in names}
    with pytest.raises(InputError, match=r"contact_force; expected .* Did you mean contact_forces"):
        walk["contact_force"]
    with pytest.raises(InputError, match="joint_friction; expected one that was recorded; .* has none of: estimated"):
        walk["joint_friction"]


@pytest.mark.parametrize("kind", [RunLog, TrajectoryLog])
def test_every_channel_is_documented_once(kind: type) -> None:
    for name, shape, _, _, about in channel_rows(kind):
        assert about and shape.startswith("(")
        assert len(re.findall(rf"^ +{name}: {re.escape(shape)} ", kind.__doc__ or "", re.MULTILINE)) == 1


def test_columns_are_named_after_joints_feet_and_axes_with_their_units(walk: Run) -> None:
    columns = {each.name: each for each in columns_of(walk.log, "ticks")}
    assert columns["contact_forces.HL_FOOT.z"].unit == "N"
    assert np.array_equal(columns["contact_forces.HL_FOOT.z"].values, walk.log.contact_forces[:, 2, 2])
    assert np.array_equal(columns["tau.FR_KFE"].values, walk.log.tau[:, 5])
    units = {name: columns[name].unit for name in ("q.z", "q.qw", "q.FL_HAA", "v.vx", "v.wx", "v.HR_KFE", "push.rx")}
    assert list(units.values()) == ["m", "", "rad", "m/s", "rad/s", "rad/s", "N.m"]
    with pytest.raises(InputError, match="table: got tick; .* Did you mean ticks"):
        columns_of(walk.log, "tick")


def test_pandas_has_every_number_by_time(walk: Run) -> None:
    frame = walk.to_pandas()
    assert frame.index.name == "time" and np.array_equal(frame.index, walk.log.time)
    assert np.array_equal(
        frame.filter(regex=r"^contact_forces\.").to_numpy().reshape(-1, 4, 3), walk.log.contact_forces
    )
    assert frame.attrs["units"]["tau.FL_HAA"] == "N.m"
    horizon = walk.to_pandas("mpc").filter(like="mpc_horizon_com").to_numpy()
    assert np.array_equal(horizon, walk.log.mpc_horizon_com.reshape(len(horizon), -1))


def test_csv_is_the_log_to_the_last_bit(walk: Run, tmp_path: Path) -> None:
    with walk.to_csv(tmp_path / "run.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = columns_of(walk.log, "ticks")
    assert header == [each.title for each in columns] and header[0] == "time [s]"
    read = np.array([[float(value) for value in row] for row in rows])
    assert np.array_equal(read, np.column_stack([each.values for each in columns]))
    none = replace(walk.log, **{name: getattr(walk.log, name)[:0] for name in walk.log.tables()["ticks"]})
    assert [each.title for each in columns_of(none, "ticks")] == header, "a robot that never answered has no rows"


def test_parquet_is_the_log_with_units_frames_and_config(walk: Run, tmp_path: Path) -> None:
    table = pq.read_table(walk.to_parquet(tmp_path / "run.parquet"))
    for each in columns_of(walk.log, "ticks"):
        assert (
            np.array_equal(table[each.name].to_numpy(), each.values)
            and table[each.name].to_numpy().dtype == each.values.dtype
        )
    field = table.schema.field("contact_forces.FL_FOOT.x").metadata
    assert field[b"unit"] == b"N" and field[b"frame"] == b"world" and field[b"about"]
    assert table.schema.metadata[b"config"].decode() == walk.config
    assert isinstance(pd.read_parquet(tmp_path / "run.parquet"), pd.DataFrame)


def test_a_solve_has_tables_of_nodes_intervals_and_iterations(reach: SolvedRun, tmp_path: Path) -> None:
    assert reach["xs"] is reach.log.xs
    nodes, intervals, iterations = (reach.to_pandas(name) for name in ("nodes", "intervals", "iterations"))
    assert np.array_equal(nodes.filter(regex=r"^xs\.").to_numpy(), reach.log.xs)
    assert list(intervals.index) == reach.log.times[:-1].tolist()
    assert [f"us.{name}" for name in reach.log.control_names] == list(intervals.filter(regex=r"^us\."))
    assert np.array_equal(iterations["iteration_cost"], reach.log.iteration_cost)
    assert reach.to_csv(tmp_path / "a.csv", "iterations").read_text(encoding="utf-8").startswith("iteration_cost,")


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("pandas", "pyarrow", "foxglove", "rerun"):
        monkeypatch.setitem(sys.modules, name, None)
    yield


def test_a_missing_package_is_one_error_with_the_line_that_installs_it(
    without: None, walk: Run, tmp_path: Path
) -> None:
    for suffix in ("parquet", "mcap", "rrd"):
        with pytest.raises(MissingDependencyError, match=r'pip install "lgmpc\[data\]"'):
            export(walk.path, tmp_path / f"run.{suffix}")
    with pytest.raises(MissingDependencyError, match="pandas"):
        walk.to_pandas()
    export(walk.path, tmp_path / "run.csv")
    assert [each.name for each in tmp_path.iterdir()] == ["run.csv"]
