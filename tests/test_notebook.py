"""What notebooks display: tables of objects, and replays embedded by ``lgmpc.show``."""

from __future__ import annotations

import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rigid_body import RigidBody, RigidBodyAction

import lgmpc
from lgmpc.notebook import bar_html, html_table, in_notebook, reports
from lgmpc.runs import RunFolder
from lgmpc.viz.page import frame_of


class _Cells(HTMLParser):
    """Collects the text of every cell and checks that every tag is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.cells[-1] += data


def cells(value: object) -> list[str]:
    """Return the texts of the cells of what a notebook displays."""
    parser = _Cells()
    parser.feed(value if isinstance(value, str) else value._repr_html_())  # type: ignore[attr-defined]
    assert parser.open == []
    return parser.cells


def test_a_table_shows_text_as_it_is() -> None:
    assert cells(html_table("a < b", [("<script>", "x & y"), ("n", 3)])) == ["a < b", "<script>", "x & y", "n", "3"]


def test_settings_show_what_is_not_a_default() -> None:
    config = lgmpc.load_config("solo12_balance").replace({"mpc.nodes": 15, "plant.friction": 0.6})
    shown = cells(config)
    rows = dict(zip(shown[1::2], shown[2::2], strict=True))
    assert shown[0] == "Config"
    assert rows["mpc.nodes"] == "15" and rows["robot.model"] == "solo12" and rows["pushes"] == "3 entries"
    assert rows["robot.position_limit_rad"].startswith("{")  # a table by joint is one value
    assert "plant.friction" not in rows  # given, but the default
    assert max(map(len, rows.values())) <= 83
    other = config.replace({"mpc": {"model": "full_body"}})
    assert "mpc" in dict(zip(*[iter(cells(other)[1:])] * 2, strict=True))
    assert cells(lgmpc.GaitSettings(pattern="trot")) == ["GaitSettings", "pattern", "trot"]
    assert cells(lgmpc.config.Config.model_fields["mpc"].default) == [
        "CentroidalMpcSettings",
        "all values",
        "defaults",
    ]


def test_a_scenario_shows_robot_and_horizon() -> None:
    body = RigidBody(1.0, np.diag([0.1, 0.2, 0.3]))
    robot = lgmpc.load_robot(lgmpc.load_config("solo12_stand").robot)
    problem = lgmpc.ShootingProblem(RigidBodyAction("hover", body, [lgmpc.CostItem("effort", lgmpc.Control(6))]), 4)
    guess = lgmpc.Trajectory(np.tile(problem.x0, (5, 1)), np.zeros((4, 6)))
    shown = cells(lgmpc.Scenario("hop", robot, problem, guess, np.full(4, 0.1), lambda _: {}))
    rows = dict(zip(shown[1::2], shown[2::2], strict=True))
    assert shown[0] == "hop" and rows["robot"] == "solo12" and rows["intervals"] == "4, 0.4 s"


def test_a_robot_shows_mass_feet_and_limits() -> None:
    shown = cells(lgmpc.load_robot(lgmpc.load_config("solo12_stand").robot))
    assert shown[0] == "solo12"
    assert {"2.500 kg", "FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT", "1.8 N.m", "30 rad/s"} <= set(shown)


def test_a_problem_and_its_solution_show_their_size_and_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", "0")  # five nodes: less than compiling takes
    body = RigidBody(1.0, np.diag([0.1, 0.2, 0.3]))
    effort = lgmpc.CostItem("effort", lgmpc.Control(6), 0.1)
    problem = lgmpc.ShootingProblem(RigidBodyAction("hover", body, [effort]), 5)
    problem.set("duration", 0.1)
    shown = cells(problem)
    assert dict(zip(shown[1::2], shown[2::2], strict=True))["actions"] == "5 x hover"
    solution = lgmpc.Fddp(problem).solve()
    shown = cells(solution)
    rows = dict(zip(shown[1::2], shown[2::2], strict=True))
    assert (rows["status"], rows["iterations"]) == ("converged", str(solution.iterations))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> object:
    config = lgmpc.load_config("solo12_stand", ["duration_s=0.1", "gate={max_tilt_deg: 1.0}"])
    return lgmpc.run_config(config, tmp_path_factory.mktemp("runs"))


def test_a_run_shows_its_verdict_and_folder_before_and_after_loading(run: lgmpc.config.execution.FinishedRun) -> None:
    shown = cells(run)
    rows = dict(zip(shown[1::2], shown[2::2], strict=True))
    assert rows["verdict"] == "PASS" and rows["folder"] == str(run.folder.path)
    assert float(rows["max tilt / deg"].lstrip("< ")) < 1.0
    assert cells(RunFolder.load(run.folder.path)) == shown
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


@pytest.mark.parametrize(
    ("fraction", "running", "expected"),
    [
        (0.25, True, 'value="0.250"'),
        (1.7, False, 'value="1.000"'),
        (None, True, '<progress max="1" style'),  # indeterminate
        (None, False, "<div><small>"),
    ],
)
def test_a_bar_shows_the_fraction_that_is_done(fraction: float | None, running: bool, expected: str) -> None:
    shown = bar_html(fraction, "a < b", running=running)
    assert expected in shown and "a &lt; b" in shown


def test_outside_a_notebook_reports_are_the_given_ones_or_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[object] = []
    with reports(heard.append, None, lambda now: (None, "")) as (announce, advance):
        announce("preparing")
        advance(1.0)
    assert heard == ["preparing"] and capsys.readouterr().out == ""


KERNEL = """
import nbclient, nbformat, re
cells = {cells!r}
notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
updates = []
class Client(nbclient.NotebookClient):
    def process_message(self, msg, cell, cell_index):
        if msg["msg_type"] == "update_display_data":
            updates.append(msg["content"]["data"]["text/html"])
        return super().process_message(msg, cell, cell_index)
Client(notebook, timeout=120, kernel_name="python3").execute()
run, shown, path, plots, figure, solve, sweep, quiet = (cell.outputs for cell in notebook.cells)
bar, table = run
assert bar.output_type == "display_data" and 'value="1.000"' in bar.data["text/html"], bar
assert "4.0 of 4 s simulated" in bar.data["text/html"], bar
assert any(re.search(r'value="0[.](?!000|99)', html) for html in updates), updates
assert "<th" in table.data["text/html"]
for (output,) in (shown, path):
    assert output.output_type == "display_data", output
    html = output.data["text/html"]
    assert html.startswith("<div><iframe srcdoc=") and len(html) > 500_000
assert plots[0].data["text/html"].count('<img src="data:image/png;base64,') > 3
assert "image/png" in figure[0].data, figure
assert re.search(r"<small>[0-9]+ iterations, cost", solve[0].data["text/html"]), solve
assert 'value="1.000"' in sweep[0].data["text/html"] and "2 of 2 points, 0 failed" in sweep[0].data["text/html"], sweep
assert [output.output_type for output in quiet] == ["execute_result"], quiet
"""
CELLS = [
    """
import lgmpc
from pathlib import Path
config = lgmpc.load_config("solo12_stand", ["duration_s=4.0", "gate={max_tilt_deg: 1.0}"])
run = lgmpc.run_config(config)
run""",
    "run.show()",
    "lgmpc.show(str(run.folder.path))",
    "run.plot()",
    "lgmpc.plot(run)['torques']",
    "_ = lgmpc.solve_config(lgmpc.load_solve_config('panda_reach'))",
    """
from lgmpc.sweeps import parse_sweep, run_sweep
text = '''
name: two
base: solo12_stand
set: {duration_s: 0.05}
gate: {max_tilt_deg: 1.0, max_rms_joint_velocity_rad_s: null}
factors: [{key: seed, kind: values, values: [0, 1]}]'''
run_sweep(parse_sweep(text, name='two'), Path("two"), workers=1)""",
    "lgmpc.run_config(config, progress=lambda now: None)",
]


@pytest.mark.docs
@pytest.mark.slow
def test_a_kernel_displays_progress_replays_tables_and_figures(tmp_path: Path) -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    script = KERNEL.format(cells=CELLS)
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
