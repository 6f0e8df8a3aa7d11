"""Ground of boxes against closed forms and against each box alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.world import Box, Plane, World
from lgmpc.world.boxes import Boxes

RNG = np.random.default_rng(3)
BOXES = [
    Box((*place, 0.0), tuple(half), (*tilt, yaw), mu)
    for place, half, tilt, yaw, mu in zip(
        RNG.uniform(-2, 2, (60, 2)),
        RNG.uniform(0.03, 0.6, (60, 3)),
        RNG.uniform(-0.4, 0.4, (60, 2)) * (np.arange(60) % 3 == 0)[:, None],
        RNG.uniform(-3, 3, 60),
        RNG.uniform(0.1, 1.0, 60),
        strict=True,
    )
]
STEP = World((Plane(), Box((1.0, 0.0, 0.0), (0.5, 1.0, 0.1), coefficient=0.3)))
"""A floor, and on it a box of 10 cm between x = 0.5 and 1.5."""


def on_top(box: Box, points: np.ndarray) -> np.ndarray:
    """The height of a box's top, found along its own axes; -inf beside it."""
    top = np.array(box.center) + box.half_size[2] * box.rotation[:, 2]
    found = []
    for x, y in points:
        z = top[2] - box.rotation[:2, 2] @ (np.array([x, y]) - top[:2]) / box.rotation[2, 2]
        local = box.rotation.T @ (np.array([x, y, z]) - box.center)
        found.append(z if (np.abs(local[:2]) <= box.half_size[:2]).all() else -np.inf)
    return np.array(found)


def test_the_highest_of_many_boxes_is_the_ground() -> None:
    ground, points = Boxes(BOXES), RNG.uniform(-3, 3, (500, 2))
    tops = np.array([on_top(each, points) for each in BOXES])
    np.testing.assert_allclose(ground.height(points), tops.max(axis=0), atol=1e-12)
    covered, best = np.isfinite(tops.max(axis=0)), tops.argmax(axis=0)
    assert 50 < covered.sum() < 450
    normals = np.array([each.rotation[:, 2] for each in BOXES])[best]
    np.testing.assert_allclose(ground.normal(points)[covered], normals[covered])
    frictions = np.array([each.coefficient for each in BOXES])[best]
    np.testing.assert_allclose(ground.friction(points)[covered], frictions[covered])


def test_the_highest_along_segments_is_that_of_dense_samples() -> None:
    ground, begin = Boxes(BOXES), RNG.uniform(-2, 2, (40, 2))
    end = begin + RNG.uniform(-0.5, 0.5, (40, 2))
    end[:5, 0] = begin[:5, 0]  # parallel to an axis
    samples = begin[:, None] + np.linspace(0, 1, 2001)[:, None] * (end - begin)[:, None]
    expected = ground.height(samples.reshape(-1, 2)).reshape(40, -1).max(axis=1)
    found = ground.highest(begin, end)
    assert np.isfinite(found).sum() > 20
    np.testing.assert_allclose(found[np.isfinite(found)], expected[np.isfinite(found)], atol=5e-4)
    assert (np.isfinite(expected) == np.isfinite(found)).all()


def test_distances_are_those_to_the_nearest_point_of_a_box() -> None:
    """The nearest point by sampling the surfaces of the boxes; inside all of them are negative."""
    boxes = BOXES[:6]
    ground, points = Boxes(boxes), RNG.uniform([-2, -2, -0.5], [2, 2, 0.8], (4000, 3))
    distance, normal = ground.distance(points)
    near = np.flatnonzero(np.isfinite(distance) & (distance < 0.15))
    assert len(near) > 100 and (distance[near] < 0).sum() > 20
    for i in near[:200]:
        alone = []
        for box in boxes:
            local = box.rotation.T @ (points[i] - box.center)
            clipped = np.clip(local, -np.array(box.half_size), box.half_size)
            outside = float(np.linalg.norm(local - clipped))
            alone.append(outside if outside else -float((box.half_size - np.abs(local)).min()))
        assert distance[i] == pytest.approx(min(alone), abs=1e-12)
        assert np.linalg.norm(normal[i]) == pytest.approx(1.0)
        # The normal is the gradient.
        ahead = ground.distance(points[i : i + 1] + 1e-6 * normal[i])[0][0]
        assert ahead - distance[i] == pytest.approx(1e-6, abs=1e-8)


def test_feet_stand_away_from_edges_only() -> None:
    x = np.array([0.0, 0.44, 0.48, 0.5, 0.52, 0.56, 1.0, 1.469, 1.531, 1.6])
    points = np.column_stack([x, 0 * x])
    expected = np.abs(np.abs(x - 1.0) - 0.5) > 0.03
    assert STEP.steppable(points, 0.03).tolist() == expected.tolist()
    assert STEP.steppable(np.array([[1.4, 0.95], [1.48, 0.98]]), 0.03).tolist() == [True, False]  # a corner
    assert not World((Box((0, 0, 0), (1, 1, 1)),)).steppable(np.array([[3.0, 0.0]]), 0.03)[0]
    # Flush boxes are one; a lip of less than a fifth of the radius is no edge; 50 degrees are too steep.
    flush = World((Box((-1, 0, 0), (1, 1, 0.1)), Box((1, 0, 0.001), (1, 1, 0.1))))
    assert flush.steppable(np.zeros((1, 2)), 0.03)[0]
    assert not World((Box((0, 0, 0), (1, 1, 0.1), (0.0, math.radians(50), 0.0)),)).steppable(np.zeros((1, 2)), 0.03)[0]


def test_clearance_far_above_is_the_height_above_the_ground() -> None:
    distance, normal = STEP.distance(np.array([[1.0, 0.0, 0.5], [1.0, 0.0, 0.2], [0.4, 0.0, 0.05]]))
    assert distance == pytest.approx([0.4, 0.1, 0.05])
    np.testing.assert_allclose(normal, [[0, 0, 1.0]] * 3)


def contacts(world: World, centre: tuple[float, float, float], radius: float = 0.016) -> list[tuple[float, ...]]:
    found = world.contacts(np.array([centre]), np.array([radius]), 0.01)
    assert (found.sphere == 0).all()
    columns = zip(found.normal, found.distance, found.friction, strict=True)
    return sorted((*np.round(normal, 9), round(distance, 9), mu) for normal, distance, mu in columns)


@pytest.mark.parametrize("radius", [0.016, 0.0])
def test_a_sphere_at_a_riser_touches_floor_and_riser(radius: float) -> None:
    found = contacts(STEP, (0.5 - radius - 1e-3, 0.0, radius - 1e-4), radius)
    assert found == [
        (-1.0, 0.0, 0.0, pytest.approx(radius + 1e-3), 0.3),
        (0.0, 0.0, 1.0, pytest.approx(radius - 1e-4), 0.6),
    ]


@pytest.mark.parametrize("radius", [0.016, 0.0])
@pytest.mark.parametrize("x", [0.0, 2e-3, 9e-3])
def test_flush_boxes_have_no_seam(radius: float, x: float) -> None:
    world = World((Plane((0, 0, -1.0)), Box((-1, 0, 0), (1, 1, 0.1)), Box((1, 0, 0), (1, 1, 0.1))))
    ((*normal, distance, _),) = contacts(world, (x, 0.0, 0.1 + radius - 1e-4), radius)
    assert normal == pytest.approx([0, 0, 1.0]) and distance == pytest.approx(radius - 1e-4)


def test_a_sphere_on_an_edge_has_its_normal_through_the_edge() -> None:
    ((*normal, distance, _),) = contacts(STEP, (0.5 - 0.016 * 0.6, 0.0, 0.1 + 0.016 * 0.8))
    assert normal == pytest.approx([-0.6, 0.0, 0.8]) and distance == pytest.approx(0.016)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0), (0.1, 0.0, 0.1)), "half_size: .*three positive numbers"),
        (((0, math.nan, 0), (0.1, 0.1, 0.1)), "center: .*three finite numbers"),
        (((0, 0, 0), (0.1, 0.1, 0.1), (math.pi, 0, 0)), "rpy: .*points upward"),
    ],
)
def test_bad_boxes(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Box(*arguments)  # type: ignore[arg-type]
