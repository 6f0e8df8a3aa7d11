from __future__ import annotations

import base64
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from lgmpc.errors import InputError, RunFolderError
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.runs import Outcome, Verdict
from lgmpc.viz.page import open_page, write_page
from lgmpc.viz.replay import replay_page

from .test_scene import unpack


@pytest.fixture(scope="module")
def page(solo12, pushed_run) -> str:
    return replay_page(solo12, pushed_run)


def content_of(page: str) -> dict:
    payload = re.search(r'<script id="payload"[^>]*>([^<]*)</script>', page)
    assert payload is not None
    return unpack(base64.b64decode(payload.group(1)))


def test_the_page_is_one_file_of_moderate_size(page) -> None:
    assert len(page) < 3e6
    assert not re.search(r"""<(script|link|img|iframe)[^>]+(src|href)=""", page)
    assert "@import" not in page and "url(http" not in page


def test_the_page_describes_the_run(page, pushed_run) -> None:
    content = content_of(page)
    assert content["name"] == "solo12_pushed"
    assert content["verdict"] == "pass"
    assert ["max displacement", f"{1e3 * pushed_run.result.metrics.max_displacement_m:.3g} mm"] in content["facts"]
    (push,) = content["pushes"]
    assert push["impulse"] == "1 N·s"
    assert push["label"] == "push 5 N for 0.2 s"
    assert (push["start"], push["end"]) == pytest.approx((0.3, 0.5), abs=0.0021)
    moved, tilt = content["series"]["curves"]
    assert (moved["label"], tilt["label"]) == ("moved", "tilt")
    assert max(moved["values"]) == pytest.approx(1e3 * pushed_run.result.metrics.max_displacement_m, abs=0.05)
    labels = [entry["label"] for entry in content["legend"]]
    assert "contact forces" in labels and "predicted path" in labels and "push" in labels


def test_the_pages_title_cannot_become_markup(solo12, pushed_run) -> None:
    name = "</title></script><script>alert(1)</script>"
    result = replace(pushed_run.result, name=name, verdict=Verdict(Outcome.FAIL, (name,)))
    page = replay_page(solo12, replace(pushed_run, result=result))
    assert "alert(1)</script>" not in page
    assert content_of(page)["reasons"] == [name]


def test_a_run_that_blew_up_is_shown_up_to_there(solo12, pushed_run) -> None:
    log = pushed_run.log
    arrays = {name: getattr(log, name).copy() for name in ("q", "v", "com", "contact_forces", "contact_points")}
    for array in arrays.values():
        array[300:] = np.nan
    page = replay_page(solo12, replace(pushed_run, log=replace(log, **arrays)))
    assert content_of(page)["duration"] == pytest.approx(log.time[299] - log.time[0])


def test_a_robot_that_begins_low_is_in_the_picture_when_it_stands(solo12, pushed_run) -> None:
    def top(page: str) -> float:
        """Height of the picture's upper edge at the camera's target, m (axes of the viewer: y up)."""
        camera = content_of(page)["camera"]
        away = np.linalg.norm(np.subtract(camera["position"], camera["target"]))
        return camera["target"][1] + away * np.tan(np.radians(0.5 * camera["fov"]))

    log = pushed_run.log
    q = log.q.copy()
    q[log.time < 0.2, 2] -= 0.15
    rising = replace(pushed_run, log=replace(log, q=q))
    standing, risen = top(replay_page(solo12, pushed_run)), top(replay_page(solo12, rising))
    assert risen > standing - 0.05


def test_a_run_without_figures_is_shown(solo12, pushed_run) -> None:
    result = replace(pushed_run.result, metrics=None, verdict=Verdict(Outcome.INTERRUPTED, ("interrupted",)))
    assert content_of(replay_page(solo12, replace(pushed_run, result=result)))["facts"] == []


def test_a_run_of_one_tick_is_a_picture(solo12, pushed_run) -> None:
    page = replay_page(solo12, replace(pushed_run, log=pushed_run.log.until(1)))
    assert content_of(page)["animations"] == []


def test_a_run_of_another_robot_or_of_nothing_is_refused(solo12, pushed_run) -> None:
    with pytest.raises(InputError, match=r"nq = 19.*a run of panda"):
        replay_page(load_robot(RobotSpec(model="panda", effort_limit_nm=80.0, velocity_limit_rad_s=2.0)), pushed_run)
    log = replace(pushed_run.log, q=np.full_like(pushed_run.log.q, np.nan))
    with pytest.raises(InputError, match="none finite"):
        replay_page(solo12, replace(pushed_run, log=log))


def test_the_page_is_written_whole_or_not_at_all(tmp_path, monkeypatch) -> None:
    file = write_page("<html>first</html>", tmp_path / "replay.html")
    with pytest.raises(RunFolderError, match="no such file"):
        write_page("x", tmp_path / "nowhere" / "replay.html")

    def interrupted(descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_page("<html>second</html>", file)
    assert file.read_text(encoding="utf-8") == "<html>first</html>"
    assert [child.name for child in tmp_path.iterdir()] == ["replay.html"]


def test_a_page_is_opened_where_there_is_a_desktop(tmp_path, monkeypatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    file = write_page("<html>", tmp_path / "a page.html")
    open_page(file)
    monkeypatch.setenv("DISPLAY", ":0")
    open_page(file)
    assert opened == [f"file://{tmp_path}/a%20page.html"]
