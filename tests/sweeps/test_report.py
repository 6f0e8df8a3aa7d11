"""Reports of sweeps."""

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from lgmpc.errors import RunFolderError
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.folder import SweepFolder
from lgmpc.sweeps.report import load_results, write_sweep_report

from .conftest import Parse

DOCUMENT = "factors: [{key: plant.friction, kind: values, values: [0.4, 0.8]}]\nvariants: {a: {}, b: {seed: 1}}"


@pytest.fixture
def folder(tmp_path: Path, parse: Parse) -> Path:
    """The folder of a sweep of which three of four points are finished."""
    sweep = parse(DOCUMENT)
    with closing(SweepFolder.open(tmp_path / "stand", sweep, resume=False)) as place:
        for point, ending in zip(sweep.points[:3], (Ending.PASS, Ending.RAISED, Ending.FAIL), strict=True):
            where = {"base": point.base, "variant": point.variant, "levels": dict(point.levels), "draw": point.draw}
            place.append(Row(point.key, ending, ("a <reason>",) * (ending is not Ending.PASS), **where))
    return place.path


def test_the_report_has_tables_points_and_the_document(folder: Path) -> None:
    (folder / "logs" / "fail-abc").mkdir()
    page = write_sweep_report(folder).read_text(encoding="utf-8")
    assert "1 of 4 points passed" in page and '<span class="verdict fail">' in page
    assert "1 points are not finished" in page and "1 x raised: a &lt;reason&gt;" in page
    assert "<td>b</td><td>0.4</td><td>raised</td>" in page
    assert "lgmpc explain" in page and "fail-abc" in page
    assert "base: [solo12_stand]" in page
    assert page.count("<svg") == 1


def test_results_of_other_versions_are_found_by_their_place(folder: Path, row: Callable[..., Row]) -> None:
    file = folder / "results.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    file.write_text("".join(json.dumps(line | {"key": f"{i:032x}"}) + "\n" for i, line in enumerate(lines)))
    sweep, rows = load_results(folder)
    assert [rows[point.key].ending for point in sweep.points[:3]] == [Ending.PASS, Ending.RAISED, Ending.FAIL]
    assert sweep.points[3].key not in rows


def test_a_sweep_without_results_says_how_to_get_them(folder: Path) -> None:
    (folder / "results.jsonl").unlink()
    with pytest.raises(RunFolderError, match="no finished point: lgmpc sweep .*--resume"):
        write_sweep_report(folder)
