"""Modes: every transition by itself, and the monitors that decide about falling and moving again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lgmpc.control.modes import TRANSITIONS, FallMonitor, FallSettings, Mode, ModeMachine, RestMonitor, TransitionInputs
from lgmpc.runs.log import MODES

HEIGHT = 0.2
ARMED = [mode for mode in Mode if mode is not Mode.DAMP]
WALKS = TransitionInputs(moving=True, stepping=True)

CASES = [
    *(("emergency stop", mode, TransitionInputs(request="damp"), Mode.DAMP) for mode in ARMED),
    *(("give up", mode, TransitionInputs(failure="tilted"), Mode.DAMP) for mode in ARMED),
    *(("sink", mode, TransitionInputs(lame=True, stepping=True), Mode.SIT) for mode in Mode if mode.upright),
    ("re-arm", Mode.DAMP, TransitionInputs(rearmed=True), Mode.LIE),
    ("rise", Mode.LIE, TransitionInputs(folded=True), Mode.RISE),
    ("risen", Mode.RISE, TransitionInputs(lifted=True), Mode.STAND),
    ("take off", Mode.STAND, TransitionInputs(maneuver=True, settled=True), Mode.MANEUVER),
    ("fall", Mode.STAND, TransitionInputs(falling=True), Mode.MANEUVER),
    ("turn over", Mode.DAMP, TransitionInputs(dropped=True), Mode.MANEUVER),
    ("performed", Mode.MANEUVER, TransitionInputs(performed=True), Mode.STAND),
    ("set off", Mode.STAND, WALKS, Mode.LOCOMOTE),
    ("recover", Mode.STAND, TransitionInputs(stepping=True, reacting=True), Mode.RECOVER),
    ("recover", Mode.LOCOMOTE, TransitionInputs(stepping=True, reacting=True), Mode.RECOVER),
    ("walk on", Mode.RECOVER, WALKS, Mode.LOCOMOTE),
    ("halt", Mode.LOCOMOTE, TransitionInputs(), Mode.STAND),
    ("recovered", Mode.RECOVER, TransitionInputs(), Mode.STAND),
    ("sit down", Mode.STAND, TransitionInputs(request="lie"), Mode.SIT),
    ("lain", Mode.SIT, TransitionInputs(request="lie", lifted=True), Mode.LIE),
]

STAYS = [
    (Mode.DAMP, TransitionInputs()),
    (Mode.DAMP, TransitionInputs(request="damp", rearmed=True)),
    (Mode.LIE, TransitionInputs()),
    (Mode.LIE, TransitionInputs(request="lie", folded=True)),
    (Mode.RISE, TransitionInputs()),
    (Mode.RISE, TransitionInputs(request="lie")),
    (Mode.STAND, TransitionInputs()),
    (Mode.STAND, TransitionInputs(request="lie", moving=True)),
    (Mode.STAND, TransitionInputs(maneuver=True)),
    (Mode.MANEUVER, TransitionInputs(maneuver=True, settled=True)),
    (Mode.LOCOMOTE, WALKS),
    (Mode.LOCOMOTE, replace(WALKS, request="lie")),
    (Mode.RECOVER, TransitionInputs(stepping=True, reacting=True)),
    (Mode.SIT, TransitionInputs()),
]


def machine_in(mode: Mode) -> ModeMachine:
    machine = ModeMachine()
    machine.begin(mode)
    return machine


@pytest.mark.parametrize(("name", "source", "inputs", "target"), CASES)
def test_a_transition_takes_place(name: str, source: Mode, inputs: TransitionInputs, target: Mode) -> None:
    machine = machine_in(source)
    transition = machine.update(inputs)
    assert transition is not None and transition.name == name
    assert machine.mode is target is transition.target


def test_every_transition_is_tested() -> None:
    assert {name for name, *_ in CASES} == {transition.name for transition in TRANSITIONS}
    for transition in TRANSITIONS:
        assert {source for name, source, *_ in CASES if name == transition.name} == transition.sources


@pytest.mark.parametrize(("mode", "inputs"), STAYS)
def test_a_mode_stays_without_its_conditions(mode: Mode, inputs: TransitionInputs) -> None:
    machine = machine_in(mode)
    assert machine.update(inputs) is None and machine.mode is mode


def test_the_log_names_every_mode() -> None:
    assert sorted(mode.name.lower() for mode in Mode) == sorted(MODES)


@pytest.fixture
def monitor() -> FallMonitor:
    return FallMonitor(FallSettings(), HEIGHT)


def tilt(degrees: float) -> float:
    return float(np.cos(np.radians(degrees)))


def test_a_robot_falls_that_is_level_and_high_without_a_contact(monitor: FallMonitor) -> None:
    assert not monitor.falls(0.0, 1.0, HEIGHT, 0.0)
    monitor.update_support(0.0, HEIGHT, False)
    for time, degrees, height, falls in (
        (0.029, 0, 1, False),
        (0.031, 0, 1, True),
        (0.1, 25, 1, False),
        (0.1, 5, 0.8, False),
    ):
        assert monitor.falls(time, tilt(degrees), height * HEIGHT, 0.5) is falls
    assert not monitor.falls(0.1, 1.0, HEIGHT, 1.5)
    monitor.update_support(0.1, HEIGHT, True)
    assert not monitor.falls(0.2, 1.0, HEIGHT, 0.0)


def given_up_after(monitor: FallMonitor, seconds: float = 1.0, **changes: object) -> tuple[float, str]:
    """Return when a monitor of a constant state gives up, s, and why; inf if never."""
    whole = {"upright": 1.0, "error": 0.0, "solved": True, "height": HEIGHT, "touching": True} | changes
    for k in range(round(1e3 * seconds)):
        t = 1e-3 * k
        why = monitor.update(t, whole["upright"], whole["error"], whole["solved"])
        why = why or monitor.update_support(t, whole["height"], whole["touching"])
        if why:
            return t, why
    return np.inf, ""


@pytest.mark.parametrize(
    ("changes", "latest", "why"),
    [
        ({"upright": tilt(61.0)}, 0.0, "tilted by more than 60 degrees"),
        ({"height": 0.49 * HEIGHT}, 0.1, "lower than 50 %"),
        ({"error": 0.41 * HEIGHT}, 0.2, "could not be held"),
        ({"error": -0.41 * HEIGHT}, 0.2, "could not be held"),
        ({"upright": tilt(41.0)}, 0.2, "could not be held"),
        ({"touching": False}, 0.25, "no foot on the ground"),
        ({"solved": False}, 0.1, "no solution"),
    ],
)
def test_it_gives_up_in_time(monitor: FallMonitor, changes: dict[str, object], latest: float, why: str) -> None:
    when, words = given_up_after(monitor, **changes)
    assert when == pytest.approx(latest, abs=1.1e-3)
    assert why in words


@pytest.mark.parametrize(
    "changes",
    [
        {"upright": tilt(39.0)},
        {"height": 0.51 * HEIGHT},
        {"error": 0.39 * HEIGHT},
        {"upright": np.nan, "height": np.nan},
    ],
)
def test_it_goes_on_within_the_limits(monitor: FallMonitor, changes: dict[str, object]) -> None:
    assert given_up_after(monitor, **changes) == (np.inf, "")


def test_what_lasts_shorter_than_the_patience_is_forgiven(monitor: FallMonitor) -> None:
    for k in range(2000):
        landed = k % 240 < 5
        assert not monitor.update_support(1e-3 * k, HEIGHT, touching=landed)


def rested(monitor: RestMonitor, upright: float, speed: float, request: str, seconds: float = 1.0) -> float:
    v = np.full(18, speed)
    times = (1e-3 * k for k in range(round(1e3 * seconds)))
    return next((t for t in times if monitor.update(t, upright, v, request)), np.inf)


@pytest.mark.parametrize("automatic", [True, False])
def test_a_robot_at_rest_on_its_belly_moves_again_when_it_is_allowed_to(automatic: bool) -> None:
    monitor = RestMonitor(0.3, automatic)
    monitor.begin("stand")
    assert rested(monitor, 1.0, 0.0, "stand") == pytest.approx(0.3 if automatic else np.inf, abs=1.1e-3)
    monitor.begin("stand")
    assert rested(monitor, 1.0, 0.0, "lie") == pytest.approx(0.3, abs=1.1e-3)


@pytest.mark.parametrize(("upright", "speed"), [(-1.0, 0.0), (tilt(25.0), 0.0), (1.0, 0.5), (np.nan, np.nan)])
def test_one_on_its_back_or_in_motion_does_not(upright: float, speed: float) -> None:
    monitor = RestMonitor(0.3, automatic=True)
    monitor.begin("stand")
    assert rested(monitor, upright, speed, "stand") == np.inf


@pytest.mark.parametrize(("base", "joints", "rests"), [(0.09, 0.9, True), (0.11, 0.0, False), (0.0, 1.1, False)])
def test_at_rest_neither_base_nor_joints_move(base: float, joints: float, rests: bool) -> None:
    """Limits are 0.1 (m/s, rad/s) of the base and 1 rad/s of all joints together."""
    rng, monitor = np.random.default_rng(4), RestMonitor(0.3, automatic=True)
    monitor.begin("stand")
    parts = [size * v / np.linalg.norm(v) for size, v in ((base, rng.normal(size=6)), (joints, rng.normal(size=12)))]
    found = [monitor.update(1e-3 * k, 1.0, np.concatenate(parts), "stand") for k in range(400)]
    assert any(found) is rests
