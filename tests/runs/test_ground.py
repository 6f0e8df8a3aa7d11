"""Judging on ground that is no plane: normals of feet on edges and in corners, the ground below the base, friction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lgmpc.runs.ground import friction_channel, ground_below, ground_channels
from lgmpc.world import Box, Plane, World

RADIUS, UP = 0.016, np.array([0.0, 0.0, 1.0])
RISER = World((Plane(), Box((1.0, 0.0, 0.0), (0.5, 1.0, 0.1))))
"""A floor, and a step of 10 cm that begins at x = 0.5."""


def channels(world: World, centres: np.ndarray, forces: np.ndarray) -> dict[str, np.ndarray]:
    """The channels of one foot whose controller believes in a level floor."""
    base = np.array([0.0, 0.0, 0.25]) + 0.0 * centres
    points = (centres - RADIUS * UP)[:, None]
    return ground_channels(world, RADIUS, base, points, np.broadcast_to(UP, points.shape), forces[:, None])


def test_a_foot_in_a_corner_is_pressed_by_both_sides() -> None:
    centres = np.tile([0.5 - RADIUS, 0.0, RADIUS], (3, 1))
    forces = np.array([[0.0, 0.0, 10.0], [-5.0, 0.0, 10.0], [3.0, 0.0, 10.0]])
    found = channels(RISER, centres, forces)["contact_normals"][:, 0]
    np.testing.assert_allclose(found, [UP, np.array([-5.0, 0.0, 10.0]) / math.sqrt(125), UP], atol=1e-9)


def test_the_normal_of_a_force_is_that_of_the_tick_before() -> None:
    """The foot rolls over the edge of the step; the force was along the normal when it acted."""
    angle = np.linspace(0.2, 1.0, 9)
    normals = np.column_stack([-np.sin(angle), 0 * angle, np.cos(angle)])
    centres = np.array([0.5, 0.0, 0.1]) + RADIUS * normals
    found = channels(RISER, centres, 8.0 * np.roll(normals, 1, axis=0))["contact_normals"][:, 0]
    np.testing.assert_allclose(found[1:], normals[:-1], atol=1e-9)


def test_forces_in_the_cones_of_several_surfaces_are_judged_inside() -> None:
    """Two walls of a groove push with friction of up to 0.6 each; the sum never needs more than that."""
    rng, mu = np.random.default_rng(0), 0.6
    walls = [Box((0.45 * side, 0.0, 0.0), (0.5, 2.0, 0.2), (0.0, -side * 0.7, 0.0), mu) for side in (1.0, -1.0)]
    world = World((Plane((0.0, 0.0, -5.0)), *walls))
    height = np.linspace(-0.2, 0.6, 4001)
    gaps = world.distance(np.column_stack([0 * height, 0 * height, height]))[0] - RADIUS
    centre = np.array([0.0, 0.0, height[np.flatnonzero(gaps <= 0.0)[-1] + 1]])
    normals = world.contacts(centre[None], np.array([RADIUS]), 2e-3).normal
    assert len(normals) == 2
    forces = []
    for _ in range(300):
        total = np.zeros(3)
        for normal in normals:
            tangent = np.cross(normal, rng.normal(size=3))
            total += rng.uniform(0, 10) * (normal + mu * rng.uniform() * tangent / np.linalg.norm(tangent))
        forces.append(total)
    found = channels(world, np.tile(centre, (300, 1)), np.array(forces))["contact_normals"][:, 0]
    pressed = np.einsum("ni,ni->n", found, forces)
    across = np.linalg.norm(forces - pressed[:, None] * found, axis=1)
    assert (across <= mu * pressed * (1 + 1e-9)).all()


def test_the_ground_below_a_robot_on_stairs_is_their_slope() -> None:
    steps = [Box((0.25 * k + 5.0, 0.0, 0.025 * k - 0.5), (5.0, 3.0, 0.5 + 0.025 * k)) for k in range(20)]
    world = World((Plane((0.0, 0.0, -1.0)), *steps))
    base = np.column_stack([np.linspace(1.0, 3.0, 41), np.zeros(41), np.linspace(1.0, 3.0, 41) * 0.2 + 0.25])
    height, normal = ground_below(world, base, 0.3)
    np.testing.assert_allclose(height, 0.2 * (base[:, 0] - 0.125), atol=0.02)  # the middle of a tread of 25 cm
    assert np.degrees(np.arccos(normal @ [-math.sin(math.atan(0.2)), 0.0, math.cos(math.atan(0.2))])).max() < 4.0


def test_a_pit_between_stepping_stones_is_not_the_ground_below() -> None:
    stones = [Box((0.2 * i, 0.2 * j, -0.5), (0.06, 0.06, 0.5)) for i in range(-5, 6) for j in range(-5, 6)]
    world = World((Plane((0.0, 0.0, -0.4)), *stones))
    base = np.array([[0.0, 0.0, 0.25], [0.05, 0.1, 0.25], [0.0, 0.0, -0.2]])
    height, normal = ground_below(world, base, 0.3)
    np.testing.assert_allclose(height[:2], 0.0, atol=1e-3)
    np.testing.assert_allclose(normal[:2], [UP, UP], atol=1e-3)
    assert height[2] < -0.1  # it has fallen into the pit


def test_friction_is_recorded_where_the_ground_has_several() -> None:
    patch = World((Plane((0.0, 0.0, -1.0)), Box((0, 0, 0), (1, 1, 0.1), coefficient=0.2)))
    points = np.zeros((3, 2, 3))
    points[:, 1, 0] = 3.0
    found = friction_channel([(0, patch), (2, World())], points)
    assert found is not None and found.tolist() == [[0.2, 0.6], [0.2, 0.6], [0.6, 0.6]]
    assert friction_channel([(0, World()), (2, World((Plane(coefficient=0.3),)))], points) is None


@pytest.mark.parametrize("world", [World(), World((Plane((0.0, 0.0, 0.3), (-0.6, 0.0, 0.8)),))])
def test_planes_are_judged_as_they_are(world: World) -> None:
    centres = np.random.default_rng(0).normal(size=(5, 3))
    found = channels(world, centres, np.zeros((5, 3)))
    np.testing.assert_array_equal(found["ground_height"], world.height(np.zeros((5, 2))))
    np.testing.assert_array_equal(found["contact_normals"][:, 0], world.normal(centres[:, :2]))
