"""Worlds from configs: their heights, edges, seeds and names."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from lgmpc.world import World, WorldSettings, make_world

ADAPTER: TypeAdapter[Any] = TypeAdapter(WorldSettings)


def world(section: Any, seed: int = 0) -> World:
    return make_world(ADAPTER.validate_python(section), 0.6, seed)


def along(ground: World, *x: float, y: float = 0.0) -> list[float]:
    return [round(float(h), 9) for h in ground.height(np.array([[each, y] for each in x]))]


def test_stairs_up_and_down_again() -> None:
    ground = world({"kind": "stairs", "rise_m": 0.05, "steps": 2, "back": True, "height_m": 1.0})
    assert along(ground, -9, 0.99, 1.01, 1.24, 1.26, 2.24, 2.26, 2.49, 2.51, 3.4, 99) == [
        1, 1, 1.05, 1.05, 1.1, 1.1, 1.05, 1.05, 1.0, 1.0, 1.0,
    ]  # fmt: skip


def test_stairs_down_start_on_high_ground() -> None:
    ground = world("stairs_down_4cm")
    assert along(ground, -1, 0.99, 1.01, 1.26, 2.01, 5) == [0, 0, -0.04, -0.08, -0.2, -0.2]


def test_a_ramp_is_flush_with_both_levels() -> None:
    ground, rise = world({"kind": "ramp", "angle_deg": 15.0, "back": True}), 1.5 * math.tan(math.radians(15.0))
    x = np.linspace(0.9, 6.5, 3000)
    heights = ground.height(np.column_stack([x, 0 * x]))
    expected = np.interp(x, [1.0, 2.5, 3.5, 5.0], [0.0, rise, rise, 0.0])
    np.testing.assert_allclose(heights, expected, atol=1e-9)
    np.testing.assert_allclose(ground.normal(np.array([[4.0, 0.0]]))[0], [math.sin(0.2617994), 0, math.cos(0.2617994)])


def test_blocks_differ_by_the_seed_only() -> None:
    points = np.random.default_rng(0).uniform([1.0, -0.9], [3.9, 0.9], (300, 2))
    first, again, other = (world("blocks_50mm", seed).height(points) for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert 0.0 <= first.min() and 0.04 < first.max() <= 0.05
    fixed = [world({"kind": "blocks_50mm", "seed": 7}, seed).height(points) for seed in (1, 2)]
    assert np.array_equal(*fixed)


def test_between_stones_there_is_a_pit_and_each_stone_is_whole() -> None:
    ground = world({"kind": "stones", "shift_m": 0.02, "uneven_m": 0.01})
    points = np.random.default_rng(0).uniform([1.0, -0.9], [2.9, 0.9], (4000, 2))
    heights = ground.height(points)
    on = heights > -0.1
    assert (heights[~on] == -0.3).all() and np.abs(heights[on]).max() <= 0.01
    assert on.mean() == pytest.approx((0.12 / 0.2) ** 2, abs=0.03)


def test_gaps_and_patches() -> None:
    assert along(world("gaps_8cm"), 0.99, 1.04, 1.09, 1.47, 1.49, 9) == [0, -0.3, 0, 0, -0.3, 0]
    ice = world("ice")
    points = np.array([[0.5, 0.0], [1.5, 0.1], [4.5, 0.0]])
    assert ice.friction(points).tolist() == [0.6, 0.15, 0.6] and along(ice, 0.5, 1.5, 4.5) == [0, 0, 0]


def test_a_course_has_its_parts_in_a_row() -> None:
    ground = world(["ramp_10deg", {"kind": "stairs_4cm", "friction": 0.9}, "gaps_8cm"])
    top = 5 * 0.04
    ramp, stairs = 2 * (1.5 + 1.0), 4 * 0.25 + 1.0
    end = 1.0 + ramp + stairs
    assert along(ground, 0.9, end - stairs - 0.01, end - stairs + 0.01, end - 0.01, end + 0.01, end + 0.09) == [
        0.0, 0.0, 0.04, top, round(top - 0.3, 9), top,
    ]  # fmt: skip
    assert ground.friction(np.array([[end - 0.01, 0.0], [end + 0.09, 0.0]])).tolist() == [0.9, 0.6]


@pytest.mark.parametrize(
    ("name", "kind", "values"),
    [
        ("stairs_4cm", "stairs", {"rise_m": 0.04}),
        ("stairs_down_130mm", "stairs", {"rise_m": -0.13}),
        ("slope_down_15deg", "slope", {"angle_deg": 15.0, "uphill_deg": 180.0}),
        ("drop_3cm", "stairs", {"rise_m": -0.03, "steps": 1}),
        ("hole_5cm", "gaps", {"depth_m": 0.05, "count": 1}),
        ("ice", "patches", {"share": 1.0}),
        ("blocks", "blocks", {"max_height_m": 0.04}),
    ],
)
def test_names_stand_for_kinds_with_a_size(name: str, kind: str, values: dict[str, Any]) -> None:
    for section in (name, {"kind": name, "height_m": 2.0}):
        found = ADAPTER.validate_python(section)
        assert found.kind == kind and values.items() <= found.model_dump().items()
    assert ADAPTER.validate_python({"kind": name, "height_m": 2.0}).height_m == 2.0


def test_a_given_size_overrides_that_of_the_name() -> None:
    assert ADAPTER.validate_python({"kind": "stairs_4cm", "rise_m": 0.07}).rise_m == 0.07


OTHER: dict[str, Any] = {
    "kind": None, "seed": 5, "friction": 0.3, "share": 0.9, "patch_friction": 0.2, "back": True, "count": 1, "steps": 2,
    "start_m": (0.1, 0.2), "start_yaw_deg": 9.0, "heights_m": ((0.0, 0.1), (0.3, 0.2)), "shift_m": 0.03, "file": None,
    "white_m": None, "length_m": 0.9, "width_m": 1.3, "uphill_deg": 30.0, "soft": {"stiffness_n_m": 900.0},
}  # fmt: skip
"""Values of keys that are no size; those of files are tested with files."""


@pytest.mark.parametrize(
    "section",
    [
        *({"kind": kind} for kind in ("floor", "slope", "ramp", "stairs", "blocks", "gaps", "patches", "hills")),
        {"kind": "stones", "shift_m": 0.01},
        {"kind": "heights", "cell_m": 0.1, "heights_m": ((0.0, 0.1), (0.1, 0.2))},
    ],
    ids=lambda section: section["kind"],
)
def test_every_key_of_a_kind_changes_the_world(section: dict[str, Any]) -> None:
    settings = ADAPTER.validate_python(section)
    usual, left = make_world(settings, 0.6), []
    for key, value in settings.model_dump().items():
        other = OTHER[key] if key in OTHER else 0.07 if value == 0.0 else 0.7 * value
        if other is not None and repr(make_world(settings.replace({key: other}), 0.6)) == repr(usual):
            left.append(key)
    # A field of one's own has its own width; what is not random has no seed.
    random = section["kind"] in ("blocks", "stones", "patches", "hills")
    assert set(left) <= ({"width_m"} if section["kind"] == "heights" else set()) | (set() if random else {"seed"})
