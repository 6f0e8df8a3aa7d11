"""Report pages: content, colours that follow the page's, no reference to anything outside."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from lgmpc.robot import Robot
from lgmpc.runs import Gate, Outcome, Run, Verdict
from lgmpc.runs.forensics import explain_run
from lgmpc.viz import plots, run_report
from lgmpc.viz.figure_files import INK, svg_figures
from lgmpc.viz.report import code, figures, folded, report_page, section, table, words

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Outline(HTMLParser):
    """The tags of a page, checked to be closed in order, and its text outside of scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.references: list[str] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self.open):
            self.text.append(data)


def test_every_block_is_in_the_page_and_nothing_of_it_is_markup() -> None:
    evil = "<b>&\"'"
    blocks = (
        words([evil]),
        table(("a", evil), [("1", evil), ("2", "x")], ["bad", ""]),
        folded(evil, code(f"key: {evil}\n")),
        figures({evil: lambda figure: figure.text(0.5, 0.5, evil) is not None}),
    )
    page = report_page(evil, "fail", evil, [evil], [section(evil, *blocks)])
    outline = Outline(page)
    assert "".join(outline.text).count(evil) == 12
    assert page.count("<b>") == 0
    assert '<tr class="bad"><td>1</td>' in page and "<tr><td>2</td>" in page


def test_figures_follow_the_colours_of_the_page() -> None:
    def draw(figure) -> bool:
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color=INK)
        axes.set_title("a title")
        return True

    drawn = svg_figures({"one": draw, "none": lambda figure: False})
    assert list(drawn) == ["one"]
    svg = drawn["one"]
    assert svg.startswith("<svg") and "viewBox" in svg.partition(">")[0] and "width" not in svg.partition(">")[0]
    assert "stroke: var(--ink)" in svg and INK not in svg
    assert ">a title</text>" in svg and "DejaVu" not in svg
    assert "#ffffff" not in svg  # no white background


def test_the_report_of_a_run_is_whole_and_self_contained(report_file: Path) -> None:
    text = report_file.read_text(encoding="utf-8")
    outline = Outline(text)
    words = " ".join(outline.text)
    for part in ("solo12_pushed", "Events", "push of 1 N.s [0, 1, 0]", "tilt / deg", "name: solo12_pushed", "numpy"):
        assert part in words
    assert text.count("<svg") == 7
    assert all(each.startswith("#") for each in outline.references)
    used = set(re.findall(r"url\(#([^)$]+)\)", text)) | {each[1:] for each in outline.references}
    assert used <= set(re.findall(r'id="([^"]+)"', text))


def test_a_reason_is_told_once(solo12: Robot, pushed_run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The summary of a run that broke a limit on a figure of the whole run is its reason."""
    monkeypatch.setattr(plots, "FIGURES", {})
    verdict = Verdict(Outcome.FAIL, ("a joint was at its torque limit too often",))
    run = replace(pushed_run, result=replace(pushed_run.result, verdict=verdict))
    page = run_report(solo12, run, Gate().limits, explain_run(run, Gate()))
    head = page[page.index("<header>") : page.index("</header>")]
    assert head.count("a joint was at its torque limit too often") == 1


def test_a_report_begins_with_verdict_replay_and_figures(report_file: Path) -> None:
    titles = re.findall(r"<h2>([^<]*)</h2>", report_file.read_text(encoding="utf-8"))
    assert titles[:4] == ["Replay", "Figures of merit", "Figures", "Events"]
