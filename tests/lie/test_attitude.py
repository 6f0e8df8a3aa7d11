"""Angles of attitudes against scipy's rotations, and turns of the plane."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from lgmpc.lie import attitude

ROTATIONS = Rotation.random(200, random_state=0)
MATRICES = ROTATIONS.as_matrix()


def test_roll_pitch_yaw_are_scipys() -> None:
    expected = ROTATIONS.as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(attitude.roll_pitch_yaw(MATRICES), expected, atol=1e-13)
    np.testing.assert_allclose(attitude.yaw(MATRICES), expected[:, 2], atol=1e-13)
    assert attitude.roll_pitch_yaw(MATRICES[0]).shape == (3,)


def test_tilt_is_the_angle_of_the_upright_axis() -> None:
    np.testing.assert_allclose(attitude.tilt(MATRICES), np.arccos(MATRICES[:, 2, 2]), atol=1e-7)
    upright = np.array([0.0, 0.6, 0.8])
    np.testing.assert_allclose(attitude.tilt(MATRICES, upright), np.arccos((MATRICES @ upright)[:, 2]), atol=1e-7)
    small = Rotation.from_rotvec([[1e-9, 0.0, 0.3], [0.0, 0.0, 1.0]]).as_matrix()
    np.testing.assert_allclose(attitude.tilt(small), [1e-9 * math.sin(0.15) / 0.15, 0.0], rtol=1e-6)


def test_a_rotation_is_the_tilt_after_the_yaw() -> None:
    tilts, yaws = attitude.tilt_and_yaw(MATRICES)
    rest = ROTATIONS * Rotation.from_euler("z", -yaws[:, None])
    np.testing.assert_allclose(rest.as_rotvec()[:, 2], 0.0, atol=1e-13)
    np.testing.assert_allclose(rest.magnitude(), tilts, atol=1e-13)


def test_angle_between_two_rotations() -> None:
    expected = (ROTATIONS[:-1].inv() * ROTATIONS[1:]).magnitude()
    np.testing.assert_allclose(attitude.angle_between(MATRICES[:-1], MATRICES[1:]), expected, atol=1e-13)
    assert attitude.angle_between(np.eye(3), np.eye(3)) == 0.0


def test_turns_of_the_plane() -> None:
    angle, x, y = 0.7, 0.3, -1.2
    expected = Rotation.from_euler("z", angle).apply([x, y, 0.0])[:2]
    np.testing.assert_allclose(attitude.turn(angle, x, y), expected, rtol=1e-15)
    batch = attitude.turn(np.array([0.0, angle]), np.array([x, x]), y)
    np.testing.assert_allclose(np.stack(batch, axis=-1), [[x, y], expected], rtol=1e-15)
