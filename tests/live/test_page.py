"""The page in a real browser, which drives a run in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest

from lgmpc.chromium import find_chromium
from lgmpc.config import load_config
from lgmpc.runs import Run, load_run

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed: apt-get install chromium"),
]

SIZE = {"width": 800, "height": 480}
GAMEPAD = """
window.pad = {connected: true, axes: [0, 0, 0, 0], buttons: Array.from({length: 4}, () => ({pressed: false}))};
navigator.getGamepads = () => [null, window.pad];
"""
"""A standard gamepad, as a browser reports it."""
TRUNK = (400, 168)
"""Where the trunk is on the page."""
ARM, STOP = 0, 1
"""Buttons of the gamepad."""
PATIENCE = 90_000.0  # ms; the machine may be busy
SUPPORT = Path(__file__).parents[1] / "support"


@contextmanager
def live(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A live run, and the address of its page."""
    own = ["--no-browser", "--port", "0", "--out", str(folder)]
    with process_that_says("page: ", "live", "solo12_velocity", *own, *arguments) as started:
        yield started


@contextmanager
def process_that_says(words: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process of lgmpc, and what follows some words of what it prints."""
    environment = {**os.environ, "PYTHONPATH": str(SUPPORT), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "lgmpc", *arguments]
    begun = monotonic()
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stderr is not None
        line = next(line for line in process.stderr if words in line)
        print(f"{line.strip()} ({monotonic() - begun:.1f} s after the command)")
        yield process, line.partition(words)[2].strip()
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[[str], Any]]:
    """Open the page of an address; it makes no error."""
    problems: list[str] = []
    tabs = []

    def visit(url: str, text: str = "real time") -> Any:
        tab = browser.new_page(viewport=SIZE)
        tab.set_default_timeout(PATIENCE)
        tab.add_init_script(GAMEPAD)
        tab.on("pageerror", lambda error: problems.append(str(error)))
        tab.goto(url)
        tab.wait_for_selector(f"text={text}")
        tabs.append(tab)
        return tab

    yield visit
    for tab in tabs:
        tab.close()
    assert problems == []


def wait_for(tab: Any, pattern: str) -> None:
    """Wait until the page's text matches."""
    tab.wait_for_function("pattern => new RegExp(pattern).test(document.body.innerText)", arg=pattern)


def press(tab: Any, button: int) -> None:
    """Press a button of the gamepad for a moment."""
    for pressed in ("true", "false"):
        tab.evaluate(f"pad.buttons[{button}].pressed = {pressed}")
        tab.wait_for_timeout(200)


def saved_run(process: subprocess.Popen[str], folder: Path) -> Run:
    process.send_signal(signal.SIGINT)
    process.wait(60.0)
    (path,) = folder.iterdir()
    run = load_run(path)
    assert isinstance(run, Run)
    return run


def test_the_page_drives_pushes_and_tunes_the_robot_and_shows_a_failure(
    visit: Callable[[str], Any], tmp_path: Path
) -> None:
    with live(tmp_path, "--set", "wbc.tasks=[own_parts:FailsWhenFast]") as (process, url):
        tab = visit(url)
        wait_for(tab, r"stand · stand")
        tab.mouse.move(*TRUNK)
        tab.mouse.down()
        for step in range(1, 9):
            tab.mouse.move(TRUNK[0] - 8 * step, TRUNK[1])
            tab.wait_for_timeout(50)
        wait_for(tab, r"push \d")
        tab.mouse.up()

        tab.uncheck("text=stop when keys are released")  # each press is a step then
        for _ in range(2):
            tab.keyboard.press("i")
        wait_for(tab, r"locomote[^]*ahead \+0\.(1[6-9]|2)")
        tab.keyboard.press("x")
        wait_for(tab, r"stand · trot")
        tab.check("text=stop when keys are released")
        tab.evaluate("pad.axes[0] = -0.5")
        wait_for(tab, r"locomote[^]*left \+0\.(1[4-9]|2)")
        press(tab, STOP)
        wait_for(tab, r"damp · ")
        tab.evaluate("pad.axes[0] = 0")
        press(tab, ARM)
        wait_for(tab, r"stand · ")
        tab.keyboard.press("Space")
        wait_for(tab, r"damp · ")
        press(tab, ARM)
        wait_for(tab, r"stand · ")

        tab.click("role=tab[name='Settings']")
        tab.click("text=wbc.gains")
        tab.locator("input[value='1600']:visible").first.fill("1200")
        wait_for(tab, r"wbc\.gains\.swing\.kp is 1200")

        tab.click("role=tab[name='Drive']")
        tab.keyboard.down("i")
        wait_for(tab, r"Failed: ended early, at [\d.]+ s: RuntimeError: too fast")
        log = (run := saved_run(process, tmp_path)).log

    config = load_config(run.path / "config.yaml")
    assert [change.set for change in config.changes] == [{"wbc.gains.swing.kp": 1200.0}]
    walked = [entry.velocity_m_s[0] for entry in config.commands if entry.velocity_m_s]
    assert walked[:3] == pytest.approx([0.1, 0.2, 0.0])
    assert walked[-1] == pytest.approx(0.525)
    aside = [entry.velocity_m_s[1] for entry in config.commands if entry.velocity_m_s]
    assert max(aside) == pytest.approx(0.27) and aside[-1] == 0.0
    assert [entry.mode for entry in config.commands if entry.mode] == ["damp", "stand", "damp", "stand"]
    pushed = np.flatnonzero(np.linalg.norm(log.push[:, :3], axis=1) > 1.0)
    assert len(pushed) > 20
    before, during = log.momentum[pushed[0] - 1, :3], log.momentum[pushed[0] : pushed[-1] + 1, :3]
    assert np.linalg.norm(during - before, axis=1).max() / log.mass_kg > 0.02


def test_the_page_arms_drives_and_stops_a_robot_in_another_process(
    visit: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))  # of the secret that both ends share
    served = ["robot", "solo12_velocity_inekf", "--port", "0", "--lock-step", "--set", "duration_s=300", "commands=[]"]
    with process_that_says("waits for a controller at ", *served) as (_, address):
        config = ["--set", "estimator={kind: inekf}", "deployment={silence_s: 30, lost_s: 60}"]
        with live(tmp_path / "runs", "--robot", address, *config) as (process, url):
            tab = visit(url, "disarmed")
            assert tab.locator("text=pause").count() == 0
            tab.click("role=button[name='arm']")
            wait_for(tab, r"stand · [^]*armed")
            tab.keyboard.down("i")
            wait_for(tab, r"locomote[^]*ahead \+0\.[45]")
            tab.keyboard.press("Space")  # the other key is still held
            process.wait(60.0)
            (path,) = (tmp_path / "runs").iterdir()
    run = load_run(path)
    assert isinstance(run, Run)
    assert "emergency stop on the page" in run.result.verdict.reasons[0]
    assert run.log.q[-1, 0] > 0.1


def test_the_death_of_the_viewer_does_not_stop_the_run(tmp_path: Path) -> None:
    with live(tmp_path) as (process, _):
        assert process.stderr is not None
        next(line for line in process.stderr if line.startswith("simulating"))
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        (viewer,) = [each for each in children if "spawn_main" in Path(f"/proc/{each}/cmdline").read_text()]
        os.kill(int(viewer), signal.SIGKILL)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(3.0)
        run = saved_run(process, tmp_path)
    assert run.log.ticks > 0
