"""When a standing robot steps: the forecast capture point against the support."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lgmpc.locomotion.reaction import StepReaction, StepReactionSettings, support_margin

SQUARE = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])


@pytest.mark.parametrize(
    ("point", "margin"),
    [((0.0, 0.0), 0.15), ((0.1, 0.0), 0.1), ((0.0, -0.14), 0.01), ((0.25, 0.0), -0.05), ((0.0, 0.4), -0.25)],
)
def test_the_margin_is_the_distance_to_the_nearest_edge(point: tuple[float, float], margin: float) -> None:
    assert support_margin(np.array(point), SQUARE) == pytest.approx(margin)


def test_corners_within_the_hull_do_not_count() -> None:
    inside = np.vstack([SQUARE, [[0.05, 0.02], [0.0, 0.0]]])
    for point in ((0.0, 0.0), (0.1, 0.1), (0.3, 0.0)):
        assert support_margin(np.array(point), inside) == pytest.approx(support_margin(np.array(point), SQUARE))


@given(angle=st.floats(0.0, 2.0 * math.pi), order=st.permutations(range(4)), x=st.floats(-0.3, 0.3))
def test_neither_the_order_of_the_feet_nor_the_heading_matters(angle: float, order: list[int], x: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    point = np.array([x, 0.05])
    turned = support_margin(turn @ point + [1.0, -2.0], (SQUARE @ turn.T)[order] + [1.0, -2.0])
    assert turned == pytest.approx(support_margin(point, SQUARE), abs=1e-9)


def test_it_steps_where_the_pendulum_would_leave_the_support() -> None:
    """A pendulum of 0.2452 m has the time constant 0.1581 s: at 1 m/s its capture point is that far ahead."""
    height = 0.025 * 9.81
    reaction = StepReaction(StepReactionSettings(margin_m=0.02), height)
    com, ahead = np.array([0.0, 0.0, height]), 0.2 / math.sqrt(0.025)
    np.testing.assert_allclose(reaction.capture_point(com, np.array([1.0, 0.0, 0.0])), [math.sqrt(0.025), 0.0])
    points = np.column_stack([SQUARE, np.zeros(4)])
    assert not reaction.needed(com, np.array([0.89 * ahead, 0.0, 0.0]), points)
    assert reaction.needed(com, np.array([0.91 * ahead, 0.0, 0.0]), points)
