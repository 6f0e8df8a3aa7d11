from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.image import imread

from lgmpc.errors import InputError, RunFolderError
from lgmpc.runs import Recorder
from lgmpc.viz import plots
from lgmpc.viz.figure_files import Plots
from lgmpc.viz.plots import plot_run

ORANGE = (213, 94, 0)


def pixels(path) -> np.ndarray:
    return np.round(255.0 * imread(BytesIO(path.read_bytes()))[:, :, :3]).astype(int)


def count(image: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(image - color).max(axis=2) <= 2).sum())


def only(monkeypatch, *names: str) -> None:
    """Draw these figures alone: the others take time and are tested elsewhere."""
    monkeypatch.setattr(plots, "FIGURES", {name: plots.FIGURES[name] for name in names})


@pytest.fixture(scope="module")
def drawn(solo12, pushed_run):
    """The figures of the pushed run."""
    return plot_run(solo12, pushed_run)


@pytest.fixture(scope="module")
def figures(drawn, tmp_path_factory):
    """Their files. Afterwards all positions are settled."""
    return {path.stem: path for path in drawn.save(tmp_path_factory.mktemp("figures"))}


def test_all_figures_are_drawn(figures) -> None:
    assert list(figures) == ["base", "attitude", "com", "joints", "forces", "torques", "timing"]
    for path in figures.values():
        image = pixels(path)
        assert image.shape[0] > 300 and image.shape[1] > 700
        assert 0.01 < np.mean(image.min(axis=2) < 250) < 0.6  # something is drawn, and the page is not full of it


def test_the_push_is_shaded_where_it_was(figures) -> None:
    """From 0.3 to 0.5 of 1.2 s: a sixth of the time axis is shaded, and begins at a quarter of it."""
    image = pixels(figures["base"])
    shade = np.flatnonzero((np.abs(image - (249, 231, 217)).max(axis=2) <= 3).sum(axis=0) > 200)
    spine = np.abs(image - (185, 194, 204)).max(axis=2) <= 3
    axis = np.flatnonzero(spine[np.argmax(spine.sum(axis=1))])
    left, right = axis.min(), axis.max()
    assert (shade.min() - left) / (right - left) == pytest.approx(0.3 / 1.2, abs=0.02)
    assert (shade.max() - left) / (right - left) == pytest.approx(0.5 / 1.2, abs=0.02)


@pytest.mark.parametrize("name", ["torques", "forces", "joints", "attitude", "base"])
def test_labels_of_pushes_are_above_curves_and_limits(drawn, figures, name) -> None:
    labels = [(axes, text) for axes in drawn[name].axes for text in axes.texts if "N.s" in text.get_text()]
    assert labels
    for axes, label in labels:
        lowest = axes.transData.inverted().transform(label.get_window_extent())[0, 1]
        assert lowest > max(np.nanmax(np.asarray(line.get_ydata(), dtype=float)) for line in axes.lines)


def test_the_legend_of_the_timing_is_beside_its_lines(drawn, figures) -> None:
    for axes in drawn["timing"].axes:
        assert not axes.get_legend().get_window_extent().overlaps(axes.get_window_extent())


def test_joints_and_attitude_are_those_of_the_log(drawn, pushed_run) -> None:
    log = pushed_run.log
    position, velocity = drawn["joints"].axes[2:4]
    joint = log.joint_names.tolist().index("HL_HFE")
    (curve,) = (line for line in position.lines if line.get_label() == "HL")
    np.testing.assert_array_equal(curve.get_ydata(), log.q[:, 7 + joint])
    (curve,) = (line for line in velocity.lines if line.get_label() == "HL")
    np.testing.assert_array_equal(curve.get_ydata(), log.v[:, 6 + joint])
    angles, rates = drawn["attitude"].axes
    rolls = [pin.rpy.matrixToRpy(pin.Quaternion(q[3:7]).toRotationMatrix())[0] for q in log.q]
    np.testing.assert_allclose(angles.lines[0].get_ydata(), np.degrees(rolls), atol=1e-9)
    np.testing.assert_array_equal(rates.lines[2].get_ydata(), log.v[:, 5])


def test_limits_are_in_the_warning_colour(figures) -> None:
    assert count(pixels(figures["torques"]), ORANGE) > 500
    assert count(pixels(figures["forces"]), ORANGE) > 200


def test_figures_without_data_are_left_out(solo12, pushed_run, monkeypatch) -> None:
    only(monkeypatch, "forces", "timing")
    empty = np.zeros(0)
    log = replace(
        pushed_run.log,
        mpc_time=empty,
        mpc_horizon_com=np.zeros((0, 1, 3)),
        mpc_forces=np.zeros((0, 4, 3)),
        mpc_status=np.zeros(0, dtype=np.int8),
        mpc_ms=empty,
    )
    names = ("contact_forces", "contact_forces_desired", "contact_points", "contact_normals")
    contacts = {name: np.zeros((log.ticks, 0, 3)) for name in (*names, "swing_targets", "footholds")}
    contacts |= {name: np.zeros((log.ticks, 0), dtype=np.int8) for name in ("stance", "contact_states")}
    contacts["contact_clearance"] = np.zeros((log.ticks, 0))
    bare = replace(log, contact_frames=np.zeros(0, dtype=np.str_), mpc_forces=np.zeros((0, 0, 3)), **contacts)
    # The whole-body ticks were timed; there was no MPC and there are no contacts.
    assert list(plot_run(solo12, replace(pushed_run, log=bare))) == ["timing"]


def test_a_run_that_blew_up_is_drawn(solo12, pushed_run, tmp_path) -> None:
    log = pushed_run.log
    arrays = {name: getattr(log, name).copy() for name in ("q", "v", "com", "tau", "contact_forces")}
    for array in arrays.values():
        array[300:] = np.nan
    plots = plot_run(solo12, replace(pushed_run, log=replace(log, **arrays)))
    assert len(plots) == 7
    assert Plots({"com": plots["com"]}, "").save(tmp_path)[0].stat().st_size > 0


def test_joints_without_a_pattern_share_one_picture(solo12, pushed_run, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "torques")
    names = np.array([f"motor{k}" for k in range(12)])
    (path,) = plot_run(solo12, replace(pushed_run, log=replace(pushed_run.log, joint_names=names))).save(tmp_path)
    assert count(pixels(path), ORANGE) > 200


@pytest.mark.parametrize(("names", "rows"), [("leg{0}_hip leg{0}_knee", 2), ("hip{0} knee{0}", 1)])
def test_joints_of_six_legs_are_told_apart(solo12, pushed_run, monkeypatch, names, rows) -> None:
    only(monkeypatch, "joints", "torques")
    joints = np.array([name for leg in range(6) for name in names.format(leg).split()])
    figures = plot_run(solo12, replace(pushed_run, log=replace(pushed_run.log, joint_names=joints)))
    for name, columns in (("joints", 2), ("torques", 1)):
        figure = figures[name]
        assert len(figure.axes) == rows * columns
        legend = figure.axes[columns - 1].get_legend()
        labels = [text.get_text() for text in legend.get_texts()]
        curves = [line for line in figure.axes[columns - 1].lines if line.get_label() in labels]
        assert len({(line.get_color(), line.get_linestyle()) for line in curves}) == len(labels) == 12 / rows
        figure.canvas.draw()
        assert not any(legend.get_window_extent().overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_errors_of_drawing_and_writing_are_reported(solo12, pushed_run, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "forces")
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(RunFolderError, match="cannot create .*file"):
        plot_run(solo12, pushed_run).save(file)
    empty = Recorder(
        nq=7, nv=6, effort_limit=[], contact_frames=(), friction=1.0, contact_radius=0.0, control_period_s=1.0, ticks=0
    ).log()
    with pytest.raises(InputError, match="0 ticks"):
        plot_run(solo12, replace(pushed_run, log=empty))


def test_the_error_of_an_estimate_is_drawn_where_there_is_one(solo12, pushed_run, tmp_path, monkeypatch) -> None:
    only(monkeypatch, "estimate")
    assert plot_run(solo12, pushed_run) == {}
    log = pushed_run.log
    estimate = {"estimate_q": log.q + 1e-3, "estimate_v": log.v + 1e-2}
    contacts, spent = np.ones((log.ticks, 4), np.int8), np.full(log.ticks, 0.05)
    estimated = replace(log, **estimate, estimate_contacts=contacts, estimate_ms=spent)
    (path,) = plot_run(solo12, replace(pushed_run, log=estimated)).save(tmp_path)
    assert path.stem == "estimate"
    assert 0.01 < np.mean(pixels(path).min(axis=2) < 250) < 0.6


def test_limits_that_changed_are_drawn_as_they_were(solo12, pushed_run, monkeypatch) -> None:
    only(monkeypatch, "forces", "torques")
    log, end = pushed_run.log, pushed_run.log.ticks // 2
    friction = np.where(np.arange(log.ticks) < end, 0.6, 0.3)
    effort = np.where(np.arange(log.ticks)[:, None] < end, 1.8, 1.2) * np.ones_like(log.tau)
    changed = replace(log, friction=0.3, effort_limit=effort[-1].copy(), floor_friction=friction, torque_limits=effort)
    plots = plot_run(solo12, replace(pushed_run, log=changed))
    (cone,) = (line for line in plots["forces"].axes[1].lines if "normal force" in line.get_label())
    np.testing.assert_array_equal(cone.get_ydata(), friction * np.maximum(log.contact_forces[:, 0, 2], 0.0))
    assert cone.get_label() == "0.6, then 0.3 × normal force"
    for axes in plots["torques"].axes:
        dashed = [line.get_ydata() for line in axes.lines if line.get_linestyle() == "--"]
        np.testing.assert_array_equal(dashed, [-effort[:, 0], effort[:, 0]])
        assert [text.get_text() for text in axes.texts if "limit" in text.get_text()] == [
            "limit 1.8 N.m",
            "limit 1.2 N.m",
        ]
