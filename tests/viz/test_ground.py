"""A replay on a slope: floor, cones, shadows and the camera are those of the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.lie import quaternion
from lgmpc.robot import Robot
from lgmpc.runs import Run
from lgmpc.viz.marks import turns_to
from lgmpc.viz.page import page_of
from lgmpc.viz.replay import replay_page
from lgmpc.viz.scene import Scene
from lgmpc.viz.stage import add_stage, frame_camera
from lgmpc.world import Box, Plane, World

from .test_overlay import at
from .test_replay import content_of

TILT = 0.2
NORMAL = (-math.sin(TILT), 0.0, math.cos(TILT))
SLOPE = World((Plane((0.0, 0.0, 1.3), NORMAL),))
UP = np.array([0.0, 0.0, 1.0])


def on_slope(run: Run) -> Run:
    """The run as it would be on the slope with gravity tilted as much: every vector and point is turned and moved."""
    turn, log = np.array([0.0, math.sin(-0.5 * TILT), 0.0, math.cos(0.5 * TILT)]), run.log
    moved: dict[str, Any] = {
        name: quaternion.act(turn, getattr(log, name)) + 1.3 * UP
        for name in ("contact_points", "com", "com_reference", "push_point", "mpc_horizon_com")
    }
    turned = ("contact_forces", "contact_forces_desired", "contact_normals", "ground_normal")
    moved |= {name: quaternion.act(turn, getattr(log, name)) for name in turned}
    q = log.q.copy()
    q[:, :3] = quaternion.act(turn, q[:, :3]) + 1.3 * UP
    q[:, 3:7] = [(pin.Quaternion(turn) * pin.Quaternion(each)).coeffs() for each in log.q[:, 3:7]]
    depth, rise = q[:, 2] - 1.3 - math.tan(TILT) * q[:, 0], np.full(len(q), math.tan(TILT))
    moved["believed_ground"] = np.column_stack([depth, rise, 0.0 * rise])
    return replace(run, log=replace(log, q=q, **moved))


@pytest.fixture(scope="module")
def contents(solo12: Robot, pushed_run: Run) -> tuple[dict[str, Any], dict[str, Any]]:
    """The contents of the level run's page, and of the turned one's."""
    level = replay_page(solo12, pushed_run)
    return content_of(level), content_of(replay_page(solo12, on_slope(pushed_run), SLOPE))


def placed(content: dict[str, Any], path: str, name: str) -> np.ndarray:
    found = [c["value"] for c in content["commands"] if c["path"] == path and c.get("property") == name]
    return np.array(found[-1])


def test_the_floor_lies_on_the_ground(contents: tuple[dict[str, Any], dict[str, Any]]) -> None:
    turn, origin = placed(contents[1], "/floor", "quaternion"), placed(contents[1], "/floor", "position")
    np.testing.assert_allclose(quaternion.act(turn, UP), NORMAL, atol=1e-12)
    for each in ("fine", "coarse"):
        point = origin + quaternion.act(turn, placed(contents[1], f"/floor/{each}", "position"))
        assert SLOPE.distance(point[None])[0][0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(placed(contents[0], "/floor", "quaternion"), [0.0, 0.0, 0.0, 1.0])


def test_the_believed_ground_lies_on_the_true_one_where_the_robot_is_right(
    contents: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    place = at(contents[1], "/overlay/belief/plane", ".position", np.linspace(0.0, 0.2, 5))
    np.testing.assert_allclose((place - [0.0, 0.0, 1.3]) @ NORMAL, 0.002, atol=1e-5)
    turn = placed(contents[1], "/overlay/belief/plane", "quaternion")  # it does not change
    np.testing.assert_allclose(
        quaternion.act(turn / np.linalg.norm(turn), UP), NORMAL, atol=1e-4
    )  # the page has steps of it
    assert not any(each["path"].startswith("/overlay/belief") for each in contents[0]["commands"])


def test_cones_stand_along_the_normal_and_warn_at_the_same_times(
    contents: tuple[dict[str, Any], dict[str, Any]], pushed_run: Run
) -> None:
    for name in pushed_run.log.contact_frames:
        turn = placed(contents[1], f"/overlay/cones/cones/{name}", "quaternion")
        np.testing.assert_allclose(quaternion.act(turn / np.linalg.norm(turn), UP), NORMAL, atol=1e-4)
    level, slope = (
        [
            (clip["path"], track["times"], track["values"])
            for clip in content["animations"]
            if "/cones/" in clip["path"]
            for track in clip["clip"]["tracks"]
            if track["name"] == ".visible"
        ]
        for content in contents
    )
    assert level and level == slope


def test_the_centre_of_mass_is_projected_down_to_the_ground(contents: tuple[dict[str, Any], dict[str, Any]]) -> None:
    times = np.linspace(0.1, 1.0, 10)
    ball, spot = (at(contents[1], f"/overlay/com/com/{each}", ".position", times) for each in ("ball", "floor"))
    above = SLOPE.distance(spot)[0]
    assert 0.001 < above.min() and above.max() < 0.003  # it is drawn over the floor
    np.testing.assert_allclose((spot - above[:, None] * NORMAL)[:, :2], ball[:, :2], atol=1e-4)


def test_the_camera_climbs_with_the_ground_and_does_not_heave() -> None:
    along = np.linspace(0.0, 5.0, 11)[:, None] * [1.0, 0.0, 0.0]
    corners = np.array([-0.3, -0.2, 1.3]), np.array([0.3, 0.2, 1.7])
    heave = 0.02 * np.sin(np.arange(11.0))[:, None] * UP
    travel = along + SLOPE.height(along[:, :2])[:, None] * UP + heave
    camera = frame_camera(*corners, travel, np.zeros((0, 3)), SLOPE)
    assert camera["floor"] == pytest.approx(1.3)
    climb = np.column_stack((along[:, 0], math.tan(TILT) * along[:, 0], np.zeros(11)))  # the viewer has y up
    np.testing.assert_allclose(np.array(camera["follow"]), climb, atol=1e-4)


def test_rotations_take_the_z_axis_to_their_directions() -> None:
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions[:2] = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    turns = turns_to(directions)
    np.testing.assert_allclose(quaternion.act(turns, UP), directions, atol=1e-9)
    np.testing.assert_array_equal(turns[0], [0.0, 0.0, 0.0, 1.0])


def corners_of(boxes: list[Box]) -> np.ndarray:
    return np.concatenate([each.corners for each in boxes])


def test_boxes_are_drawn_where_they_are() -> None:
    """Every corner of every box, in one object for each colour; slippery ones in the second."""
    boxes = [Box((0.3 * i, 0.0, 0.0), (0.1, 0.2, 0.05 * i + 0.05), coefficient=0.1 if i > 2 else 0.6) for i in range(5)]
    scene = Scene()
    add_stage(scene, np.zeros(3), np.ones(3), np.zeros((1, 3)), World((Plane(), *boxes)))
    commands = content_of(page_of("page", scene, {}))["commands"]
    drawn = {each["path"]: each for each in commands if each["path"].startswith("/ground")}
    assert [*drawn] == ["/ground/boxes", "/ground/boxes edges", "/ground/slippery", "/ground/slippery edges"]
    for path, chosen in (("/ground/boxes", boxes[:3]), ("/ground/slippery", boxes[3:])):
        vertices = drawn[path]["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].reshape(-1, 3)
        found, corners = (np.unique(np.round(each, 5), axis=0) for each in (vertices, corners_of(chosen)))
        np.testing.assert_allclose(found, corners, atol=1e-5)


def test_the_camera_does_not_jump_on_steps() -> None:
    steps = [Box((0.25 * k + 5.0, 0.0, 0.0), (5.0, 2.0, 0.05 * k)) for k in range(1, 9)]
    along = np.linspace(0.0, 2.0, 161)[:, None] * [1.0, 0.0, 0.0]
    corners = np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.4])
    camera = frame_camera(*corners, along, np.zeros((0, 3)), World((Plane(), *steps)))
    rise = np.array(camera["follow"])[:, 1]
    assert rise[-1] - rise[0] > 0.3 and np.abs(np.diff(rise)).max() < 0.006


def test_cones_have_the_friction_of_their_surface(solo12: Robot, pushed_run: Run) -> None:
    """Two feet on ice: their cones are narrow, those of the others wide, and the legend says from where to where."""
    log = pushed_run.log
    friction = np.tile([0.6, 0.6, 0.1, 0.1], (log.ticks, 1))
    content = content_of(replay_page(solo12, replace(pushed_run, log=replace(log, contact_friction=friction))))
    assert "0.1 to 0.6" in str(content["legend"])
    shown = {
        clip["path"]: any(
            any(np.array(track["values"]).ravel()) for track in clip["clip"]["tracks"] if ".vis" in track["name"]
        )
        for clip in content["animations"]
        if clip["path"].startswith("/overlay/cones/cones/")
    }
    sizes = (0.6, 0.6, 0.1, 0.1)
    seen = [
        {each for each in (0.1, 0.6) if shown[f"/overlay/cones/cones/{name}/{each:g}"]} for name in log.contact_frames
    ]
    assert all(found <= {own} for found, own in zip(seen, sizes, strict=True)) and {0.6} in seen and {0.1} in seen
