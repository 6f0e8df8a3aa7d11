"""Height fields against closed forms, dense samples and MuJoCo's own rays; files."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from pydantic import TypeAdapter

from lgmpc.errors import InputError
from lgmpc.simulation.mujoco import _add_heights
from lgmpc.world import HeightField, World, WorldSettings, make_world

ROUGH = HeightField(np.random.default_rng(0).uniform(0.0, 0.04, (9, 13)), 0.05, (-0.3, 0.2))
SLOPE = HeightField(0.1 + 0.3 * 0.1 * np.arange(21) + 0.2 * 0.1 * np.arange(11)[:, None], 0.1, (1.0, -0.5))
"""A plane that rises by 0.3 along x and 0.2 along y."""


def world(section: object, seed: int = 0) -> World:
    return make_world(TypeAdapter(WorldSettings).validate_python(section), 0.6, seed)


def test_a_field_of_a_plane_is_the_plane() -> None:
    points = np.random.default_rng(1).uniform([1.3, -0.2], [2.7, 0.2], (50, 2))
    plane = 0.1 + 0.3 * (points[:, 0] - 1.0) + 0.2 * (points[:, 1] + 0.5)
    np.testing.assert_allclose(SLOPE.height(points), plane, atol=1e-12)
    normal = np.array([-0.3, -0.2, 1.0]) / math.sqrt(1.13)
    np.testing.assert_allclose(SLOPE.normal(points), np.tile(normal, (50, 1)), atol=1e-12)
    for away in (-0.02, 0.02):
        distance, normals = SLOPE.distance(np.column_stack([points, plane]) + away * normal)
        np.testing.assert_allclose(distance, away, atol=1e-9)
        np.testing.assert_allclose(normals, np.tile(normal, (50, 1)), atol=1e-6)
    assert SLOPE.height(np.array([[0.9, 0.0]]))[0] == -math.inf


def test_the_triangles_are_mujocos() -> None:
    spec = mujoco.MjSpec()
    _add_heights(spec, ROUGH, {})
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    points, geom = np.random.default_rng(2).uniform([-0.29, 0.21], [0.29, 0.59], (200, 2)), np.zeros(1, np.int32)
    down = [
        mujoco.mj_ray(model, data, np.array([*point, 1.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom)
        for point in points
    ]
    np.testing.assert_allclose(ROUGH.height(points), 1.0 - np.array(down), atol=1e-6)


def test_distances_are_those_to_the_nearest_sampled_point() -> None:
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 1201), np.linspace(0.2, 0.6, 801))
    plan = np.column_stack([x.ravel(), y.ravel()])
    surface = np.column_stack([plan, ROUGH.height(plan)])
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.2, 0.3, 0.03], [0.2, 0.5, 0.08], (20, 3))
    distance, normals = ROUGH.distance(points)
    for i, point in enumerate(points):
        if point[2] - ROUGH.height(point[None, :2])[0] > 0.05 or distance[i] < 0.0:
            continue
        assert distance[i] == pytest.approx(np.linalg.norm(surface - point, axis=1).min(), abs=2e-4)
        foot = point - distance[i] * normals[i]
        assert ROUGH.height(foot[None, :2])[0] == pytest.approx(foot[2], abs=1e-9)


def test_the_highest_along_a_segment_is_that_of_dense_samples() -> None:
    begin, end = np.array([[-0.29, 0.25], [0.0, 0.3]]), np.array([[0.28, 0.55], [0.0, 0.55]])
    samples = begin[:, None] + np.linspace(0, 1, 2001)[:, None] * (end - begin)[:, None]
    expected = ROUGH.height(samples.reshape(-1, 2)).reshape(2, -1).max(axis=1)
    np.testing.assert_allclose(ROUGH.highest(begin, end), expected, atol=2e-3)


def test_a_sphere_in_a_valley_touches_both_sides_and_on_a_plane_one() -> None:
    valley = World((HeightField(np.abs(np.arange(-4, 5)) * np.full((9, 1), 0.05), 0.1, (-0.4, -0.4)),))
    slant = math.atan(0.5)
    found = valley.contacts(np.array([[0.0, 0.03, 0.016 / math.cos(slant)]]), np.array([0.016]), 1e-3)
    assert found.distance == pytest.approx([0.016, 0.016])
    assert sorted(found.normal[:, 0]) == pytest.approx([-math.sin(slant), math.sin(slant)])
    plane = World((SLOPE,))
    at = np.array([[2.0, 0.0, 0.1 + 0.3 + 0.1 + 0.016]])  # on a point of the grid
    assert len(plane.contacts(at, np.array([0.016]), 1e-3).sphere) == 1


def test_pictures_have_a_scale_and_arrays_are_heights(tmp_path: Path) -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20
    Image.fromarray(grey).save(tmp_path / "map.png")
    np.save(tmp_path / "map.npy", grey[::-1] / 255.0)
    section = {"kind": "heights", "cell_m": 0.1, "file": str(tmp_path / "map.png"), "white_m": 0.5}
    picture, array = world(section), world({**section, "file": str(tmp_path / "map.npy")})
    points = np.array([[1.0, -0.1], [1.25, 0.07], [0.5, 0.0]])
    assert picture.height(points)[0] == pytest.approx(160 / 255 * 0.5)  # lower left of the picture: on the right
    np.testing.assert_allclose(picture.height(points[:2]), 0.5 * array.height(points[:2]), atol=1e-9)
    assert picture.height(points)[2] == 0.0


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"file": "map.png"}, r"world.white_m: got None; expected the height of white in map.png"),
        ({"file": "none.png", "white_m": 1.0}, r"world.file: got .*none.png.*a picture"),
        ({"file": "nan.npy"}, r"world.file: got 1 not finite, the first in row 1, column 2"),
        ({"file": "flat.npy"}, r"world.file: got an array of shape \(5,\); expected two or more rows"),
        ({"heights_m": [[0.0, 1.0]]}, r"world.heights_m: got an array of shape \(1, 2\)"),
    ],
)
def test_bad_height_fields(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, section: dict[str, object], message: str):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(np.zeros((3, 3), np.uint8)).save("map.png")
    np.save("nan.npy", np.where(np.arange(12).reshape(3, 4) == 6, np.nan, 0.0))
    np.save("flat.npy", np.zeros(5))
    with pytest.raises(InputError, match=message):
        world({"kind": "heights", "cell_m": 0.1, **section})


def test_hills_begin_and_end_level() -> None:
    ground = world("hills_80mm", 3)
    edge, middle = ground.height(np.array([[1.0, 0.2], [4.0, 0.1]])), np.random.default_rng(0).uniform(1.5, 3.5, 400)
    assert edge == pytest.approx([0.0, 0.0])
    heights = ground.height(np.column_stack([middle, np.linspace(-0.9, 0.9, 400)]))
    assert 0.0 <= heights.min() and 0.04 < heights.max() <= 0.08
