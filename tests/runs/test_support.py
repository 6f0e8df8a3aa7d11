"""The capture point and its distance from the edge of the support."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lgmpc.runs.limited import capture_margin, support_margin
from lgmpc.runs.log import MODES

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


def test_the_capture_point_leads_by_the_pendulums_time_constant(changed) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["momentum"][:, 0] = 2.5 * 0.7
        arrays["com"][:, 2] = 0.981  # sqrt(z / g) = sqrt(0.1) s

    log = replace(changed(edit), mass_kg=2.5)
    assert capture_margin(log)[0] == pytest.approx(0.2 - 0.7 * np.sqrt(0.1))


def test_a_body_that_may_lie_on_the_floor_has_no_capture_point(changed) -> None:
    log = replace(changed(lambda arrays: None), mass_kg=2.5)
    mode = np.full(log.ticks, MODES.index("stand"), dtype=np.int8)
    mode[500:] = MODES.index("sit")
    steps = {
        "command": np.zeros((log.ticks, 3)),
        "gait_period_s": np.full(log.ticks, 0.4),
        "stance": np.ones((log.ticks, 4), dtype=np.int8),
        "contact_states": np.zeros((log.ticks, 4), dtype=np.int8),
        "swing_targets": np.zeros((log.ticks, 4, 3)),
        "footholds": np.zeros((log.ticks, 4, 3)),
    }
    margin = capture_margin(replace(log, mode=mode, **steps))
    assert np.isfinite(margin[:500]).all() and np.isnan(margin[500:]).all()
