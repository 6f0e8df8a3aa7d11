"""Rectangular soles: corners, centres of pressure, and margins within the support polygon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from lgmpc.typing import Array

__all__ = ["center_of_pressure", "in_axes_of", "margin_inside", "sole_corners"]


def center_of_pressure(wrench: Array) -> Array:
    """Return (2,) the point in the plane z = 0 of a wrench's axes about which its horizontal moment vanishes, m.

    ``[-m_y, m_x] / f_z`` (Sardain and Bessonnet, "Forces acting on a biped robot. Center of pressure - zero moment
    point", IEEE Trans. SMC A 34, 2004).
    """
    point: Array = np.array([-wrench[4], wrench[3]]) / wrench[2]
    return point


def sole_corners(placement: pin.SE3, half_size: tuple[float, float]) -> Array:
    """Return (4, 3) the corners of a rectangular sole about a frame's origin, world axes, m."""
    length, width = half_size
    local = np.array([[i * length, j * width, 0.0] for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    corners: Array = local @ placement.rotation.T + placement.translation
    return corners


def in_axes_of(soles: Sequence[pin.SE3], wrenches: Array) -> Array:
    """Rotate wrenches (n, nc, 6) at the soles' origins from world axes to the soles' own axes."""
    back = np.array([sole.rotation.T for sole in soles])
    turned = [np.einsum("cij,kcj->kci", back, part) for part in (wrenches[..., :3], wrenches[..., 3:])]
    return np.concatenate(turned, axis=2)


def margin_inside(corners: Array, points: Array) -> float:
    """Return the smallest distance of points (n, >= 2) to the edge of the corners' (m, >= 2) convex hull in z = 0, m.

    Negative if a point is outside.
    """
    from scipy.spatial import ConvexHull  # here, because only problems with soles use it

    edges = ConvexHull(corners[:, :2]).equations
    return float(-(points[:, :2] @ edges[:, :2].T + edges[:, 2]).max())
