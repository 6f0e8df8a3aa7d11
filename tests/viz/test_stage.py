"""The camera: it follows robots that leave the picture, vertically only in flight."""

from __future__ import annotations

import numpy as np
import pytest

from lgmpc.viz.stage import frame_camera

LOWEST, HIGHEST = np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.4])
STEPS = np.linspace(0.0, 1.0, 11)[:, None]


def follow(travel: np.ndarray) -> np.ndarray:
    found = frame_camera(LOWEST, HIGHEST, travel, np.zeros((0, 3)))["follow"]
    return np.array(found)


def test_a_robot_that_stays_is_not_followed() -> None:
    assert follow(STEPS * [0.1, 0.1, 0.1]).size == 0


@pytest.mark.parametrize(
    ("travel", "followed"),
    [
        ([2.0, 0.5, 0.3], [2.0, 0.5, 0.0]),  # it walks away, and what its gait does is to be seen
        ([0.1, 0.1, 3.0], [0.0, 0.0, 3.0]),  # it flies up
        ([2.0, 0.0, 3.0], [2.0, 0.0, 3.0]),
    ],
)
def test_the_camera_follows_the_robot(travel: list[float], followed: list[float]) -> None:
    moves = follow(STEPS * travel)
    # The viewer has y up.
    assert moves[0].tolist() == [0.0, 0.0, 0.0]
    assert moves[-1] == pytest.approx([followed[0], followed[2], -followed[1]])
