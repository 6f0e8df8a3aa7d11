"""Array types of annotations, and the acceleration of gravity, throughout the package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["GRAVITY", "Array", "BoolArray", "IntArray"]

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

GRAVITY = 9.81
"""Acceleration of gravity on Earth, m/s2."""
