"""What objects print, and what notebooks display: replays embedded by ``lgmpc.show``, figures."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rigid_body import RigidBody, RigidBodyAction

import lgmpc
from lgmpc.runs import RunFolder
from lgmpc.viz.page import frame_of, in_notebook


def test_settings_show_what_is_not_a_default() -> None:
    config = lgmpc.load_config("solo12_balance").replace({"mpc.nodes": 15, "plant.friction": 0.6})
    shown = repr(config)
    assert shown.startswith("Config(") and "mpc.nodes=15" in shown and "pushes=3 entries" in shown
    assert "plant.friction" not in shown  # given, but the default
    assert "mpc=" in repr(config.replace({"mpc": {"model": "full_body"}}))
    assert repr(lgmpc.GaitSettings(pattern="trot")) == "GaitSettings(pattern=trot)"
    assert repr(lgmpc.config.Config.model_fields["mpc"].default) == "CentroidalMpcSettings()"


def test_scenarios_and_problems_show_robot_and_horizon() -> None:
    body = RigidBody(1.0, np.diag([0.1, 0.2, 0.3]))
    robot = lgmpc.load_robot(lgmpc.load_config("solo12_stand").robot)
    problem = lgmpc.ShootingProblem(RigidBodyAction("hover", body, [lgmpc.CostItem("effort", lgmpc.Control(6))]), 4)
    assert repr(problem) == "<ShootingProblem of 4 intervals: nx = 13, ndx = 12, nu = 6; 4 x hover; terminal hover>"
    guess = lgmpc.Trajectory(np.tile(problem.x0, (5, 1)), np.zeros((4, 6)))
    scenario = lgmpc.Scenario("hop", robot, problem, guess, np.full(4, 0.1), lambda _: {})
    assert repr(scenario) == f"<Scenario hop: solo12, 0.4 s, targets: none, {problem!r}>"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> object:
    config = lgmpc.load_config("solo12_stand", ["duration_s=0.1", "gate={max_tilt_deg: 1.0}"])
    return lgmpc.run_config(config, tmp_path_factory.mktemp("runs"))


def test_a_run_shows_its_verdict_before_and_after_loading(run: lgmpc.config.execution.FinishedRun) -> None:
    shown = repr(run.result)
    assert shown.startswith("<PASS solo12_stand: survived 0.1 s, max tilt ") and " deg" in shown
    assert shown in repr(run) and shown in repr(RunFolder.load(run.folder.path))
    failed = replace(run.result, verdict=lgmpc.runs.Verdict(lgmpc.runs.Outcome.FAIL, ("it fell",)))
    assert repr(failed).startswith("<FAIL ") and repr(failed).endswith(">\n  - it fell")
    assert "array(" not in repr(run)


def test_objects_print_in_a_few_lines(run: lgmpc.config.execution.FinishedRun) -> None:
    config = lgmpc.load_config("solo12_velocity", ["mpc.nodes=15"])
    shown = repr(config)
    assert shown == str(config) and shown.startswith("Config(name=solo12_velocity, robot.model=solo12, ")
    assert "mpc.nodes=15" in shown and "plant.rate_hz" not in shown, "defaults are not shown"
    robot = lgmpc.load_robot(config.robot)
    assert repr(robot).startswith("<Robot solo12: 2.500 kg, free base, 12 joints, FL_FOOT, ")
    log = run.session.log
    assert repr(log).startswith(f"RunLog of {log.ticks} ticks, 0 to ")
    for value in (config, robot, log, lgmpc.Trajectory(np.zeros((100, 37)), np.zeros((99, 12)))):
        assert len(repr(value)) < 1500 and repr(value).count("\n") < 15


def test_outside_a_notebook_nothing_is_embedded() -> None:
    assert not in_notebook()


def test_a_frame_contains_the_page_as_it_is() -> None:
    page = '<!DOCTYPE html><p title="a">x < y & z</p>'
    parser = HTMLParser()
    found: dict[str, str | None] = {}
    parser.handle_starttag = lambda tag, attrs: found.update(attrs)  # type: ignore[method-assign]
    parser.feed(frame_of(page, height=300))
    assert found["srcdoc"] == page
    assert "height:300px" in (found["style"] or "")


KERNEL = """
import nbclient, nbformat
cells = {cells!r}
notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
run, shown, path, plots, figure, page, driven = (cell.outputs for cell in notebook.cells)
*told, text = run  # streams of several messages, and of compilations where the cache is empty
assert "loading the robot" in told[0].text, told
assert "<PASS solo12_stand: survived 4 s" in text.data["text/plain"], text
for (output,) in (shown, path):
    assert output.output_type == "display_data", output
    html = output.data["text/html"]
    assert html.startswith("<div><iframe srcdoc=") and len(html) > 500_000
assert plots[0].data["text/html"].count('<img src="data:image/png;base64,') > 3
assert "image/png" in figure[0].data, figure
assert page[0].data["text/html"].startswith('<div><iframe src="http://127.0.0.1:'), page
served, ended = driven
assert "viser" in served.text.lower(), served
assert "<INTERRUPTED solo12_stand: survived" in ended.data["text/plain"], ended
"""
CELLS = [
    """
import lgmpc
from pathlib import Path
config = lgmpc.load_config("solo12_stand", ["duration_s=4.0", "gate={max_tilt_deg: 1.0}"])
run = lgmpc.run_config(config, notify=print)
run""",
    "run.show()",
    "lgmpc.show(str(run.folder.path))",
    "run.plot()",
    "lgmpc.plot(run)['torques']",
    "page = lgmpc.drive(config)\npage",
    """
import time, urllib.request
print(urllib.request.urlopen(page.url).read(2000).decode())
time.sleep(0.5)
page.close()""",
]


@pytest.mark.docs
@pytest.mark.slow
def test_a_kernel_displays_replays_and_figures(tmp_path: Path) -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    script = KERNEL.format(cells=CELLS)
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
