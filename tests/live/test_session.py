"""A live run whose wishes come from the other end of its pipe: the page's part is played by the test."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit

import numpy as np
import pinocchio as pin
import pytest
import viser

from lgmpc.config import Config, load_config
from lgmpc.config.build import prepare
from lgmpc.config.session import stop_signals
from lgmpc.errors import ConfigError, InputError, Interrupted
from lgmpc.live.pad import Axes, Pad
from lgmpc.live.ring import EXTRAS, RingReader
from lgmpc.live.session import LiveRun, Pulls
from lgmpc.live.tuning import Tuner
from lgmpc.live.viewing import Link, Viewing, _serve
from lgmpc.live.wishes import Note, Pace, Pull, Restart, Save, Started, Tune
from lgmpc.locomotion.command import CommandEntry
from lgmpc.runs import Run, load_run
from lgmpc.runs.difference import first_difference


class Player:
    """The far end of a run's pipe, with wishes that are made at given times of the simulation."""

    def __init__(self, config: Config, out: Path) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        self._context = stop_signals()
        self.run = LiveRun(config, Link(theirs), self._context.__enter__(), out, lambda message: None)
        self._script: list[tuple[float, Any]] = []
        self.heard: list[Any] = []
        # As fast as possible: nobody looks on.
        self.run._keep_pace = lambda: None  # type: ignore[method-assign]
        watch = self.run.watch

        def scripted(tick: Any) -> bool:
            while self._script and self._script[0][0] <= tick.sample.time:
                wish = self._script.pop(0)[1]
                self.run._asked_at = -1.0
                wish() if callable(wish) else self.pipe.send(wish)
            return watch(tick)

        self.run._session.watch = scripted

    def play(self, *script: tuple[float, Any]) -> None:
        self._script = list(script)
        self.run.run()

    def messages(self, kind: type) -> list[Any]:
        while self.pipe.poll():
            self.heard.append(self.pipe.recv())
        return [each for each in self.heard if isinstance(each, kind)]

    def close(self) -> None:
        self.run.close()
        self._context.__exit__(None, None, None)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Player]]:
    players: list[Player] = []

    def start(config: Config) -> Player:
        players.append(Player(config, tmp_path))
        return players[-1]

    yield start
    for player in players:
        player.close()


def walk(velocity: float) -> CommandEntry:
    return CommandEntry(at_s=0.0, velocity_m_s=(velocity, 0.0, 0.0), gait="trot")


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def saved(player: Player) -> Run:
    assert player.run.saved is not None
    found = load_run(player.run.saved)
    assert isinstance(found, Run)
    return found


def test_a_driven_run_is_saved_by_ctrl_c_with_its_commands_and_repeats_bit_for_bit(
    start: Callable[..., Player], config: Config
) -> None:
    player = start(config)
    with pytest.raises(Interrupted):
        player.play((0.1, walk(0.4)), (0.9, walk(0.2)), (1.1, interrupt))
    run = saved(player)
    assert run.log.v[-1, 0] > 0.15
    assert json.loads((run.path / "run.json").read_text())["verdict"] == "interrupted"
    again = load_config(run.path / "config.yaml")
    assert [entry.velocity_m_s for entry in again.commands[1:]] == [(0.4, 0.0, 0.0), (0.2, 0.0, 0.0)]
    repeated = prepare(again).run(lambda progress: None).log
    assert first_difference(run.log, repeated, until_s=float(run.log.time[-1])) is None


def test_a_pull_moves_the_base_and_ends(start: Callable[..., Player], config: Config) -> None:
    player = start(config)
    target = np.array([0.0, 0.3, 0.3])
    player.play((0.1, Pull(1, np.zeros(3), target)), (0.3, Pull(0)), (0.6, Save()), (0.61, Restart()))
    log = saved(player).log
    pulled = (log.time > 0.11) & (log.time < 0.3)
    assert (log.push[pulled, 1] > 1.0).all() and not log.push[log.time > 0.302].any()
    assert np.linalg.norm(log.push[:, :3], axis=1).max() <= 2.0 * log.weight_n * 1.001
    assert log.momentum[pulled, 1].max() / log.mass_kg > 0.05


def test_a_setting_changes_in_the_running_controller(start: Callable[..., Player], config: Config) -> None:
    player = start(config)
    task = player.run._session.controller.wbc.tasks["com"]
    player.play(
        (0.1, Tune("wbc.weights.com", (20.0, 20.0, 40.0))), (0.2, Tune("wbc.weights.nonsense", 1.0)),
        (0.3, Tune("locomotion.swing.clearance_m", -1.0)), (0.4, Save()), (0.41, Restart()),
    )  # fmt: skip
    assert player.messages(Tune) == [Tune("wbc.weights.com", (20.0, 20.0, 40.0))]
    assert task.weight.tolist() == [20.0, 20.0, 40.0]
    unknown, negative, _ = player.messages(Note)
    assert unknown.error and "wbc.weights.stance" in unknown.text
    assert negative.error and "clearance_m" in negative.text
    changes = load_config(saved(player).path / "config.yaml").changes
    assert [change.set for change in changes] == [{"wbc.weights.com": [20.0, 20.0, 40.0]}]


def test_an_exception_in_the_controller_ends_the_run_and_is_told(
    start: Callable[..., Player], config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    player = start(config)

    def broken() -> None:
        def solve() -> None:
            player.pipe.send(Save())
            player.pipe.send(Restart("floor"))
            raise ZeroDivisionError("a fault of one's own task")

        player.run._session.controller.wbc.solve = solve  # type: ignore[method-assign,assignment]

    player.play((0.2, broken))
    (ended, _) = player.messages(Note)
    assert ended.error and ended.over and "a fault of one's own task" in ended.text
    assert player.run.after == Restart("floor")
    run = saved(player)
    assert run.result.verdict.reasons[0].startswith("ended early, at 0.2")


def test_time_stands_still_in_a_pause_and_advances_by_steps(start: Callable[..., Player], config: Config) -> None:
    player = start(config)
    (started,) = player.messages(Started)
    width = sum(part.size for part in player.run._session.recorder.rows) + EXTRAS
    reader = RingReader(started.ring, width)
    player.pipe.send(Pace(1.0, paused=True, steps=2))
    times = [-1.0]

    def end_after_two_steps() -> None:
        while times[-1] < 0.0015:
            times.extend(float(row[0]) for row in reader.fresh())
        player.pipe.send(Restart())

    looking = threading.Thread(target=end_after_two_steps)
    looking.start()
    player.play()
    looking.join()
    assert player.run._session.recorder.ticks == 3
    assert sorted(set(times[1:])) == pytest.approx([0.0, 0.001, 0.002])
    reader.close()


def test_every_tunable_key_can_be_set_and_read_back(start: Callable[..., Player], config: Config) -> None:
    controller = start(config).run._session.controller
    tuner = Tuner(config, controller)
    for key, value in tuner.values.items():
        wanted = tuple(1.1 * each for each in value) if isinstance(value, tuple) else min(1.1 * value, 0.9 + value / 10)
        assert tuner.set(key, wanted) == pytest.approx(wanted), key
    assert {key.split(".")[0] for key in tuner.keys} == {"wbc", "mpc", "locomotion"}
    assert controller.feet._swings[0].clearance == tuner.values["locomotion.swing.clearance_m"]
    with pytest.raises(InputError, match=r"wbc\.gains\.com\.kp"):
        tuner.set("wbc.gains.com.kq", 1.0)


def test_without_a_viewer_the_loop_goes_on(start: Callable[..., Player], config: Config) -> None:
    player = start(config)

    def vanish() -> None:
        player.pipe.close()

    with pytest.raises(Interrupted):
        player.play((0.05, walk(0.3)), (0.1, vanish), (0.5, interrupt))
    run = saved(player)
    assert run.log.time[-1] > 0.45
    entries = load_config(run.path / "config.yaml").commands
    assert [entry.velocity_m_s for entry in entries[1:]] == [(0.3, 0.0, 0.0), (0.0, 0.0, 0.0)]


def test_a_page_that_falls_silent_has_let_go() -> None:
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    moved: list[Axes] = []
    try:
        pad = Pad(server.gui, moved.append, moved.append, lambda order: None)
        pad._text.value = '{"count": 1, "move": [0.35, 0, -0.2]}'
        asyncio.run(pad._hear(None))
        pad.watch()
        assert moved == [(0.35, 0.0, -0.2)]
        time.sleep(0.6)
        pad.watch()
        pad.watch()
        assert moved[1:] == [(0.0, 0.0, 0.0)]
    finally:
        server.stop()


def test_a_spring_acts_at_the_grip(start: Callable[..., Player], config: Config) -> None:
    """At a shank: force along the spring, and its moment about the body's centre of mass."""
    session = start(config).run._session
    pulls = Pulls(session)
    robot, plant = session.robot, session.plant
    joint = robot.model.getJointId("FL_KFE")
    body = pulls._body_of[joint]
    pulls.pull(Pull(joint, np.array([0.0, 0.0, -0.1]), np.array([1.0, 0.0, 0.2])))
    wrench = pulls.wrenches(0.0)[body]
    data = robot.create_data()
    pin.forwardKinematics(robot.model, data, plant.sense().q)
    grip = data.oMi[joint].act(np.array([0.0, 0.0, -0.1]))
    np.testing.assert_allclose(np.cross(wrench[:3], np.array([1.0, 0.0, 0.2]) - grip), 0.0, atol=1e-9)
    np.testing.assert_allclose(wrench[3:], np.cross(grip - plant.body_point(body), wrench[:3]), atol=1e-12)
    pulls.pull(Pull(0))
    assert pulls.is_active(0.0) and not pulls.wrenches(0.0)[body].any()
    assert not pulls.is_active(0.001)


SOCKET = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
}  # fmt: skip
"""Headers of a request for the page's websocket."""


def asked(page: SplitResult, path: str, **headers: str) -> tuple[int, str]:
    """Return status and cookie of the answer to a request of the page."""
    with closing(HTTPConnection(page.hostname or "", page.port, timeout=10.0)) as link:
        link.request("GET", path, headers=headers)
        with link.getresponse() as answer:
            return answer.status, (answer.headers["Set-Cookie"] or "").partition(";")[0]


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://elsewhere.example", 403),
        ("http://localhost.elsewhere.example:8080", 403),
        ("null", 403),
        ("http://localhost:9000", 101),
        ("http://127.0.0.2:9000", 101),
    ],
)
def test_pages_of_other_sites_do_not_reach_the_robot(origin: str, status: int, page: SplitResult) -> None:
    """Any page that is open in the same browser could have driven it; one through ssh has another port."""
    _, cookie = asked(page, f"/?{page.query}")
    assert asked(page, "/", Origin=origin, Cookie=cookie, **SOCKET)[0] == status


def test_at_another_address_page_files_and_socket_need_the_token_of_its_url(page: SplitResult) -> None:
    own = SOCKET | {"Origin": f"http://{page.netloc}"}
    assert len(page.query) > len("token=") + 16
    for path in ("/", "/?token=", f"/?{page.query}x", "/index.html"):
        assert asked(page, path)[0] == asked(page, path, Cookie="token=1; =lgmpc")[0] == 403
        assert asked(page, path, **own)[0] == 403
    status, cookie = asked(page, f"/?{page.query}")
    assert status == 200 and cookie
    assert asked(page, "/index.html", Cookie=f"other=1; {cookie}")[0] == 200
    assert asked(page, "/", Cookie=cookie, **own)[0] == 101


@pytest.fixture(scope="module")
def page() -> Iterator[SplitResult]:
    """The address of a page without a run; it is not that of pages that need no token."""
    told: list[str] = []
    with Viewing(0, browser=False, host="127.0.0.2").open(told.append):
        yield urlsplit(told[0].removeprefix("page: "))


@pytest.mark.parametrize("host", ["0.0.0.0", "203.0.113.7", "robot"])
def test_an_address_that_is_not_one_of_this_machine_is_refused(host: str) -> None:
    words = rf"--host: got {re.escape(host)}:0 .*an IPv4 address here"
    with pytest.raises(InputError, match=words), Viewing(0, host=host).open(print):
        pass


def test_a_port_in_use_is_one_error_with_a_remedy() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        viewing = Viewing(port=taken.getsockname()[1])
        with (
            pytest.raises(InputError, match=r"--port or --host: got 127\.0\.0\.1:\d+ .*0 takes any"),
            viewing.open(print),
        ):
            pass


def test_a_config_that_cannot_be_used_is_told_before_any_address() -> None:
    def load() -> None:
        load_config("solo12_velocity", ["mpc.nods=3"])

    told: list[str] = []
    with pytest.raises(ConfigError, match="mpc.nodes"), Viewing(port=0, browser=False).open(told.append, load):
        pass
    assert told == []


def test_the_viewer_skips_a_run_that_is_over_before_it_could_be_seen(config: Config) -> None:
    mine, theirs = multiprocessing.Pipe()
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    try:
        mine.send(Started("psm_gone", config))
        mine.close()
        with pytest.raises(EOFError):  # the end of the pipe, and nothing before
            _serve(server, theirs)
    finally:
        server.stop()
