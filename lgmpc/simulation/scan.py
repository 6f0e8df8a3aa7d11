"""A simulated depth sensor above the base that looks around, and sees what nothing is in front of."""

import math
from collections.abc import Callable

import numpy as np

from lgmpc.lie import quaternion
from lgmpc.typing import Array

_RAYS = 180
_BLIND_SHARE = 0.1  # of the range


class DepthScan:
    """Points of the ground on rays around the sensor that are visible from it.

    Along a ray, ground is hidden behind whatever nearer is seen under a larger elevation.

    Args:
        truth: true heights of points (n, 2), m.
        pose: returns the true pose (7,) of the base, position and quaternion x y z w.
        range_m: longest horizontal distance, m.
        spacing: of points along a ray, m.
        above: height of the sensor above the base, m.
        noise: standard deviation of heights, m.
        rng: of the noise.
    """

    def __init__(
        self,
        truth: Callable[[Array], Array],
        pose: Callable[[], Array],
        range_m: float,
        spacing: float,
        above: float,
        noise: float,
        rng: np.random.Generator,
    ) -> None:
        self._truth, self._pose, self._above, self._noise, self._rng = truth, pose, above, noise, rng
        self._distance = np.arange(_BLIND_SHARE * range_m, range_m, spacing)
        angles = np.arange(_RAYS) * (2.0 * math.pi / _RAYS)
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        self._around = directions[:, None] * self._distance[:, None]

    def __call__(self) -> Array:
        """Return (k, 3) the visible points, in the axes of the base at its origin, m."""
        pose = self._pose()
        rotation = quaternion.to_matrix(pose[3:7])
        eye = pose[:3] + self._above * rotation[:, 2]
        heading = math.atan2(rotation[1, 0], rotation[0, 0])
        c, s = math.cos(heading), math.sin(heading)
        places = self._around @ np.array([[c, s], [-s, c]]) + eye[:2]
        heights = self._truth(places.reshape(-1, 2)).reshape(places.shape[:2])
        elevation = (heights - eye[2]) / self._distance
        visible = elevation >= np.maximum.accumulate(elevation, axis=1)
        points = np.column_stack([places[visible], heights[visible]])
        points[:, 2] += self._noise * self._rng.normal(size=len(points))
        return (points - pose[:3]) @ rotation
