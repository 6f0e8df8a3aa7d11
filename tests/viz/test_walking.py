"""Figures and replay of steps and commands, compared with the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lgmpc.runs import compute_metrics
from lgmpc.viz import plots
from lgmpc.viz.figure_files import figure_maker
from lgmpc.viz.overlay import SPEED_SHOWN_M_S
from lgmpc.viz.plots import plot_run
from lgmpc.viz.replay import replay_page

from .conftest import FOOTHOLD, SWING_END, SWING_START
from .test_overlay import at, overlay as add_overlays, shown
from .test_plots import only
from .test_replay import content_of

NAMES = ["velocity", "gait", "feet"]
FOOT = 1


@pytest.fixture
def draw(stepping_log):
    def make_figure(name: str, log=stepping_log):
        with figure_maker("a test") as make:
            figure = make()
            assert plots.FIGURES[name](figure, log)
            figure.canvas.draw()
        return figure

    return make_figure


@pytest.fixture
def overlay(stepping_log):
    def add(log=stepping_log):
        return add_overlays(log)

    return add


def test_a_walking_run_has_its_figures_and_a_standing_one_has_not(
    solo12, pushed_run, stepping_log, monkeypatch
) -> None:
    only(monkeypatch, *NAMES)
    assert plot_run(solo12, pushed_run) == {}
    assert list(plot_run(solo12, replace(pushed_run, log=stepping_log))) == NAMES


def test_velocity_is_drawn_against_the_command(draw, stepping_log) -> None:
    for axes, column in zip(draw("velocity").axes, range(3), strict=True):
        curves = {line.get_label(): line for line in axes.lines}
        np.testing.assert_array_equal(curves["limited command"].get_ydata(), stepping_log.command[:, column])
        raw, mean = curves["instantaneous"], curves["mean over a gait cycle"]
        # The mean at a time is that of the instantaneous velocity half a cycle before and after it.
        time, middle = stepping_log.time, float(mean.get_xdata()[300])
        around = np.abs(time - middle) < 0.12
        assert np.mean(raw.get_ydata()[around]) == pytest.approx(mean.get_ydata()[300], abs=1e-9)


def test_the_gait_diagram_has_a_bar_for_each_stance(draw, stepping_log) -> None:
    whole, detail = draw("gait").axes
    rows = [label.get_text() for label in whole.get_yticklabels()]
    assert rows == stepping_log.contact_frames.tolist()[::-1]
    bars = [bar for bar in whole.collections if len(bar.get_paths()) == 2]  # one stance before the swing, one after
    assert bars
    for bar in bars[:1]:
        before, after = (path.vertices[:, 0] for path in bar.get_paths())
        assert before.max() == pytest.approx(SWING_START, abs=0.0021)
        assert after.min() == pytest.approx(SWING_END, abs=0.0021)
    begin, end = detail.get_xlim()
    assert begin < SWING_START < SWING_END < end


def test_contact_states_have_different_colours(draw, stepping_log) -> None:
    states = stepping_log.contact_states.copy()
    states[stepping_log.time > SWING_END, FOOT] = 3  # late, as it would be in the air
    labels = [
        text.get_text()
        for text in draw("gait", replace(stepping_log, contact_states=states)).axes[0].get_legend().texts
    ]
    assert labels == ["stance", "late"]


def test_heights_of_feet_and_their_targets_are_those_of_the_log(draw, stepping_log) -> None:
    figure = draw("feet")
    target, point = figure.axes[FOOT].lines[:2]
    at_swing = (stepping_log.time >= target.get_xdata()[0]) & (stepping_log.time <= target.get_xdata()[-1])
    np.testing.assert_allclose(target.get_ydata(), 1e3 * stepping_log.swing_targets[at_swing, FOOT, 2])
    np.testing.assert_allclose(point.get_ydata(), 1e3 * stepping_log.contact_points[at_swing, FOOT, 2])
    assert np.max(target.get_ydata()) > 25.0


def test_footholds_are_shown_while_the_foot_swings(overlay, stepping_log) -> None:
    content, frames, _ = overlay()
    swinging = (frames.times >= SWING_START - 1e-9) & (frames.times < SWING_END - 1e-9)
    path = f"/overlay/footholds/{stepping_log.contact_frames[FOOT]}"
    assert {each["path"] for each in content["commands"] if "footholds" in each["path"]} == {path}
    np.testing.assert_array_equal(shown(content, path, frames.times), swinging)
    place = at(content, path, ".position", frames.times[swinging])
    standing = stepping_log.contact_points[frames.ticks[swinging], FOOT]
    np.testing.assert_allclose((place - standing)[:, :2], np.tile(FOOTHOLD[:2], (swinging.sum(), 1)), atol=1e-4)


def test_beads_lie_along_the_swing_from_its_beginning_to_its_end(overlay, stepping_log) -> None:
    content, frames, _ = overlay()
    name = stepping_log.contact_frames[FOOT]
    times = frames.times[(frames.times > SWING_START) & (frames.times < SWING_END)]
    beads = np.array([at(content, f"/overlay/swings/{name}/{bead}", ".position", times) for bead in range(9)])
    ticks = np.flatnonzero(stepping_log.stance[:, FOOT] == 0)
    targets = stepping_log.swing_targets[:, FOOT]
    np.testing.assert_allclose(beads[0], np.tile(targets[ticks[0]], (len(times), 1)), atol=1e-4)
    np.testing.assert_allclose(beads[-1], np.tile(targets[ticks[-1]], (len(times), 1)), atol=1e-4)
    assert beads[4, :, 2].min() > 0.025
    after = frames.times[frames.times > SWING_END]
    still = at(content, f"/overlay/swings/{name}/4", ".position", after)
    np.testing.assert_allclose(still, np.tile(beads[4, -1], (len(after), 1)), atol=1e-9)  # hidden, and does not glide
    assert not shown(content, f"/overlay/swings/{name}/4", after).any()


def test_the_command_is_an_arrow_of_its_size_and_direction(overlay, stepping_log) -> None:
    content, frames, scale = overlay()
    visible = shown(content, "/overlay/command/velocity", frames.times)
    np.testing.assert_array_equal(visible, stepping_log.command[frames.ticks].any(axis=1))
    tip = at(content, "/overlay/command/velocity/head", ".position", frames.times[visible])
    assert tip[-1, 2] == pytest.approx(0.5 * scale.length / SPEED_SHOWN_M_S, rel=1e-3)
    x, y, z, w = at(content, "/overlay/command/velocity", ".quaternion", frames.times[visible])[-1]
    direction = np.array([2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)])
    np.testing.assert_allclose(direction, [0.6, 0.8, 0.0], atol=0.02)  # the base hardly turns


def test_a_standing_run_has_no_walking_overlays(overlay, pushed_log) -> None:
    content, _, _ = overlay(pushed_log)
    walking = ("/overlay/footholds", "/overlay/swings", "/overlay/command")
    assert not any(command["path"].startswith(walking) for command in content["commands"])


def test_the_page_contains_the_metrics_of_walking(solo12, pushed_run, stepping_log) -> None:
    metrics = compute_metrics(stepping_log)
    walked = replace(pushed_run, log=stepping_log, result=replace(pushed_run.result, metrics=metrics))
    content = content_of(replay_page(solo12, walked))
    assert {"commanded velocity", "next footholds", "swing paths"} <= {entry["label"] for entry in content["legend"]}
    assert ["steps", "1"] in content["facts"]
    assert content["series"]["curves"][0]["label"] == "speed"
