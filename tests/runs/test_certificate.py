"""Certificates, from logs whose offences are known by construction."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lgmpc.runs import RunLog, RunResult
from lgmpc.runs.certificate import Balances, Certificate, certify, window_edges
from lgmpc.runs.gate import Outcome, Verdict
from lgmpc.runs.limited import DriveLine, Nearest, UnloggedLimits, joint_power
from lgmpc.runs.log import MODES
from lgmpc.runs.metrics import LinkDistances

JOINTS = UnloggedLimits(np.full(12, -2.0), np.full(12, 2.0), np.full(12, 30.0))
LINE = JOINTS._replace(line=DriveLine(stall=2.0, no_load=20.0))
MASS = 24.0 / 9.81  # four feet carry 6 N each
Edit = Callable[[dict[str, np.ndarray]], None]
Certify = Callable[..., Certificate]


@pytest.fixture
def certified(changed: Callable[[Edit], RunLog]) -> Certify:
    """Certify the standing log after a change, with momentum and energy at the edges of windows."""

    def run(
        edit: Edit = lambda arrays: None, momentum: object = 0.0, energy: object = 1.0, joints: UnloggedLimits = JOINTS
    ) -> Certificate:
        log = replace(changed(edit), mass_kg=MASS)
        edges = window_edges(log)
        values = np.broadcast_to(np.asarray(momentum, dtype=float), (len(edges), 3))
        energies, weight = np.broadcast_to(np.asarray(energy), len(edges)), np.array([0.0, 0.0, -9.81 * MASS])
        return certify(log, joints, Balances(edges, values, energies, weight))

    return run


def broken(certificate: Certificate) -> Nearest:
    (check,) = certificate.broken
    assert not certificate.certified
    return check


def test_a_robot_that_stands_is_certified(certified: Certify) -> None:
    certificate = certified()
    assert certificate.certified
    names = ["normal force", "friction", "floor penetration", "torque", "joint speed", "joint position"]
    assert [each.name for each in certificate.checks] == [*names, "momentum balance", "energy balance"]
    torque = certificate.checks[3]
    assert (torque.value, torque.limit, torque.margin, torque.unit) == (0.5, 1.8, pytest.approx(1.3), "N.m")


@pytest.mark.parametrize(
    ("name", "channel", "place", "value", "subject", "margin"),
    [
        ("friction", "contact_forces", (400, 2, 0), 4.0, "HL", 0.6 * 6.0 - 4.0),
        ("floor penetration", "contact_clearance", (400, 3), -0.006, "HR", -1.0),
        ("torque", "tau", (400, 7), -1.9, "joint 8", -0.1),
        ("joint speed", "v", (400, 6 + 4), 31.0, "joint 5", -1.0),
        ("joint position", "q", (400, 7 + 4), -2.5, "joint 5", -0.5),
    ],
)
def test_each_offence_is_named_with_its_margin_place_and_time(
    certified: Certify, name: str, channel: str, place: tuple[int, ...], value: float, subject: str, margin: float
) -> None:
    check = broken(certified(lambda arrays: arrays[channel].__setitem__(place, value)))
    assert (check.name, check.subject, check.time_s) == (name, subject, pytest.approx(0.4))
    assert check.margin == pytest.approx(margin)
    assert str(check).startswith(f"{name} of {subject}: ")


def test_a_foot_that_pulls_is_named(certified: Certify) -> None:
    names = {each.name: each for each in certified(lambda a: a["contact_forces"].__setitem__((400, 0, 2), -0.1)).broken}
    assert names["normal force"].margin == -0.1


def test_momentum_without_a_force_is_named(certified: Certify) -> None:
    """From the third edge on the robot is faster by 0.1 N.s, in 50 ms: 2 N that nothing exerts."""
    momentum = np.zeros((20, 3))
    momentum[3:, 1] = 0.1
    check = broken(certified(momentum=momentum))
    assert (check.name, check.value, check.limit) == ("momentum balance", pytest.approx(2.0), pytest.approx(0.48))
    assert check.time_s == pytest.approx(0.15)


def test_a_push_accounts_for_momentum_and_energy(certified: Certify) -> None:
    """A push of 20 N for 0.1 s at a point that moves at 1 m/s gives 2 N.s and 2 J."""
    momentum, energy = np.zeros((20, 3)), np.ones(20)
    momentum[3:, 1], energy[3:] = 1.0, 2.0
    momentum[4:, 1], energy[4:] = 2.0, 3.0

    def push(arrays: dict[str, np.ndarray]) -> None:
        arrays["push"][100:200, 1] = 20.0
        arrays["push_point"][100:200, 1] = 0.001 * np.arange(100)

    assert certified(push, momentum, energy).certified
    names = [each.name for each in certified(momentum=momentum, energy=energy).broken]
    assert names == ["momentum balance", "energy balance"]
    assert certified(push, momentum, energy - 0.1 * np.arange(20)).certified  # contacts may dissipate


def test_joints_do_the_work_that_lifts_the_body(certified: Certify) -> None:
    """0.5 N.m at 2 rad/s in one joint is 1 W: 0.05 J in a window."""
    energy = 1.0 + 0.05 * np.arange(20)

    def move(arrays: dict[str, np.ndarray]) -> None:
        arrays["v"][:, 6] = 2.0

    assert certified(move, energy=energy).certified
    check = broken(certified(move, energy=energy + 0.07 * np.arange(20)))
    assert check.value == pytest.approx(0.07)


@pytest.mark.parametrize(("stall", "no_load", "effort"), [(2.0, 20.0, 9.0), (2.0, 20.0, 0.6), (4.0, 90.0, 1.8)])
def test_the_largest_power_on_a_torque_speed_line(stall: float, no_load: float, effort: float) -> None:
    """Against a search over all speeds."""
    line, speeds = DriveLine(stall, no_load), np.linspace(0.0, no_load, 200_001)
    largest = (np.minimum(line.torque(speeds), effort) * speeds).max()
    assert line.power(np.array([effort]))[0] == pytest.approx(largest, rel=1e-9)
    np.testing.assert_array_equal(line.torque(np.array([0.0, no_load, 2.0 * no_load])), [stall, 0.0, 0.0])


def moving(arrays: dict[str, np.ndarray], torque: float, speed: float) -> None:
    """Drive joint 3 for a while at one speed: 0.1 s, an even number of ticks."""
    arrays["v"][100:200, 6 + 2], arrays["tau"][101:200, 2] = speed, torque
    arrays["q"][:, 7:] = 0.0


@pytest.mark.parametrize(
    ("torque", "speed", "margin", "named"),
    [
        (0.7, 12.0, 0.1, ""),  # the line allows 0.8 N.m at 12 rad/s
        (0.9, 12.0, -0.1, "torque at its speed"),
        (0.2, 21.0, -0.2, "torque at its speed"),  # none above the no-load speed
        (-0.9, 12.0, 1.1, ""),  # braking: what it allows at rest
        (-1.7, -4.0, -0.1, "torque at its speed"),
    ],
)
def test_the_torque_speed_line_is_checked_where_a_joint_is_driven(
    certified: Certify, torque: float, speed: float, margin: float, named: str
) -> None:
    certificate = certified(lambda arrays: moving(arrays, torque, speed), joints=LINE)
    line = next(each for each in certificate.checks if each.name == "torque at its speed")
    assert line.margin == pytest.approx(min(margin, 1.5))  # 1.5: of the joints at rest
    assert line.kept == (not named)
    if named:
        assert (line.subject, line.time_s) == ("joint 3", pytest.approx(0.101))


def test_power_beyond_what_the_supply_allows_is_named(certified: Certify) -> None:
    """At half of the no-load speed the line allows 1 N.m, 10 W; 1.2 N.m there are 12 W."""
    certificate = certified(lambda arrays: moving(arrays, 1.2, 10.0), joints=LINE)
    power = next(each for each in certificate.checks if each.name == "power")
    assert (power.subject, power.value, power.unit) == ("joint 3", pytest.approx(12.0), "W")
    assert (power.limit, power.margin, power.kept) == (pytest.approx(10.0), pytest.approx(-2.0), False)
    kept = certified(lambda arrays: moving(arrays, 0.9, 10.0), joints=LINE)
    assert next(each for each in kept.checks if each.name == "power").margin == pytest.approx(1.0)


def test_ticks_after_a_missed_one_have_no_power(changed: Callable[[Edit], RunLog]) -> None:
    log = changed(lambda arrays: moving(arrays, 1.2, 10.0))
    keep = np.delete(np.arange(log.ticks), 150)
    missed = replace(
        log, **{name: array[keep] for name, array in log.arrays().items() if np.ndim(array) and len(array) == log.ticks}
    )
    power = joint_power(missed)[:, 2]
    assert power[149] == pytest.approx(12.0) and power[150] == 0.0 and power[151] == pytest.approx(12.0)


def test_what_follows_a_fall_does_not_count(certified: Certify) -> None:
    def fall(arrays: dict[str, np.ndarray]) -> None:
        arrays["q"][500:, 2] = 0.05
        arrays["tau"][600:] = 5.0

    assert certified(fall).certified


def test_balances_are_left_out_without_their_data(changed: Callable[[Edit], RunLog]) -> None:
    certificate = certify(changed(lambda arrays: None), JOINTS)
    assert len(certificate.checks) == 6 and certificate.certified


def test_links_overlap_by_5_mm_at_most_but_for_folded_legs(changed: Callable[[Edit], RunLog]) -> None:
    log = changed(lambda arrays: None)

    def certified(*least: float) -> Certificate:
        return certify(
            log,
            JOINTS,
            distances=LinkDistances(log.time[[200, 400, 600]], np.array(least), ["ab", "bc", "cd"], np.ones(3)),
        )

    assert certified(0.1, -0.004, 0.1).certified
    check = broken(certified(0.1, -0.006, -0.005))
    assert (check.name, check.subject, check.time_s) == ("self-penetration", "bc", pytest.approx(0.4))
    log = replace(log, mode=np.where(np.abs(log.time - 0.4) < 0.05, MODES.index("lie"), log.mode))
    assert certified(0.1, -0.006, -0.005).certified
    log = replace(log, q=np.where((log.time > 0.3)[:, None] & (np.arange(log.q.shape[1]) == 2), 0.05, log.q))
    assert certified(0.1, -0.006, -0.006).certified, "after a fall"


def test_what_is_not_a_number_is_not_kept_and_comes_back_from_json(certified: Certify) -> None:
    certificate = certified(lambda arrays: arrays["contact_forces"].__setitem__((400, 0, 0), np.nan))
    assert "friction" in [each.name for each in certificate.broken]
    result = RunResult("x", Verdict(Outcome.PASS), None, certificate=certificate)
    content = json.loads(result.to_json())
    assert content["certificate"]["certified"] is False
    again = RunResult.from_json(result.to_json()).certificate
    assert again is not None and [each.name for each in again.broken] == [each.name for each in certificate.broken]
    whole = certified()
    assert RunResult.from_json(replace(result, certificate=whole).to_json()).certificate == whole
    del content["certificate"]
    assert RunResult.from_json(json.dumps(content)).certificate is None


def test_a_value_just_beyond_its_limit_is_shown_with_enough_digits() -> None:
    told = str(Nearest("joint position", "FL_HAA", 0.453, -0.90003, "rad", -0.9, -3e-5))
    assert told == "joint position of FL_HAA: -0.90003 rad at 0.453 s, limit -0.9 rad"
