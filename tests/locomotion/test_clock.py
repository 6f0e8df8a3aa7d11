"""The gait clock: predictions come true, transitions keep their support, contacts out of schedule move it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.errors import InputError
from lgmpc.locomotion.clock import GaitClock, GaitClockSettings
from lgmpc.locomotion.gait import Gait, quadruped_gaits
from lgmpc.timegrid import TimeGrid

GAITS = {
    **quadruped_gaits(),
    # With both pairs on the ground for a while between the swings:
    "trot": Gait(name="trot", period_s=0.32, duty=0.55, offsets=(0.0, 0.5, 0.5, 0.0)),
}
TICK = 2e-3
MIN_STANCE = GaitClockSettings().min_stance_s

gaits = st.one_of(
    st.sampled_from(list(GAITS.values())),
    st.builds(
        Gait,
        name=st.just("own"),
        period_s=st.floats(0.15, 0.8),
        duty=st.floats(0.3, 0.95),
        offsets=st.tuples(*[st.floats(0.0, 0.99)] * 4),
    ),
)
# (time until the change, the new gait or None to stop)
changes = st.lists(st.tuples(st.floats(0.0, 0.6), st.one_of(st.none(), gaits)), min_size=1, max_size=5)


def run(changes: list[tuple[float, Gait | None]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, flags (T, 4), and the fewest feet that may be on the ground at each time."""
    clock = GaitClock(GAITS["stand"])
    times: np.ndarray = np.cumsum([time for time, _ in changes])
    k, t, support, flags, stamps, least = 0, 0.0, 4, [], [], []
    while t < times[-1] + 1.5:
        while k < len(changes) and t >= times[k]:
            gait = changes[k][1]
            if gait is None:
                clock.stop(t)
            else:
                clock.start(t, gait)
            support = min(support, clock.gait.min_support)
            k += 1
        clock.advance(t)
        stamps.append(t)
        flags.append(clock.flags(t))
        least.append(support)
        t += TICK
    return np.array(stamps), np.array(flags), np.array(least)


def stretches(flags: np.ndarray) -> list[tuple[bool, int, int]]:
    """(value, first, one past last) of the constant parts."""
    ends = [0, *(np.flatnonzero(np.diff(flags)) + 1), len(flags)]
    return [(bool(flags[a]), int(a), int(b)) for a, b in zip(ends, ends[1:], strict=False)]


@given(changes)
def test_transitions_keep_the_support_of_the_gaits(changes: list[tuple[float, Gait | None]]) -> None:
    _, flags, least = run(changes)
    assert (flags.sum(axis=1) >= least).all()


@given(changes)
def test_swings_are_as_long_as_those_of_a_gait_and_stances_not_too_short(
    changes: list[tuple[float, Gait | None]],
) -> None:
    _, flags, _ = run(changes)
    used = [gait for _, gait in changes if gait is not None and not gait.stands]
    swings = [gait.swing_s for gait in used]
    shortest = min([MIN_STANCE, *(gait.stance_s for gait in used)])
    for foot in flags.T:
        for stance, begin, end in stretches(foot)[1:-1]:
            length = (end - begin) * TICK
            if stance:
                assert length >= shortest - 1.01 * TICK
            else:
                assert min(abs(length - swing) for swing in swings) <= 1.01 * TICK


@given(changes, st.floats(0.0, 1.0))
def test_the_horizon_comes_true_while_nothing_changes(changes: list[tuple[float, Gait | None]], wait: float) -> None:
    clock, t = GaitClock(GAITS["stand"]), 0.0
    for time, gait in changes:
        t += time
        clock.advance(t)
        if gait is None:
            clock.stop(t)
        else:
            clock.start(t, gait)
    t += wait
    predicted = np.zeros((40, 4), dtype=np.bool_)
    clock.advance(t)
    clock.horizon(TimeGrid(0.02, 40, t), predicted)
    for row, time in zip(predicted, t + 0.02 * np.arange(40), strict=True):
        clock.advance(time)
        edges = [
            abs(x - time)
            for f in range(4)
            for s in clock.swings(f, t - 1.0, time + 1.0)
            for x in (s.liftoff, s.touchdown)
        ]
        if min(edges, default=1.0) > 1e-7:  # at a switch itself, rounding decides
            np.testing.assert_array_equal(clock.flags(time), row)


@given(gaits, st.floats(0.0, 2.0))
def test_stopping_ends_in_standing_within_a_cycle_and_a_swing(gait: Gait, moving: float) -> None:
    clock = GaitClock(gait)
    clock.advance(moving)
    clock.stop(moving)
    clock.stop(moving + 0.01)  # again without effect
    t = moving + (0.0 if gait.stands else gait.period_s + gait.swing_s) + 1e-6
    assert clock.flags(t).all()
    assert all(clock.next_liftoff(foot, t) == math.inf for foot in range(4))
    assert clock.stopping


@given(gaits)
def test_every_foot_steps_once_more_before_it_stands(gait: Gait) -> None:
    clock = GaitClock(gait)
    clock.advance(1.0)
    clock.stop(1.0)
    for foot in range(4):
        begun = [swing for swing in clock.swings(foot, 1.0, 5.0) if swing.liftoff >= 1.0]
        assert len(begun) == (0 if gait.stands else 1)


def test_a_walk_begins_at_once_and_with_the_foot_that_is_named() -> None:
    clock = GaitClock(GAITS["stand"])
    clock.start(1.0, GAITS["trot"], first=1)
    assert clock.flags(1.0).tolist() == [True, False, False, True]
    assert clock.next_liftoff(0, 1.0) == pytest.approx(1.0 + 0.5 * GAITS["trot"].period_s)


def test_a_number_of_cycles_ends_in_standing() -> None:
    clock = GaitClock(GAITS["stand"])
    clock.start(0.0, GAITS["trot"], first=0, cycles=2)
    assert [len(clock.swings(foot, 0.0, 5.0)) for foot in range(4)] == [2, 2, 2, 2]
    assert clock.flags(2 * GAITS["trot"].period_s).all()


def test_a_switch_of_gait_waits_for_the_feet_in_the_air() -> None:
    trot, pace = GAITS["trot"], GAITS["pace"]
    clock = GaitClock(trot)
    t = 0.5 * trot.swing_s
    clock.advance(t)
    clock.start(t, pace)
    assert clock.flags(t).tolist() == [False, True, True, False]
    first = min(clock.next_liftoff(foot, t) for foot in range(4))
    assert trot.swing_s <= first <= trot.swing_s + MIN_STANCE + 1e-9


def test_the_same_command_changes_nothing() -> None:
    clock, twin = GaitClock(GAITS["stand"]), GaitClock(GAITS["stand"])
    clock.follow(0.0, GAITS["trot"], True)
    twin.start(0.0, GAITS["trot"])
    for t in np.arange(0.0, 1.0, 0.01):
        clock.advance(t)
        clock.follow(t, GAITS["trot"], True)
        assert (clock.flags(t) == twin.flags(t)).all()
    clock.follow(1.0, GAITS["trot"], False)
    assert clock.stopping
    clock.follow(3.0, GAITS["walk"], True)
    assert not clock.stopping and clock.gait.name == "walk"


def test_a_robot_at_rest_shifts_its_weight_before_its_first_step_and_one_that_steps_does_not_wait() -> None:
    clock = GaitClock(GAITS["stand"])
    clock.follow(1.0, GAITS["trot"], True, 0.06)
    assert clock.next_liftoff(0, 1.0) == pytest.approx(1.06) and not clock.rests(1.0)
    clock.advance(1.1)
    present = clock.swing(0, 1.1)
    clock.follow(1.1, GAITS["walk"], True, 0.06)
    assert present is not None
    assert min(clock.next_liftoff(foot, 1.1) for foot in range(4)) == pytest.approx(present.touchdown)


def test_lifted_feet_begin_with_a_swing() -> None:
    clock = GaitClock(GAITS["stand"], 2.0, contacts=np.array([True, False, True, True]))
    assert clock.flags(2.0).tolist() == [True, False, True, True]
    assert clock.flags(3.0).all()


def test_an_early_touchdown_ends_the_swing_and_nothing_else() -> None:
    trot = GAITS["trot"]
    clock, twin = GaitClock(trot), GaitClock(trot)
    t = 0.6 * trot.swing_s
    clock.advance(t)
    clock.touch_down(0, t)
    assert clock.flags(t).tolist() == [True, True, True, False]
    assert clock.last_touchdown(0, t) == t
    for foot in range(4):
        assert clock.next_liftoff(foot, t) == twin.next_liftoff(foot, t)


def test_a_late_touchdown_delays_the_lift_offs_that_would_leave_too_little_support() -> None:
    trot = GAITS["trot"]
    clock = GaitClock(trot)
    due, half = trot.swing_s, 0.5 * trot.period_s
    clock.advance(due - 1e-3)
    clock.extend(0, due, due + 0.005)  # before the others lift off: no delay
    assert clock.next_liftoff(1, due) == pytest.approx(half)
    clock.extend(0, due, half + 0.02)
    assert clock.next_liftoff(1, due) == pytest.approx(half + 0.02)
    assert clock.next_liftoff(2, due) == pytest.approx(half + 0.02)
    assert clock.next_liftoff(3, due) == pytest.approx(trot.period_s + 0.02)
    assert clock.flags(half + 0.01).tolist() == [False, True, True, True]
    assert clock.flags(half + 0.021).tolist() == [True, False, False, True]


def test_a_foot_that_is_very_late_stands_before_it_lifts_off_again() -> None:
    walk = GAITS["walk"]
    clock = GaitClock(walk)
    foot = 2
    due = clock.swing(foot, 0.0)
    assert due is not None
    touchdown = due.touchdown
    until = clock.next_liftoff(foot, 1e-3) + 0.01
    clock.advance(touchdown - 1e-3)
    clock.extend(foot, touchdown, until)
    assert clock.next_liftoff(foot, touchdown) >= until + MIN_STANCE - 1e-9


@given(gaits, st.floats(0.001, 0.1), st.integers(0, 3))
def test_no_foot_lifts_off_while_a_late_one_would_be_missed(gait: Gait, late: float, foot: int) -> None:
    if gait.stands:
        return
    clock = GaitClock(gait)
    first = clock.swings(foot, 0.0, 5.0)[0]
    t, found = 0.0, first.touchdown + late
    while t < found:
        if t >= first.touchdown - 1e-12:
            clock.extend(foot, t, t + 0.01)
        clock.advance(t)
        t += 1e-3
    last = found + 0.01
    assert min(clock.flags(t).sum() for t in np.arange(0.0, last, 2e-3)) >= gait.min_support


def test_times_within_swing_and_stance() -> None:
    trot = GAITS["trot"]
    clock = GaitClock(trot)
    t = 0.25 * trot.swing_s
    swing = clock.swing(0, t)
    assert swing is not None and clock.swing(1, t) is None
    assert swing.progress(t) == pytest.approx(0.25)
    assert swing.progress(2.0 * swing.liftoff - t) == pytest.approx(-0.25)
    assert clock.stance_duration(0, t) == pytest.approx(trot.stance_s)
    middle = trot.swing_s + 0.5 * trot.stance_s
    assert clock.stance_duration(0, middle) == pytest.approx(trot.stance_s)
    clock.stop(middle)
    assert clock.stance_duration(0, middle + trot.period_s) == math.inf


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"gait": Gait(name="hop", period_s=0.4, duty=0.6, offsets=(0.0,))}, "gait"),
        ({"gait": GAITS["trot"], "first": 4}, "first"),
        ({"gait": GAITS["trot"], "cycles": 0}, "cycles"),
    ],
)
def test_a_start_that_cannot_be_is_refused(arguments: dict[str, object], name: str) -> None:
    with pytest.raises(InputError) as caught:
        GaitClock(GAITS["stand"]).start(0.0, **arguments)  # type: ignore[arg-type]
    assert caught.value.argument == name


@given(changes)
def test_it_rests_where_no_foot_swings_or_is_to_lift_off(changes: list[tuple[float, Gait | None]]) -> None:
    clock, t = GaitClock(GAITS["stand"]), 0.0
    assert clock.rests(t)
    for wait, gait in changes:
        end = t + wait
        while t < end:
            t += 5.0 * TICK
            clock.advance(t)
            steps = any(clock.swing(foot, t) or math.isfinite(clock.next_liftoff(foot, t)) for foot in range(4))
            assert clock.rests(t) is not steps
        if gait is None:
            clock.stop(t)
        else:
            clock.start(t, gait)


@given(gaits, st.integers(0, 3), st.floats(0.0, 2.0), st.floats(0.0, 1.0))
def test_a_long_step_takes_time_from_the_stance_after_it_only(gait: Gait, foot: int, wait: float, share: float) -> None:
    clock, plain = GaitClock(gait), GaitClock(gait)
    clock.advance(wait)
    swing = clock.swing(foot, wait)
    if swing is None:
        clock.stretch(foot, wait, wait + 1.0)  # a foot that stands has none to stretch
        np.testing.assert_array_equal(clock.flags(wait), plain.flags(wait))
        return
    latest, scheduled = clock.latest_touchdown(foot, wait), swing.touchdown
    until = scheduled + share * max(latest - scheduled, 0.0)
    clock.stretch(foot, wait, until)
    clock.stretch(foot, wait, scheduled)  # shorter again: without effect
    stretched = clock.swing(foot, wait)
    assert stretched is not None and stretched.touchdown == until
    assert clock.next_liftoff(foot, wait) - until >= min(MIN_STANCE, gait.stance_s) - 1e-9
    for other in range(4):
        assert clock.next_liftoff(other, wait) == pytest.approx(plain.next_liftoff(other, wait))


def test_a_delay_costs_no_steps() -> None:
    """A foot is found 0.2 s late: all later swings are 0.2 s later, and three cycles stay three cycles."""
    trot, delay = GAITS["trot"], 0.2
    clock, twin = (GaitClock(GAITS["stand"]) for _ in range(2))
    for each in (clock, twin):
        each.start(0.0, trot, cycles=3)
    due, half = trot.swing_s, 0.5 * trot.period_s
    clock.advance(due - 1e-3)
    clock.extend(0, due, half + delay)
    for foot in range(4):
        (first, *later), planned = (each.swings(foot, 0.0, 5.0) for each in (clock, twin))
        assert len(later) == 2 and len(planned) == 3
        for swing, original in zip(later, planned[1:], strict=True):
            assert swing.liftoff == pytest.approx(original.liftoff + delay)
            assert swing.touchdown == pytest.approx(original.touchdown + delay)
        assert first.liftoff == pytest.approx(planned[0].liftoff + (0.0 if foot in (0, 3) else delay))


def test_a_foot_that_lifted_off_at_the_last_tick_is_not_delayed() -> None:
    trot = GAITS["trot"]
    clock = GaitClock(trot)
    lifts = clock.next_liftoff(1, 0.0)
    clock.advance(lifts)
    clock.extend(0, lifts, lifts + 0.3)
    assert clock.swings(1, lifts, lifts + 1e-3)[0].liftoff == lifts
    assert clock.next_liftoff(1, lifts) > lifts + trot.period_s
