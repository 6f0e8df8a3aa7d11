"""The capture point and its distance from the edge of the support."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial import ConvexHull

from lgmpc.support import capture_point, support_margin

SQUARE = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])


def margin(points: np.ndarray, place: tuple[float, float], used: object = True) -> float:
    flags = np.broadcast_to(np.asarray(used, dtype=bool), len(points))
    return float(support_margin(np.array([points]), np.array([flags]), np.array([place]))[0])


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((0.0, 0.0), 0.15),
        ((0.15, 0.0), 0.05),
        ((0.2, 0.0), 0.0),
        ((0.3, 0.0), -0.1),
        ((0.23, 0.19), -0.05),  # 3 : 4 : 5 from a corner
    ],
)
def test_a_rectangle(place: tuple[float, float], expected: float) -> None:
    assert margin(SQUARE, place) == pytest.approx(expected, abs=1e-12)


def test_two_feet_one_foot_and_none() -> None:
    assert margin(SQUARE, (0.2, 0.0), [True, True, False, False]) == pytest.approx(0.0, abs=1e-12)
    assert margin(SQUARE, (0.1, 0.0), [True, True, False, False]) == pytest.approx(-0.1)
    assert margin(SQUARE, (0.2, 0.05), [True, False, False, False]) == pytest.approx(-0.1)
    assert margin(SQUARE, (0.2, 0.15), [True, False, False, False]) == 0.0
    assert np.isnan(margin(SQUARE, (0.0, 0.0), False))


def test_random_hulls_against_qhull() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        points = rng.normal(size=(6, 2))
        hull = ConvexHull(points)
        place = rng.normal(size=2) * 0.7
        inside = -(hull.equations[:, :2] @ place + hull.equations[:, 2]).max()
        if inside >= 0.0:
            expected = inside
        else:
            corners = points[hull.vertices]
            steps = np.linspace(0.0, 1.0, 20001)[:, None]
            edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            expected = -min(np.linalg.norm(a + steps * (b - a) - place, axis=1).min() for a, b in edges)
        assert margin(points, tuple(place)) == pytest.approx(expected, abs=1e-6)


@given(angle=st.floats(0.0, 2.0 * math.pi), order=st.permutations(range(4)), x=st.floats(-0.3, 0.3))
def test_neither_the_order_of_the_feet_nor_the_heading_matters(angle: float, order: list[int], x: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    point = np.array([x, 0.05])
    turned = margin((SQUARE @ turn.T)[order] + [1.0, -2.0], tuple(turn @ point + [1.0, -2.0]))
    assert turned == pytest.approx(margin(SQUARE, (x, 0.05)), abs=1e-9)


def test_corners_within_the_hull_and_the_number_of_places_do_not_count() -> None:
    inside = np.vstack([SQUARE, [[0.05, 0.02], [0.0, 0.0]]])
    places = np.random.default_rng(1).uniform(-0.3, 0.3, (5000, 2))  # more than one block
    flags = np.ones((len(places), len(inside)), dtype=bool)
    found = support_margin(np.tile(inside, (len(places), 1, 1)), flags, places)
    few = [margin(SQUARE, (x, y)) for x, y in places[4090:4100]]
    np.testing.assert_allclose(found[4090:4100], few, rtol=0, atol=1e-15)


def test_the_capture_point_of_a_pendulum_is_ahead_by_its_time_constant() -> None:
    """A pendulum of 0.2452 m has the time constant 0.1581 s: at 1 m/s its capture point is that far ahead."""
    com, velocity = np.array([0.1, 0.0, 0.025 * 9.81]), np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(capture_point(com, velocity, com[2]), [0.1 + math.sqrt(0.025), 0.0])
