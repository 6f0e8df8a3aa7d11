"""A report in a browser: values at the cursor are the log's, time is shared, curves can be hidden; on a phone too."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgmpc.chromium import find_chromium
from lgmpc.runs import Run
from lgmpc.viz.figure_files import X, Y, svg_figures
from lgmpc.viz.report import figures, report_page, section
from lgmpc.viz.sweep_plots import PassShare, boundary_drawing, share_drawing

browsers = [
    pytest.mark.browser,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium"),
]


def test_the_parts_of_a_figure_are_named_and_its_axes_described() -> None:
    def draw(figure: Any) -> bool:
        first, second = figure.subplots(2, 1, sharex=True)
        time = np.linspace(0.0, 2.0, 50)
        first.plot(time, np.sin(time), color=X, label="a")
        first.plot(time, np.cos(time), color=Y, label="b")
        first.axhline(0.5)
        first.axvspan(0.5, 1.0)
        first.annotate("note", (0.7, 0.9), xycoords=("data", "axes fraction"))
        first.legend()
        second.plot(time, time, color=X, label="a")
        second.plot(time, 2 * time, color=Y, label="b")
        second.set(xlabel="time, s", ylabel="m")
        return True

    svg = svg_figures({"one": draw})["one"]
    first, second = json.loads(re.search(r'data-axes="([^"]*)"', svg)[1].replace("&quot;", '"'))  # type: ignore[index]
    assert (first["kind"], second["kind"], first["zoom"]) == ("time", "time", "xy")
    assert first["names"] == second["names"] == {"0": "a", "1": "b"}
    assert (second["unit"], second["x"]) == ("m", pytest.approx([-0.1, 2.1]))
    left, top, right, bottom = first["box"]
    assert 0 < left < right < 480 and 0 < top < bottom < second["box"][1]
    classes = re.findall(r'<g class="(part [^"]*)"', svg)
    assert sorted(each for each in classes if "@" not in each) == sorted(
        ["part x y c0", "part x y c1"] * 2 + ["part y", "part x"]
    )
    (anchor,) = re.findall(r"part x @([\d.]+),", svg)
    assert float(anchor) == pytest.approx(left + (0.7 + 0.1) / 2.2 * (right - left), abs=0.1)
    assert svg.count('class="key c') == 4


@pytest.fixture(scope="module")
def tab(browser: Any, report_file: Path) -> Iterator[Any]:
    """The report, opened once; tests leave its figures as they were."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(report_file.as_uri())
    yield page
    page.close()
    assert errors == []


def place(tab: Any, name: str, axes: int, across: float, up: float = 0.5) -> tuple[float, float]:
    """Bring axes of a figure into view; return where on the screen shares of their width and height are."""
    figure = tab.locator(f"figure[aria-label={name}]")
    figure.scroll_into_view_if_needed()
    box, size = figure.locator("svg").bounding_box(), figure.locator("svg").get_attribute("viewBox").split()
    left, top, right, bottom = json.loads(figure.locator("svg").get_attribute("data-axes"))[axes]["box"]
    scale = box["width"] / float(size[2])
    return box["x"] + scale * (left + across * (right - left)), box["y"] + scale * (bottom - up * (bottom - top))


def cursor(tab: Any, name: str) -> list[float]:
    """Where the cursor is in the axes of a figure, in the units of the picture."""
    lines = tab.locator(f"figure[aria-label={name}] .cursor")
    return [float(lines.nth(i).get_attribute("x1")) for i in range(lines.count())]


class TestInBrowser:
    pytestmark = browsers

    def test_values_at_the_cursor_are_the_logs_and_all_figures_show_its_time(self, tab: Any, pushed_run: Run) -> None:
        log = pushed_run.log
        tilt = log.tilt_deg
        for share in (0.2, 0.37, 0.6):
            tab.mouse.move(*place(tab, "base", 2, share))
            time, value, unit = re.fullmatch(
                r"([\d.]+) s\n(-?[\d.]+) (.*)", tab.locator("figure[aria-label=base] .note").inner_text()
            ).groups()  # type: ignore[union-attr]
            assert float(time) == pytest.approx(log.time[0] + share * np.ptp(log.time), abs=2e-3)
            assert unit == "deg"
            nearby = tilt[np.abs(log.time - float(time)) < 4e-3]  # two ticks: a pixel is 1.5 ms
            room = 2e-3 * tilt.max()
            assert nearby.min() - room <= float(value) <= nearby.max() + room
        described = json.loads(tab.locator("figure[aria-label=forces] svg").get_attribute("data-axes"))
        expected = [each["box"][0] + 0.6 * (each["box"][2] - each["box"][0]) for each in described]
        assert cursor(tab, "forces") == pytest.approx(expected, abs=1.0)

    def test_a_drag_zooms_all_axes_over_the_time_and_a_double_click_shows_all(self, tab: Any) -> None:
        paths = "figures => figures.flatMap(f => [...f.querySelectorAll('.part path')].map(p => p.getAttribute('d')))"
        read = f"() => ({paths})([...document.querySelectorAll('figure')])"
        parse = "d => d.map(each => each.match(/-?[\\d.]+/g).map(Number))"
        before = tab.evaluate(f"({parse})(({read})())")
        tab.mouse.move(*place(tab, "base", 0, 0.25))
        tab.mouse.down()
        tab.mouse.move(*place(tab, "base", 0, 0.5), steps=4)
        tab.mouse.up()
        tab.mouse.move(*place(tab, "attitude", 0, 0.5))
        shown = tab.locator("figure[aria-label=attitude] .note").inner_text()
        assert float(shown.split()[0]) == pytest.approx(0.375 * 1.2, abs=0.01)
        ticks = "document.querySelector('figure[aria-label=attitude] .xtick').style.display"
        assert tab.evaluate(ticks) == "none"
        tab.mouse.dblclick(*place(tab, "base", 1, 0.9))
        assert tab.evaluate(ticks) == ""
        after = tab.evaluate(f"({parse})(({read})())")
        assert all(np.allclose(a, b, atol=0.02) for a, b in zip(before, after, strict=True))

    def test_a_name_in_the_legend_hides_its_curves_and_their_values(self, tab: Any) -> None:
        key = tab.locator("figure[aria-label=joints] .key[role=button]").first
        name = key.locator("text").text_content()
        curves = tab.locator("figure[aria-label=joints] .part.c0")
        assert curves.count() > 4 and curves.first.is_visible()
        key.scroll_into_view_if_needed()
        key.press("Enter")
        assert curves.first.is_hidden() and curves.last.is_hidden()
        tab.mouse.move(*place(tab, "joints", 0, 0.5))
        note = tab.locator("figure[aria-label=joints] .note")
        assert name not in note.inner_text()
        key.click()
        tab.mouse.move(*place(tab, "joints", 0, 0.5))
        assert name in note.inner_text()

    def test_the_replay_and_the_figures_show_the_same_time(self, tab: Any) -> None:
        tab.click(".replay button")
        frame = tab.frame_locator(".replay iframe")
        frame.locator("#name").wait_for(timeout=30_000)
        tab.wait_for_function("!!document.querySelector('.replay iframe').contentWindow.lgmpc.seek", timeout=30_000)
        tab.mouse.click(*place(tab, "base", 0, 0.5))
        assert float(frame.locator("#now").inner_text()) == pytest.approx(0.6, abs=0.02)
        tab.evaluate("document.querySelector('.replay iframe').contentWindow.lgmpc.seek(0.3)")
        left, _, right, _ = json.loads(tab.locator("figure[aria-label=base] svg").get_attribute("data-axes"))[0]["box"]
        line = "document.querySelector('figure[aria-label=base] .cursor').getAttribute('x1')"
        tab.wait_for_function(f"Math.abs({line} - {left + 0.25 * (right - left)}) < 1")

    @pytest.mark.slow
    def test_a_tap_shows_values_and_paper_no_cursor(self, browser: Any, report_file: Path) -> None:
        tab = browser.new_page(viewport={"width": 420, "height": 800}, has_touch=True)
        tab.goto(report_file.as_uri())
        x, y = place(tab, "torques", 0, 0.4)
        tab.touchscreen.tap(x, y)
        note = tab.locator("figure[aria-label=torques] .note")
        assert "N.m" in note.inner_text()
        tab.emulate_media(media="print")
        assert note.is_hidden() and tab.locator(".cursor").first.is_hidden()
        tab.close()

    @pytest.mark.slow
    def test_the_page_fits_a_phone_and_loads_its_replay(self, browser: Any, report_file: Path) -> None:
        tab = browser.new_page(viewport={"width": 420, "height": 800}, color_scheme="dark")
        errors: list[str] = []
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(report_file.as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") <= 420
        background = tab.evaluate("getComputedStyle(document.body).backgroundColor")
        title = "[...document.querySelectorAll('figure text')].find(each => !each.closest('.xtick, .ytick'))"
        ink = tab.evaluate(f"getComputedStyle({title}).fill")
        assert (background, ink) == ("rgb(18, 23, 28)", "rgb(228, 233, 238)")
        tab.click(".replay button")
        frame = tab.frame_locator(".replay iframe")
        frame.locator("#name").wait_for(timeout=30_000)
        assert frame.locator("#name").inner_text() == "solo12_pushed"
        tab.close()
        assert errors == []

    @pytest.mark.slow
    def test_points_of_a_sweeps_figures_have_their_values(self, browser: Any, tmp_path: Path) -> None:
        curve = [(math.radians(angle), 2.0 + angle / 90) for angle in range(0, 360, 90)]
        drawings = {
            "map": boundary_drawing({"QP": curve}, "largest push"),
            "shares": share_drawing(
                {"friction": {"": [PassShare("0.4", 0.5, 0.3, 0.7), PassShare("0.7", 0.9, 0.8, 1.0)] * 2}}
            ),
        }
        file = tmp_path / "sweep.html"
        page = report_page("sweep", "pass", "", [], [section("Figure", figures(drawings))])
        file.write_text(page, encoding="utf-8")
        tab = browser.new_page(viewport={"width": 1280, "height": 900})
        tab.goto(file.as_uri())
        top = json.loads(tab.locator("figure[aria-label=map] svg").get_attribute("data-axes"))[0]["y"][1]
        tab.mouse.move(*place(tab, "map", 0, 0.5 - 0.5 * 3.0 / top, 0.5))  # to the left
        assert tab.locator("figure[aria-label=map] .note").inner_text() == "QP  3.00 at 90°"
        low, high = json.loads(tab.locator("figure[aria-label=shares] svg").get_attribute("data-axes"))[0]["x"]
        tab.mouse.move(*place(tab, "shares", 0, (1.0 - low) / (high - low), (90.0 + 3.0) / 106.0))
        assert tab.locator("figure[aria-label=shares] .note").inner_text() == "0.7: 90.0 %"
        tab.close()
