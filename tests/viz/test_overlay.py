from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lgmpc.viz.marks import Scale
from lgmpc.viz.overlay import Frames, add_overlay
from lgmpc.viz.scene import Scene
from lgmpc.world import World

from .conftest import PUSH_END, PUSH_FORCE, PUSH_START
from .test_scene import tracks, unpack

HALF_SIDES = np.array([0.2, 0.1, 0.04])


def overlay(log):
    scene, frames, scale = Scene(), Frames.of(log), Scale(0.1, 5.0)
    add_overlay(scene, log, frames, scale, World(), 0.3, HALF_SIDES)
    return unpack(scene.pack({})), frames, scale


def shown(content, path: str, times: np.ndarray) -> np.ndarray:
    track = tracks(content, path)[".visible"]
    return np.array(track["values"])[np.searchsorted(track["times"], times, side="right") - 1]


def at(content, path: str, name: str, times: np.ndarray) -> np.ndarray:
    track = tracks(content, path)[name]
    values = track["values"].reshape(len(track["times"]), -1)
    return np.column_stack([np.interp(times, track["times"], column) for column in values.T])


def test_pictures_cover_the_log_evenly(pushed_log) -> None:
    frames = Frames.of(pushed_log)
    assert (frames.times[0], frames.ticks[-1]) == (0.0, pushed_log.ticks - 1)
    assert np.all(np.abs(np.diff(frames.times) - 0.02) < 0.0021)
    few = Frames.of(pushed_log, limit=10)
    assert len(few.times) == 10


def test_pictures_end_before_what_is_not_finite(pushed_log) -> None:
    q = pushed_log.q.copy()
    q[600:] = np.nan
    frames = Frames.of(replace(pushed_log, q=q))
    assert frames.ticks[-1] == 599


def test_a_picture_shows_the_mean_until_the_next(pushed_log) -> None:
    frames = Frames.of(pushed_log)
    mean = frames.mean(pushed_log.contact_forces)
    assert mean.shape == (len(frames.times), 4, 3)
    np.testing.assert_allclose(mean[3], pushed_log.contact_forces[frames.ticks[3] : frames.ticks[4]].mean(axis=0))


@pytest.mark.parametrize(
    ("height", "weight", "contacts", "length", "newtons"),
    [(0.27, 24.5, 4, 0.1, 5.0), (1.7, 930.0, 2, 0.8, 500.0), (0.5, 300.0, 4, 0.2, 100.0), (0.3, 5.0, 0, 0.1, 5.0)],
)
def test_scales_are_round_and_fit_the_robot(height, weight, contacts, length, newtons) -> None:
    scale = Scale.of(height, weight, contacts)
    assert (scale.length, scale.newtons) == pytest.approx((length, newtons))
    assert scale.metres_per_newton == pytest.approx(length / newtons)


def test_the_push_is_shown_while_it_lasts_and_ends_outside_the_trunk(pushed_log) -> None:
    content, frames, scale = overlay(pushed_log)
    active = (frames.times >= PUSH_START) & (frames.times < PUSH_END)
    np.testing.assert_array_equal(shown(content, "/overlay/push/force", frames.times), active)
    pushed = frames.times[active]
    tail = at(content, "/overlay/push/force", ".position", pushed)
    tip = tail + scale.metres_per_newton * PUSH_FORCE
    gap = pushed_log.push_point[frames.ticks[active]] - tip
    # Pushed along +y: the arrow stands on the robot's right and stops just outside its trunk.
    assert np.all(np.abs(gap[:, 1] - HALF_SIDES[1]) < 0.02)
    np.testing.assert_allclose(gap[:, 0], 0.0, atol=1e-4)


def test_forces_stand_on_their_feet_and_have_their_length(pushed_log) -> None:
    content, frames, scale = overlay(pushed_log)
    times = frames.times[5:-5]
    force = frames.mean(pushed_log.contact_forces)[5:-5]
    for k, name in enumerate(pushed_log.contact_frames):
        tip = at(content, f"/overlay/forces/{name}/head", ".position", times)[:, 2]
        expected = scale.metres_per_newton * np.linalg.norm(force[:, k], axis=1)
        np.testing.assert_allclose(tip, expected, atol=3e-5)
        tail = at(content, f"/overlay/forces/{name}", ".position", times)
        np.testing.assert_allclose(tail, pushed_log.contact_points[frames.ticks[5:-5], k], atol=3e-5)


def test_a_cone_warns_exactly_when_its_force_is_near_its_surface(pushed_log) -> None:
    forces = np.tile([0.0, 0.0, 6.0], (pushed_log.ticks, 4, 1))
    forces[400:600, 2] = [2.0, 2.7, 6.0]  # 3.36 of 3.6 N
    forces[800:, 2] = 0.0
    content, frames, _ = overlay(replace(pushed_log, contact_forces=forces))
    name = pushed_log.contact_frames[2]
    ok = shown(content, f"/overlay/cones/cones/{name}", frames.times)
    warns = shown(content, f"/overlay/cones/slipping/{name}", frames.times)
    near, closed = (forces[frames.ticks, 2, 0] > 0.0), forces[frames.ticks, 2, 2] > 0.0
    # A picture stands for the time until the next one, so it may change one picture early.
    inner = np.ones(len(near), dtype=bool)
    inner[:-1] = (near[:-1] == near[1:]) & (closed[:-1] == closed[1:])
    np.testing.assert_array_equal(warns[inner], (near & closed)[inner])
    np.testing.assert_array_equal(ok[inner], (closed & ~near)[inner])


def test_the_prediction_is_the_latest_one(pushed_log) -> None:
    content, frames, _ = overlay(pushed_log)
    for node in (0, 7, 20):
        beads = at(content, f"/overlay/horizon/{node:02d}", ".position", frames.times)
        latest = np.searchsorted(pushed_log.mpc_time, pushed_log.time[frames.ticks], side="right") - 1
        np.testing.assert_allclose(beads, pushed_log.mpc_horizon_com[latest, node], atol=3e-5)


def test_a_prediction_is_gone_when_no_new_one_follows(pushed_log) -> None:
    """After a fall, the last plan is no valid prediction."""
    kept = pushed_log.mpc_time < 0.5
    arrays = {
        name: getattr(pushed_log, name)[kept]
        for name in ("mpc_time", "mpc_horizon_com", "mpc_forces", "mpc_status", "mpc_ms")
    }
    content, frames, _ = overlay(replace(pushed_log, **arrays))
    visible = shown(content, "/overlay/horizon/00", frames.times)
    np.testing.assert_array_equal(visible, pushed_log.time[frames.ticks] < 0.5)


def test_a_hidden_arrow_does_not_move(pushed_log) -> None:
    """Poses are interpolated between pictures: the end of a push must not move its arrow to the origin."""
    log = replace(pushed_log, push_point=np.where(pushed_log.push[:, 1:2] != 0.0, pushed_log.push_point, 0.0))
    content, frames, _ = overlay(log)
    visible = shown(content, "/overlay/push/force", frames.times)
    last = np.flatnonzero(visible)[-1]
    assert not visible[last + 1]
    tail = at(content, "/overlay/push/force", ".position", frames.times)
    np.testing.assert_allclose(tail[last + 1 :], np.tile(tail[last], (len(tail) - last - 1, 1)), atol=1e-9)


def test_without_mpc_and_push_their_overlays_are_absent(pushed_log) -> None:
    bare = replace(
        pushed_log,
        push=np.zeros_like(pushed_log.push),
        mpc_time=np.zeros(0),
        mpc_horizon_com=np.zeros((0, 1, 3)),
        mpc_forces=np.zeros((0, 4, 3)),
        mpc_status=np.zeros(0, dtype=np.int8),
        mpc_ms=np.zeros(0),
    )
    content, _, _ = overlay(bare)
    paths = [command["path"] for command in content["commands"]]
    assert any(path.startswith("/overlay/com") for path in paths)
    assert not any(path.startswith(("/overlay/push", "/overlay/horizon")) for path in paths)


def test_a_target_that_is_unknown_is_hidden(pushed_log) -> None:
    reference = pushed_log.com_reference.copy()
    reference[:500] = np.nan
    content, frames, _ = overlay(replace(pushed_log, com_reference=reference))
    known = np.isfinite(reference[frames.ticks, 0])
    np.testing.assert_array_equal(shown(content, "/overlay/com/target/ball", frames.times), known)


def test_cones_are_as_wide_as_the_floor_allowed_at_the_time(pushed_log) -> None:
    forces = np.tile([2.0, 0.0, 6.0], (pushed_log.ticks, 4, 1))
    floor = np.where(np.arange(pushed_log.ticks) < 500, 0.6, 0.3)
    limits = {"floor_friction": floor, "torque_limits": pushed_log.effort_limit_over_time}
    content, frames, _ = overlay(replace(pushed_log, contact_forces=forces, **limits))
    name, slippery = pushed_log.contact_frames[0], floor[frames.ticks] == 0.3
    inner = np.append(slippery[:-1] == slippery[1:], True)
    ok = shown(content, f"/overlay/cones/cones/{name}/0.6", frames.times)
    warns = shown(content, f"/overlay/cones/slipping/{name}/0.3", frames.times)
    np.testing.assert_array_equal(ok[inner], ~slippery[inner])
    np.testing.assert_array_equal(warns[inner], slippery[inner])
