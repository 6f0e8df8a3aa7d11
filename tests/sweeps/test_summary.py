"""Statistics and the summary of a sweep."""

import math

import numpy as np
import pytest

from lgmpc.sweeps import Ending, Row, Sweep
from lgmpc.sweeps.rows import mean_difference, median, share
from lgmpc.sweeps.summary import group_table, summarize

from .conftest import Parse


def test_the_interval_of_a_share_is_wilsons() -> None:
    # Brown, Cai and DasGupta, Statistical Science 2001: Wilson's interval for 2 of 10 at 95 % is [0.057, 0.510].
    found = share(2, 10)
    assert (found.value, found.low, found.high) == (
        0.2,
        pytest.approx(0.0567, abs=1e-4),
        pytest.approx(0.5098, abs=1e-4),
    )
    assert share(0, 10).low == pytest.approx(0.0, abs=1e-15)
    assert share(10, 10).high == pytest.approx(1.0, abs=1e-15)
    assert math.isnan(share(0, 0).value)


def test_bootstrap_intervals_cover_what_they_should() -> None:
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(100):
        found = mean_difference(rng.normal(0.3, 1.0, size=40).tolist())
        hits += found.low <= 0.3 <= found.high
    assert 88 <= hits <= 100  # 95 expected; four deviations below
    sample = rng.normal(0.3, 1.0, size=40).tolist()
    assert median(sample) == median(sample)
    assert median(sample).value == np.median(sample)


VARIED = """
factors: [{key: plant.friction, kind: values, values: [0.4, 0.8]}]
variants: {a: {}, b: {wbc.weights.posture: 0.1}}
expect: {min_pass_fraction: 0.7}
"""


def rows(sweep: Sweep, *endings: Ending) -> dict[str, Row]:
    made = {}
    for i, (point, ending) in enumerate(zip(sweep.points, endings, strict=False)):
        made[point.key] = Row(point.key, ending, ("why",), {"max_tilt_deg": float(i**2)}, variant=point.variant)
    return made


def test_shares_levels_and_pairs(parse: Parse) -> None:
    sweep = parse(VARIED)
    found = summarize(sweep, rows(sweep, Ending.PASS, Ending.FAIL, Ending.PASS, Ending.PASS))
    assert [(g.labels["variant"], g.labels["plant.friction"], g.passed.value) for g in found.groups] == [
        ("a", "0.4", 1.0),
        ("b", "0.4", 0.0),
        ("a", "0.8", 1.0),
        ("b", "0.8", 1.0),
    ]
    assert [(level.labels["variant"], level.labels["level"], level.passed.value) for level in found.levels] == [
        ("a", "0.4", 1.0),
        ("b", "0.4", 0.0),
        ("a", "0.8", 1.0),
        ("b", "0.8", 1.0),
    ]
    assert group_table(found.levels, ()).rows[1][:4] == ("plant.friction", "0.4", "b", "1")
    tilt = next(each for each in found.pairings if each.quantity == "max_tilt_deg")
    assert (tilt.variant, tilt.against, tilt.difference.value) == ("b", "a", ((1 - 0) + (9 - 4)) / 2)
    assert (found.passed, found.verdict, found.count) == (True, "pass", "3 of 4 points passed")
    assert found.content()["groups"][1]["endings"] == {"fail": 1}
    unpaired = parse(VARIED + "paired: false\n")
    assert summarize(unpaired, rows(unpaired, *[Ending.PASS] * 4)).pairings == ()


@pytest.mark.parametrize(
    ("expect", "endings", "verdict", "count"),
    [
        ("", [Ending.PASS] * 4, "pass", "4 of 4 points passed"),
        ("", [Ending.FAIL, *[Ending.PASS] * 3], "done", "3 of 4 points passed"),
        ("expect: {min_pass_fraction: 0.7}", [Ending.FAIL, *[Ending.PASS] * 3], "pass", "3 of 4 points passed"),
        ("expect: {min_pass_fraction: 0.8}", [Ending.FAIL, *[Ending.PASS] * 3], "fail", "3 of 4 points passed"),
        ("", [Ending.RAISED, *[Ending.PASS] * 3], "fail", "3 of 4 points passed"),
        ("", [Ending.PASS] * 3, "fail", "3 of 4 points passed"),
    ],
)
def test_the_verdict_says_what_is_true(
    parse: Parse, expect: str, endings: list[Ending], verdict: str, count: str
) -> None:
    sweep = parse(VARIED.partition("expect")[0] + expect)
    found = summarize(sweep, rows(sweep, *endings))
    assert (found.verdict, found.count, found.passed) == (verdict, count, verdict != "fail")


def test_drawn_numbers_are_shown_in_bins_of_equal_count(parse: Parse) -> None:
    sweep = parse("samples: {count: 20, keys: [{key: plant.friction, kind: uniform, range: [0.5, 0.9]}]}")
    endings = [Ending.PASS if p.config.plant.friction > 0.6 else Ending.FAIL for p in sweep.points]
    levels = summarize(sweep, rows(sweep, *endings)).levels
    assert [level.passed.count for level in levels] == [4, 4, 4, 4, 4]
    assert levels[0].passed.value < levels[-1].passed.value == 1.0
    assert sum(level.passed.value * 4 for level in levels) == pytest.approx(endings.count(Ending.PASS))


def test_complaints_name_what_is_missing_and_what_is_not_kept(parse: Parse) -> None:
    sweep = parse(VARIED)
    found = summarize(sweep, rows(sweep, Ending.PASS, Ending.FAIL, Ending.DIED))
    assert found.broken == {"died: why": 1}
    assert found.complaints == (
        "1 points are not finished: add --resume",
        "1 points have no verdict",
        "50 % passed, expected at least 70 %",
    )


def test_boundaries_of_all_directions_are_one_group(parse: Parse) -> None:
    sweep = parse("""
factors:
  - {key: plant.base_com_offset_m, kind: directions, count: 4, size: 0.01}
  - {key: plant.friction, kind: values, values: [0.4, 0.8]}
bisect: {key: plant.mass_scale, range: [1.0, 9.0], tolerance: 0.1}
expect: {min_boundary: 2.5}
""")
    made = {p.key: Row(p.key, Ending.PASS, boundary=2.0 + i) for i, p in enumerate(sweep.points)}
    made[sweep.points[0].key] = Row(sweep.points[0].key, Ending.UNBRACKETED, ("bisect.range: got 9",))
    found = summarize(sweep, made)
    assert len(found.groups) == 2
    low, high = found.groups
    assert low.boundary is not None
    assert (low.lowest, low.boundary.value, low.highest, low.boundary.count) == (4.0, 6.0, 8.0, 3)
    assert (high.lowest, high.highest) == (3.0, 9.0)
    assert found.complaints == ("1 points have no verdict",)
    assert found.broken == {"unbracketed: bisect.range: got 9": 1}
