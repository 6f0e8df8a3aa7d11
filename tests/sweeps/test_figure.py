"""Figures of sweeps."""

from pathlib import Path

import numpy as np
import pytest

import lgmpc.sweeps.report
from lgmpc.sweeps import Ending, Row
from lgmpc.sweeps.report import draw_sweep, sweep_drawing
from lgmpc.sweeps.summary import summarize
from lgmpc.viz.figure_files import draw_figures

from .conftest import Parse


def test_boundaries_are_drawn_around_the_circle(tmp_path: Path, parse: Parse, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep = parse("""
factors:
  - {key: plant.base_com_offset_m, kind: directions, count: 4, size: 0.01}
  - {key: plant.friction, kind: values, values: [0.4, 0.8]}
variants: {a: {}, b: {seed: 1}}
bisect: {key: plant.mass_scale, range: [1.0, 9.0], tolerance: 0.1}
""")
    rows = {p.key: Row(p.key, Ending.PASS, boundary=1.0 + i) for i, p in enumerate(sweep.points)}
    drawn = {}
    write = lgmpc.sweeps.report.boundary_drawing

    def record(curves: dict[str, list[tuple[float, float]]], *rest: object) -> object:
        drawn.update(curves)
        return write(curves, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(lgmpc.sweeps.report, "boundary_drawing", record)
    figure = draw_sweep(sweep, rows, summarize(sweep, rows), tmp_path)
    assert figure is not None
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert list(drawn) == [f"{name}, plant.friction {mu}" for mu in (0.4, 0.8) for name in "ab"]
    assert [value for _, value in drawn["a, plant.friction 0.4"]] == [1.0, 5.0, 9.0, 13.0]
    assert drawn["a, plant.friction 0.4"][1][0] == pytest.approx(1.5707963)


def test_shares_are_drawn_over_levels_and_nothing_without_them(tmp_path: Path, parse: Parse) -> None:
    sweep = parse("factors: [{key: plant.friction, kind: values, values: [0.4, 0.8]}]")
    rows = {p.key: Row(p.key, Ending.PASS) for p in sweep.points}
    figure = draw_sweep(sweep, rows, summarize(sweep, rows), tmp_path)
    assert figure is not None
    assert figure.name == "shares.png"
    assert draw_sweep(sweep, {}, summarize(sweep, {}), tmp_path) is None


def test_shares_of_variants_are_curves_of_their_own(tmp_path: Path, parse: Parse) -> None:
    sweep = parse("""
factors: [{key: plant.friction, kind: values, values: [0.4, 0.8]}]
variants: {a: {}, b: {seed: 1}}
""")
    rows = {p.key: Row(p.key, Ending.FAIL if p.variant == "b" else Ending.PASS) for p in sweep.points}
    del rows[sweep.points[1].key]  # b at 0.4
    drawing = sweep_drawing(sweep, rows, summarize(sweep, rows))
    assert drawing is not None
    figure = draw_figures(dict([drawing]), "")["shares"]
    (axes,) = figure.axes
    curves = {each.get_label(): each.lines[0].get_ydata() for each in axes.containers}
    np.testing.assert_array_equal(curves["a"], [100.0, 100.0])
    np.testing.assert_array_equal(curves["b"], [np.nan, 0.0])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0.4", "0.8"]
