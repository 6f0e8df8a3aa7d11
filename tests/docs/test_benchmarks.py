"""The tables of benchmarks: they have the figures of the committed JSON, which the scripts give."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import bench_estimation
import bench_wbc
import benchmarks
import pytest

RECORDS: dict[str, Any] = json.loads(benchmarks.FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", benchmarks.PAGES, ids=lambda page: page.name)
def test_a_page_has_the_figures_of_the_json(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert benchmarks.with_tables(text, benchmarks.tables(RECORDS)) == text, "run python scripts/benchmarks.py --pages"


def test_every_table_is_on_a_page_and_another_figure_would_be_too() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in benchmarks.PAGES)
    assert set(re.findall(r"<!-- table: (\w+) -->", text)) == set(benchmarks.tables(RECORDS))
    changed = json.loads(json.dumps(RECORDS))
    changed["loop"]["figures"]["update"]["p50_ms"] = 0.77
    assert benchmarks.with_tables(text, benchmarks.tables(changed)).count("0.77 (") == 3


def test_every_place_has_a_figure_unless_its_group_was_not_measured() -> None:
    paths = {path for path, _ in benchmarks.PLACE.findall(benchmarks.TEMPLATES.read_text(encoding="utf-8"))}
    assert len(paths) > 100
    missing = {path for path in paths if benchmarks.look_up(path, RECORDS) is None}
    assert {path for path in missing if path.partition(".")[0] in RECORDS} == set()


def test_a_record_names_command_date_and_machine() -> None:
    assert set(RECORDS) <= set(benchmarks.GROUPS)
    for record in RECORDS.values():
        assert (benchmarks.ROOT / record["command"].split()[1]).is_file()
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", record["date"]) and record["host"]["cpu"] and record["versions"]["pin"]


def test_every_script_of_a_benchmark_is_in_a_group() -> None:
    named = {group.command.split()[0] for group in benchmarks.GROUPS.values()}
    assert named == {file.name for file in (benchmarks.ROOT / "scripts").glob("bench_*.py")} | {"push_recovery.py"}


def test_a_line_without_a_figure_is_left_out() -> None:
    template = "| a | {loop.x:.1f} |\n| b | {loop.y} |\n| c | {loop.fate} |"
    records = {"loop": {"figures": {"x": 1.26, "fate": "falls"}}}
    assert benchmarks.filled(template, records) == "| a | 1.3 |\n| c | falls |"


@pytest.mark.parametrize(
    ("name", "module", "short"), [("wbc", bench_wbc, "TICKS"), ("estimation", bench_estimation, "CALLS")]
)
def test_a_scripts_json_has_what_the_tables_show(
    name: str, module: Any, short: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(module, short, 30)
    monkeypatch.setenv("LGMPC_JIT", "0")  # 30 calls: less than compiling takes
    file = tmp_path / "record.json"
    script, *options = benchmarks.GROUPS[name].quick.split()
    monkeypatch.setattr(sys, "argv", [script, *options, "--json", str(file)])
    module.main()
    record = json.loads(file.read_text(encoding="utf-8"))
    assert record["command"] == " ".join(["python", f"scripts/{script}", *options])
    record["figures"] = benchmarks.rounded(benchmarks.GROUPS[name].shown(record["figures"]))
    template = benchmarks.TEMPLATES.read_text(encoding="utf-8")
    places = {path for path, _ in benchmarks.PLACE.findall(template) if path.startswith(f"{name}.")}
    assert places and all(benchmarks.look_up(path, {name: record}) is not None for path in places)


def test_times_of_iterations_follow_from_those_of_solves() -> None:
    def row(solver: str, part: str, iterations: int, median_ms: float) -> dict[str, Any]:
        return {
            "problem": "stance 20",
            "solver": solver,
            "part": part,
            "iterations": iterations,
            "median_ms": median_ms,
        }

    solves = [row("lgmpc", "solve", 4, 2.0), row("crocoddyl", "solve", 5, 5.0)]
    steps = [row("piqp", "iteration 1", 1, 3.0), row("piqp", "iteration 2", 1, 1.0)]
    assert benchmarks.of_optimiser([*solves, *steps]) == {
        "stance_20": {"lgmpc_ms": 0.5, "crocoddyl_ms": 1.0, "ratio": 0.5, "piqp": {"mean_ms": 2.0, "first_ms": 3.0}}
    }
