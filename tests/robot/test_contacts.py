"""Contact schedules: flags at node times, phases and swings, once or for ever."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgmpc.errors import InputError
from lgmpc.robot import ContactPhase, ContactSchedule, Swing

FEET = ("FL", "FR", "HL", "HR")
TROT = (ContactPhase(0.2, FEET), ContactPhase(0.3, ("FL", "HR")), ContactPhase(0.3, ("FR", "HL")))
JUMP = (ContactPhase(0.5, FEET), ContactPhase(0.25, ()), ContactPhase(math.inf, FEET))


def test_standing() -> None:
    schedule = ContactSchedule.standing(FEET)
    assert schedule.flags([-5.0, 0.0, 1e6]).tolist() == [[True] * 4] * 3
    assert schedule.swing("FL", 3.0) is None


def test_flags_at_node_times_that_are_sums_of_rounded_steps() -> None:
    schedule = ContactSchedule(FEET, TROT)
    times = np.cumsum(np.full(8, 0.1))  # 0.1 ... 0.7999999999999999
    flags = schedule.flags(times)
    assert flags.dtype == np.bool_ and flags.shape == (8, 4)
    both, left, right = [True] * 4, [True, False, False, True], [False, True, True, False]
    assert flags.tolist() == [both, left, left, left, right, right, right, right]


def test_phases_hold_before_the_start_and_after_the_end() -> None:
    schedule = ContactSchedule(FEET, TROT, start=1.0)
    assert schedule.phase(0.0) is TROT[0]
    assert schedule.phase(99.0) is TROT[2]
    assert schedule.duration == pytest.approx(0.8)


def test_cycles_repeat_in_both_directions() -> None:
    schedule = ContactSchedule(FEET, TROT, start=0.05, cyclic=True)
    times = np.arange(0.0, 0.8, 0.01)
    for cycle in (-3, 1, 1000):
        assert (schedule.flags(times + cycle * schedule.duration) == schedule.flags(times)).all()


def test_flags_keep_the_shape_of_the_times() -> None:
    schedule = ContactSchedule(FEET, TROT)
    assert schedule.flags(0.3).shape == (4,)
    assert schedule.flags(np.zeros((2, 3))).shape == (2, 3, 4)
    assert ContactSchedule((), (ContactPhase(1.0, ()),)).flags([0.0, 1.0]).shape == (2, 0)


def test_swings_within_a_schedule() -> None:
    schedule = ContactSchedule(FEET, JUMP, start=1.0)
    assert schedule.swing("FL", 1.2) is None
    assert schedule.swing("FL", 1.6) == Swing(1.5, 1.75)
    assert schedule.swing("FL", 1.75) is None
    landing_never = ContactSchedule(FEET, JUMP[:2])
    assert landing_never.swing("HR", 9.0) == Swing(0.5, math.inf)
    dropped = ContactSchedule(FEET, JUMP[1:])
    assert dropped.swing("HR", 0.1) == Swing(-math.inf, 0.25)


def test_swings_across_cycles() -> None:
    phases = (ContactPhase(0.1, ()), ContactPhase(0.5, FEET), ContactPhase(0.2, ("FL",)))
    schedule = ContactSchedule(FEET, phases, cyclic=True)
    for time in (0.65, 0.85, 1.45):
        swing = schedule.swing("FR", time)
        cycle = math.floor((time - 0.6) / 0.8)
        assert swing is not None
        assert (swing.liftoff, swing.touchdown) == pytest.approx((0.6 + 0.8 * cycle, 0.9 + 0.8 * cycle))
    hop = schedule.swing("FL", 0.05)
    assert hop is not None and (hop.liftoff, hop.touchdown) == pytest.approx((0.0, 0.1))
    never = ContactSchedule(FEET, (ContactPhase(0.1, ("FL",)),), cyclic=True)
    assert never.swing("HR", 0.3) == Swing(-math.inf, math.inf)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.05, 2.0), st.sets(st.sampled_from(FEET))), min_size=1, max_size=5),
    st.floats(-10.0, 10.0),
    st.booleans(),
    st.sampled_from(FEET),
)
def test_a_swing_holds_exactly_while_the_flag_is_off(phases, time, cyclic, foot) -> None:
    schedule = ContactSchedule(FEET, tuple(ContactPhase(*phase) for phase in phases), cyclic=cyclic)
    column = FEET.index(foot)
    swing = schedule.swing(foot, time)
    assert (swing is None) == bool(schedule.flags(time)[column])
    if swing is not None:
        assert swing.liftoff <= time + 1e-6 and time <= swing.touchdown + 1e-6
        inside = np.linspace(max(swing.liftoff, time - 20.0), min(swing.touchdown, time + 20.0), 50)[1:-1]
        assert not schedule.flags(inside)[:, column].any()
        for edge in (swing.liftoff - 1e-6, swing.touchdown + 1e-6):
            assert math.isinf(edge) or schedule.flags(edge)[column]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ContactPhase(0.0, FEET), "duration: got 0.0; expected a contact phase longer than 0 s"),
        (lambda: ContactPhase(math.nan, FEET), "duration: got nan"),
        (lambda: ContactSchedule(FEET, ()), "phases: got none"),
        (lambda: ContactSchedule(FEET, (ContactPhase(1, "FX"),)), r"phases\[0\].stance: got FX; .*Did you mean F"),
        (lambda: ContactSchedule(FEET, JUMP, cyclic=True), r"phases\[2\].duration: got inf"),
        (lambda: ContactSchedule(FEET, JUMP, start=math.inf), "start: got inf"),
        (lambda: ContactSchedule(FEET, TROT).flags([0.0, math.nan]), "times: got nan"),
        (lambda: ContactSchedule(FEET, TROT).swing("FK", 0.0), "frame: got FK"),
    ],
)
def test_bad_input(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
