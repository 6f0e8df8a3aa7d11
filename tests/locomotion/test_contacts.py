"""Contact events by scripted floors: on time, early, late, missing, lost, and none measured."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.contacts import ContactEvents, ContactEventSettings, ContactState
from lgmpc.locomotion.gait import Gait
from lgmpc.timegrid import TimeGrid

TROT = Gait(name="trot", period_s=0.32, duty=0.55, offsets=(0.0, 0.5, 0.5, 0.0))
TICK = 1e-3
SETTINGS = ContactEventSettings()
STANCE, SWING, EARLY, LATE, MISSING, LOST = ContactState


class Script:
    """A trot over a floor: by default every foot is in contact exactly when its schedule says so.

    What the floor does is measured ``age`` ticks later.
    """

    def __init__(self, settings: ContactEventSettings = SETTINGS, age: int = 0) -> None:
        self.clock = GaitClock(TROT)
        self.events = ContactEvents(self.clock, settings, age * TICK)
        self.arriving = deque([np.ones(4, dtype=np.bool_)] * age)
        self.first = self.clock.swing(0, 0.0)
        self.t = 0.0
        self.below = [False] * 4
        self.history: list[tuple[float, ContactState]] = []

    def run(self, until: float, floor: Callable[[float, np.ndarray], None] | None = None) -> None:
        while self.t < until - 1e-9:
            contacts = self.clock.flags(self.t)
            if floor is not None:
                floor(self.t, contacts)
            self.arriving.append(contacts)
            self.events.update(self.t, self.arriving.popleft(), lambda foot: self.below[foot])
            self.history.append((self.t, self.events.states[0]))
            self.t += TICK

    def sequence(self) -> list[ContactState]:
        states = [state for _, state in self.history]
        return [state for i, state in enumerate(states) if i == 0 or state is not states[i - 1]]

    def begin(self, state: ContactState) -> float:
        return next(t for t, each in self.history if each is state)


def test_on_time_the_schedule_is_followed() -> None:
    script = Script()
    script.run(2 * TROT.period_s)
    assert script.sequence() == [SWING, STANCE, SWING, STANCE]
    assert script.begin(STANCE) == pytest.approx(TROT.swing_s, abs=TICK)


def test_without_a_measurement_the_schedule_is_followed() -> None:
    clock = GaitClock(TROT)
    events, twin = ContactEvents(clock), GaitClock(TROT)
    for t in np.arange(0.0, 1.0, TICK):
        assert (events.update(t) == twin.flags(t)).all()


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_contact_early_in_a_swing_is_not_yet_a_touchdown(share: float) -> None:
    script = Script(ContactEventSettings(early_share=share))

    def step(t: float, contacts: np.ndarray) -> None:
        contacts[0] |= 0.3 * TROT.swing_s <= t < TROT.period_s

    script.run(TROT.period_s - 0.01, step)
    assert script.sequence()[:2] == [SWING, EARLY]
    assert script.begin(EARLY) == pytest.approx(share * TROT.swing_s, abs=2.1 * TICK)


def test_an_early_touchdown_carries_at_once_and_the_schedule_goes_on() -> None:
    script = Script()
    touch = 0.7 * TROT.swing_s

    def step(t: float, contacts: np.ndarray) -> None:
        contacts[0] |= touch <= t < TROT.period_s

    script.run(TROT.period_s + 0.05, step)
    assert script.sequence() == [SWING, EARLY, SWING]
    assert script.begin(EARLY) == pytest.approx(touch + SETTINGS.touch_time_s, abs=1.1 * TICK)
    lifted = next(t for t, state in script.history if state is SWING and t > touch + 0.01)
    assert lifted == pytest.approx(TROT.period_s, abs=TICK)


def test_a_touch_right_after_lift_off_is_no_touchdown() -> None:
    script = Script()

    def drag(t: float, contacts: np.ndarray) -> None:
        contacts[0] |= t < 0.3 * TROT.swing_s

    script.run(0.9 * TROT.period_s, drag)
    assert script.sequence() == [SWING, STANCE]


def test_a_flicker_is_no_touchdown() -> None:
    script = Script()

    def flicker(t: float, contacts: np.ndarray) -> None:
        contacts[0] |= 0.6 * TROT.swing_s < t < 0.9 * TROT.swing_s and round(t / TICK) % 2 == 0

    script.run(0.9 * TROT.period_s, flicker)
    assert script.sequence() == [SWING, STANCE]


def test_a_late_foot_swings_on_and_the_others_wait() -> None:
    script = Script(ContactEventSettings(max_late_s=0.1))
    found = 0.5 * TROT.period_s + 0.03

    def hole(t: float, contacts: np.ndarray) -> None:
        contacts[0] = t >= found

    flags = []
    while script.t < found + 0.05:
        script.run(script.t + TICK, hole)
        flags.append(script.events.stance.copy())
    assert script.sequence() == [SWING, LATE, STANCE]
    assert script.begin(LATE) == pytest.approx(TROT.swing_s, abs=1.1 * TICK)
    assert script.begin(STANCE) == pytest.approx(found, abs=1.1 * TICK)  # it is due: the first touch counts
    assert np.array(flags).sum(axis=1).min() >= 2
    assert script.clock.next_liftoff(0, script.t) > TROT.period_s + 0.03


def test_a_missing_foot_no_longer_delays_the_others() -> None:
    script = Script()

    def abyss(t: float, contacts: np.ndarray) -> None:
        contacts[0] = False

    script.run(TROT.swing_s + SETTINGS.max_late_s + 0.03, abyss)
    assert script.sequence() == [SWING, LATE, MISSING]
    assert script.begin(MISSING) - script.begin(LATE) == pytest.approx(SETTINGS.max_late_s, abs=1.1 * TICK)
    assert script.events.searching(0) and not script.events.stance[0]
    assert not script.events.stance[1]  # the other pair went on
    script.run(script.t + TROT.period_s, abyss)
    assert script.sequence()[3] is SWING  # its next swing begins as scheduled


def test_a_missing_foot_that_finds_the_ground_carries() -> None:
    script = Script()
    found = TROT.swing_s + SETTINGS.max_late_s + 0.02

    def hole(t: float, contacts: np.ndarray) -> None:
        contacts[0] = t >= found

    script.run(found + 0.02, hole)
    assert script.sequence() == [SWING, LATE, MISSING, STANCE]


def test_a_stance_foot_that_loses_its_contact_is_lost_and_found() -> None:
    script = Script()
    gone = TROT.swing_s + 0.05

    def bump(t: float, contacts: np.ndarray) -> None:
        contacts[0] &= not gone <= t < gone + 0.06

    script.run(gone + 0.08, bump)
    assert script.sequence() == [SWING, STANCE, LOST, STANCE]
    assert script.begin(LOST) == pytest.approx(gone + SETTINGS.lost_time_s, abs=1.1 * TICK)


@pytest.mark.parametrize("standing", [False, True])
def test_the_foot_of_a_pushed_leg_is_lost_once_its_contact_has_been_gone_for_long_enough(standing: bool) -> None:
    """Also where it stands for good, from where no other foot is lost; the feet of legs that are not pushed stay."""
    script = Script()
    if standing:
        script.clock = GaitClock(Gait(name="stand", period_s=1.0, duty=1.0, offsets=(0.0,) * 4))
        script.events = ContactEvents(script.clock)
    gone = TROT.swing_s + 0.05
    script.events.pushed = [True, False, False, False]

    def bump(t: float, contacts: np.ndarray) -> None:
        contacts[[0, 3]] &= t < gone - 1e-9

    script.run(gone + 0.02, bump)
    assert script.sequence()[-2:] == [STANCE, LOST]
    assert script.begin(LOST) == pytest.approx(gone + SETTINGS.touch_time_s, abs=0.1 * TICK)
    assert script.events.states[3] is STANCE


def test_the_schedule_waits_longer_for_a_foot_below_the_ground_it_expected() -> None:
    waits = []
    for below in (False, True):
        script = Script(ContactEventSettings(max_search_s=0.06))
        script.below = [below, False, False, False]
        script.run(TROT.swing_s + 0.12, lambda t, contacts: contacts.__setitem__(0, False))
        waits.append(script.begin(MISSING) - script.begin(LATE))
    assert waits == [pytest.approx(SETTINGS.max_late_s, abs=1.1 * TICK), pytest.approx(0.06, abs=1.1 * TICK)]


@pytest.mark.parametrize("below", [False, True])
def test_no_foot_lifts_off_while_a_lost_one_descends_below_the_ground(below: bool) -> None:
    script = Script(ContactEventSettings(lost_time_s=0.004))
    gone, fewest = TROT.swing_s + 0.006, []

    def edge(t: float, contacts: np.ndarray) -> None:
        contacts[0] &= t < gone or t > gone + 0.08
        script.below[0] = below and gone < t < gone + 0.08
        if gone + 0.04 < t < gone + 0.08:
            fewest.append(int(script.events.stance.sum()))

    script.run(gone + 0.12, edge)
    assert LOST in script.sequence()
    assert min(fewest) == (3 if below else 1)


def test_a_short_gap_in_a_stance_is_no_loss() -> None:
    script = Script()
    gone = TROT.swing_s + 0.05

    def bounce(t: float, contacts: np.ndarray) -> None:
        contacts[0] &= not gone <= t < gone + 0.5 * SETTINGS.lost_time_s

    script.run(TROT.period_s - 0.01, bounce)
    assert script.sequence() == [SWING, STANCE]


def test_a_foot_that_hopped_is_steady_once_its_touch_counts() -> None:
    """Feet that slide are evidence about the floor; one that has just landed still moves as it did in the air."""

    def hop(t: float, contacts: np.ndarray) -> None:
        contacts[0] &= not 0.25 <= t < 0.252

    script, steady = Script(), {}
    for tick in range(240, 260):
        script.run(tick * TICK, hop)
        steady[tick] = script.events.steady(script.t - 0.018)[0]
    lands = 253  # run until 0.253 s: the last tick is the first in contact again
    counts = lands + round(SETTINGS.touch_time_s / TICK)
    assert [tick for tick in steady if not steady[tick]] == list(range(lands - 2, counts + 1))


@pytest.mark.parametrize("age", [0, 4])
def test_a_foot_that_loses_its_contact_is_airborne_until_it_touches_again(age: int) -> None:
    gone, back = 60, 75  # ticks after its touchdown
    script, found = Script(age=age), []
    touchdown = script.first.touchdown

    def bounce(t: float, contacts: np.ndarray) -> None:
        contacts[0] &= not gone * TICK <= t - touchdown < back * TICK

    for tick in range(round(touchdown / TICK), round(TROT.period_s / TICK) - 10):
        script.run(tick * TICK, bounce)
        found += [tick - round(touchdown / TICK)] * script.events.airborne(script.t - TICK)[0]
        assert not any(script.events.airborne(script.t - TICK)[1:])
    accepted = round(SETTINGS.touch_time_s / TICK)
    assert min(found) == gone + age + accepted + 1 and max(found) == back + age
    assert len(found) == back - gone - accepted  # and not when its touchdown was due, before the floor was measured


def test_the_horizon_begins_with_what_the_feet_do() -> None:
    script = Script()
    script.run(TROT.swing_s + 0.01, lambda t, contacts: contacts.__setitem__(0, False))
    flags = np.ones((10, 4), dtype=np.bool_)
    horizon = TimeGrid(0.02, 10, script.t)
    script.clock.horizon(horizon, flags)
    script.events.correct(flags, horizon)
    assert not flags[0, 0]
    assert flags[0, 1:].tolist() == script.events.stance[1:].tolist()
    assert flags[1, 0]  # expected to have landed
    script.events.correct(flags, TimeGrid(0.5 * SETTINGS.lookahead_s, 10, script.t))
    assert flags[:4, 0].tolist() == [False, False, False, True]


def test_the_force_bound_opens_after_touchdown_and_closes_before_lift_off() -> None:
    script = Script(ContactEventSettings(ramp_s=0.02, release_s=0.01))
    events = script.events
    script.run(TROT.swing_s - 0.01)
    assert events.loading(script.t)[0] == 0.0
    script.run(TROT.swing_s + 0.0105)
    t = events.since[0] + 0.01
    assert events.loading(t)[0] == pytest.approx(0.5)
    assert events.loading(t + 0.02)[0] == 1.0
    assert events.loading(TROT.period_s - 0.005)[0] == pytest.approx(0.5)


@pytest.mark.parametrize("late", [1, 2])
def test_a_late_foot_delays_the_lift_off_of_the_others_before_it_takes_place(late: int) -> None:
    """With a duty of one half the others lift off at the tick of the touchdown, whatever their index."""
    gait = Gait(name="trot", period_s=0.3, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0))
    clock = GaitClock(gait)
    events = ContactEvents(clock)
    states = []
    for k in range(900):
        t = k * TICK
        contacts = clock.flags(t)
        if 0.3 <= t < 0.306:  # the touchdown that is due at 0.3 s comes 6 ms later
            contacts[late] = False
        events.update(t, contacts)
        states.append(events.states[0])
    changes = [state for i, state in enumerate(states) if i == 0 or state is not states[i - 1]]
    swings = [i for i, state in enumerate(states) if state is SWING and (i == 0 or states[i - 1] is not SWING)]
    assert set(changes) == {SWING, STANCE}
    assert len(swings) == 3 and min(np.diff(swings)) > 250


def test_an_unloaded_foot_of_a_standing_robot_is_held_in_place() -> None:
    clock = GaitClock(Gait(name="stand", period_s=1.0, duty=1.0, offsets=(0.0,) * 4))
    events = ContactEvents(clock)
    for k in range(500):
        events.update(k * TICK, np.array([k < 100, True, True, True]))
    assert events.states == [STANCE] * 4 and events.stance.all()


AGES = pytest.mark.parametrize("age", [1, 4, 10])
"""Of measurements, ticks; a foot of this trot stands alone with its partner for 112 of them."""


@AGES
def test_an_old_measurement_delays_no_touchdown(age: int) -> None:
    script, twin = Script(age=age), GaitClock(TROT)
    flags = []
    while script.t < 3 * TROT.period_s:
        script.run(script.t + TICK)
        flags.append((script.events.stance == twin.flags(script.t - TICK)).all())
    assert script.sequence() == [SWING, STANCE, SWING, STANCE, SWING, STANCE]
    assert all(flags)


@AGES
def test_a_touchdown_that_is_measured_a_little_late_is_none(age: int) -> None:
    """The force of a foot that lands has to grow before it is measured."""
    script = Script(age=age)
    landing = TROT.swing_s + 0.5 * SETTINGS.touchdown_tolerance_s
    script.run(TROT.period_s - 0.01, lambda t, contacts: contacts.__setitem__(0, t >= landing))
    assert script.sequence() == [SWING, STANCE]
    assert script.begin(STANCE) == pytest.approx(TROT.swing_s, abs=1.1 * TICK)


@AGES
def test_a_late_foot_is_found_out_when_the_measurement_of_its_touchdown_arrives(age: int) -> None:
    script = Script(ContactEventSettings(max_late_s=0.1), age)
    found, waited = TROT.swing_s + 0.03, SETTINGS.touchdown_tolerance_s + age * TICK

    def hole(t: float, contacts: np.ndarray) -> None:
        contacts[0] = t >= found

    script.run(found + 0.05, hole)
    assert script.sequence() == [SWING, STANCE, LATE, STANCE]
    assert script.begin(LATE) == pytest.approx(TROT.swing_s + waited, abs=1.1 * TICK)
    again = next(t for t, state in script.history if state is STANCE and t > script.begin(LATE))
    assert again == pytest.approx(found + age * TICK, abs=1.1 * TICK)
    # The other pair, due at half a period, waited for it.
    assert script.clock.next_liftoff(0, script.t) > TROT.period_s + (found - 0.5 * TROT.period_s)


@AGES
def test_a_missing_foot_is_found_out_too(age: int) -> None:
    script = Script(age=age)
    script.run(TROT.swing_s + 0.05, lambda t, contacts: contacts.__setitem__(0, False))
    assert script.sequence() == [SWING, STANCE, LATE, MISSING]
    assert script.begin(MISSING) - script.begin(LATE) == pytest.approx(SETTINGS.max_late_s, abs=1.1 * TICK)
    assert not script.events.stance[0] and not script.events.stance[1]  # the other pair went on


@AGES
def test_a_touch_is_early_by_the_time_at_which_it_took_place(age: int) -> None:
    """Until just before half of the swing the foot drags; that is measured after half of it, and is no touchdown."""
    script = Script(age=age)
    drags = 0.5 * TROT.swing_s - 2 * TICK
    script.run(0.9 * TROT.swing_s, lambda t, contacts: contacts.__setitem__(0, t < drags))
    assert script.sequence() == [SWING]
    script = Script(age=age)
    touch = 0.7 * TROT.swing_s
    script.run(TROT.swing_s - TICK, lambda t, contacts: contacts.__setitem__(0, t >= touch))
    assert script.sequence() == [SWING, EARLY]
    assert script.begin(EARLY) == pytest.approx(touch + SETTINGS.touch_time_s + age * TICK, abs=1.1 * TICK)


@AGES
def test_a_robot_rests_when_its_last_touchdown_is_measured(age: int) -> None:
    script = Script(age=age)
    script.run(0.3 * TROT.period_s)
    script.clock.stop(script.t)
    rests, last = [], [0.0]

    def floor(t: float, contacts: np.ndarray) -> None:
        last[0] = last[0] if contacts.all() else t

    while script.t < 3 * TROT.period_s:
        script.run(script.t + TICK, floor)
        rests.append(script.events.resting)
    begin = rests.index(True) * TICK + 0.3 * TROT.period_s
    assert all(rests[rests.index(True) :])
    assert begin == pytest.approx(last[0] + age * TICK, abs=2.1 * TICK)
