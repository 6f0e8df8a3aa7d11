"""Surfaces and worlds against closed forms of planes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.errors import InputError
from lgmpc.world import FloorSettings, Plane, SlopeSettings, World, make_world

ANGLES = st.floats(0.0, 45.0)
HEADINGS = st.floats(-360.0, 360.0)
METRES = st.floats(-100.0, 100.0)


@given(ANGLES, HEADINGS, METRES, METRES, METRES)
def test_a_slope_rises_along_its_uphill_direction(
    angle: float, uphill: float, height: float, x: float, y: float
) -> None:
    world = make_world(SlopeSettings(angle_deg=angle, uphill_deg=uphill, height_m=height), 0.6)
    direction = np.array([math.cos(math.radians(uphill)), math.sin(math.radians(uphill))])
    expected = height + math.tan(math.radians(angle)) * float(direction @ [x, y])
    points = np.array([[x, y]])
    assert world.height(points)[0] == pytest.approx(expected, abs=1e-9)
    normal = world.normal(points)[0]
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert math.degrees(math.acos(min(normal[2], 1.0))) == pytest.approx(angle, abs=1e-5)
    # Points of the ground have no distance; a point moved along the normal has that distance.
    on = np.array([[x, y, expected], [x, y, expected]]) + np.array([[0.0], [0.3]]) * normal
    distance, normals = world.distance(on)
    assert distance == pytest.approx([0.0, 0.3], abs=1e-9)
    assert np.array_equal(normals, [normal, normal])


def test_the_floor_is_level_at_its_height() -> None:
    world = make_world(FloorSettings(height_m=-0.05), 0.4)
    points = np.array([[0.0, 0.0], [3.0, -2.0]])
    assert np.array_equal(world.height(points), [-0.05, -0.05])
    assert np.array_equal(world.normal(points), [[0.0, 0.0, 1.0]] * 2)
    assert np.array_equal(world.friction(points), [0.4, 0.4])
    assert world.steppable(points, 0.02).all()


def test_of_two_planes_the_higher_one_is_the_ground() -> None:
    rise = make_world(SlopeSettings(angle_deg=20.0), 0.3).surfaces[0]
    world = World((Plane(coefficient=0.8), rise))
    points = np.array([[-1.0, 0.0], [1.0, 0.0]])
    assert world.height(points) == pytest.approx([0.0, math.tan(math.radians(20.0))])
    assert np.array_equal(world.friction(points), [0.8, 0.3])
    assert world.normal(points)[0] == pytest.approx([0.0, 0.0, 1.0])
    assert world.normal(points)[1] == pytest.approx(rise.normal(points)[1])
    assert world.highest(points[:1], points[1:]) == pytest.approx([math.tan(math.radians(20.0))])


@given(ANGLES, HEADINGS, HEADINGS)
def test_the_start_lies_on_the_ground_under_its_heading(angle: float, uphill: float, yaw: float) -> None:
    settings = SlopeSettings(angle_deg=angle, uphill_deg=uphill, start_m=(2.0, -1.0), start_yaw_deg=yaw)
    world = make_world(settings, 0.6)
    axes, point = world.start_pose
    assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[:, 2] == pytest.approx(world.normal(np.zeros((1, 2)))[0])
    assert world.distance(point[None])[0] == pytest.approx([0.0], abs=1e-12)
    ahead = np.array([math.cos(math.radians(yaw)), math.sin(math.radians(yaw))])
    assert ahead @ axes[:2, 0] == pytest.approx(np.linalg.norm(axes[:2, 0]))


def test_a_level_start_at_the_origin_is_exact() -> None:
    axes, point = make_world(FloorSettings(), 0.6).start_pose
    assert np.array_equal(axes, np.eye(3)) and np.array_equal(point, np.zeros(3))


@pytest.mark.parametrize("normal", [(0.0, 0.0, 2.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (float("nan"), 0.0, 1.0)])
def test_a_plane_needs_an_upward_unit_normal(normal: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="a unit vector that points upward"):
        Plane(normal_vector=normal)


def test_a_world_needs_a_surface() -> None:
    with pytest.raises(InputError, match="at least one surface"):
        World(())
    for wrong in (np.zeros(3), (0.0,), "floor"):
        with pytest.raises(InputError, match="surfaces: got (ndarray|0.0|floor); expected a Plane, Box or HeightField"):
            World(wrong)  # type: ignore[arg-type]
