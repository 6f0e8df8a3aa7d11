"""Periodic gaits: presets, derived quantities, and what is refused."""

from __future__ import annotations

import math

import pytest

from lgmpc.errors import InputError
from lgmpc.locomotion.gait import Gait, find_gait, quadruped_gaits


@pytest.mark.parametrize(
    ("name", "support"), [("stand", 4), ("walk", 3), ("trot", 2), ("pace", 2), ("bound", 2), ("pronk", 0)]
)
def test_presets_keep_their_feet_on_the_ground(name: str, support: int) -> None:
    gait = quadruped_gaits()[name]
    assert gait.name == name
    assert gait.min_support == support
    times = [(i + 0.5) / 997 for i in range(997)]
    counts = [sum((t - offset) % 1.0 >= 1.0 - gait.duty for offset in gait.offsets) for t in times]
    assert min(counts) == (support if name != "stand" else 4)


def test_the_feet_that_swing_together_name_the_gait() -> None:
    gaits = quadruped_gaits()
    fl, fr, hl, hr = gaits["trot"].offsets
    assert fl == hr and fr == hl and fl != fr
    fl, fr, hl, hr = gaits["pace"].offsets
    assert fl == hl and fr == hr and fl != fr
    fl, fr, hl, hr = gaits["bound"].offsets
    assert fl == fr and hl == hr and fl != hl
    fl, fr, hl, hr = gaits["walk"].offsets
    assert sorted([(hl, "hl"), (fl, "fl"), (hr, "hr"), (fr, "fr")])[0][1] == "hl"
    assert hl < fl < hr < fr


def test_periods_grow_with_the_root_of_the_height() -> None:
    low, high = quadruped_gaits(0.2), quadruped_gaits(0.8)
    assert high["trot"].period_s == pytest.approx(2.0 * low["trot"].period_s)
    assert quadruped_gaits(0.2094)["trot"].period_s == pytest.approx(0.24, abs=0.005)


def test_swing_and_stance_make_a_period() -> None:
    gait = Gait(name="crawl", period_s=1.0, duty=0.8, offsets=(0.0, 0.5))
    assert gait.swing_s == pytest.approx(0.2)
    assert gait.stance_s == pytest.approx(0.8)
    stand = Gait(name="stand", period_s=1.0, duty=1.0, offsets=(0.0,))
    assert stand.stands and stand.swing_s == 0.0 and stand.stance_s == math.inf


def test_reordered_feet_keep_their_offsets() -> None:
    walk = quadruped_gaits()["walk"]
    assert walk.reordered([2, 3, 0, 1]).offsets == (0.0, 0.5, 0.25, 0.75)
    with pytest.raises(InputError, match="order"):
        walk.reordered([0, 0, 1, 2])


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        ({"offsets": ()}, "offsets", "a gait without feet"),
        ({"duty": 0.0}, "duty", "greater than 0"),
        ({"duty": 1.1}, "duty", "not above 1"),
        ({"offsets": (0.0, 1.0)}, "offsets.1", "less than 1"),
        ({"offsets": (-0.1, 0.5)}, "offsets.0", "not below 0"),
        ({"period_s": 0.0}, "period_s", "not below 0.05"),
        ({"name": ""}, "name", "some text"),
    ],
)
def test_an_impossible_gait_is_refused_by_key(change: dict[str, object], key: str, words: str) -> None:
    values: dict[str, object] = {"name": "own", "period_s": 0.4, "duty": 0.6, "offsets": (0.0, 0.5), **change}
    with pytest.raises(InputError) as caught:
        Gait(**values)  # type: ignore[arg-type]
    assert caught.value.argument == key
    assert words in str(caught.value)


def test_an_unknown_gait_names_the_nearest() -> None:
    with pytest.raises(InputError, match="commands.1.gait.*Did you mean trot"):
        find_gait(quadruped_gaits(), "trott", "commands.1.gait")


def test_a_height_below_the_ground_has_no_gaits() -> None:
    with pytest.raises(InputError, match="height_m"):
        quadruped_gaits(-0.2)
