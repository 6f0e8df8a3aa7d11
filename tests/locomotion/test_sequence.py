"""Sequences of gait phases: durations, orders of feet, swings that span phases, grids that end on switches."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.errors import InputError
from lgmpc.locomotion.sequence import FootSwing, GaitPhase, GaitSequence, QuadrupedFeet
from lgmpc.robot import Robot, RobotSpec, load_robot

FEET = ("FL", "FR", "HL", "HR")
LEGS = QuadrupedFeet(*FEET)
CYCLES = {"walk": GaitSequence.walk, "trot": GaitSequence.trot, "pace": GaitSequence.pace, "bound": GaitSequence.bound}


def solo12() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("HR_FOOT", "FL_FOOT", "HL_FOOT", "FR_FOOT"),
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.0, 3.0),
        )
    )


@st.composite
def gaits(draw: st.DrawFn) -> GaitSequence:
    """Gaits that begin and end with all feet on the ground."""
    phase = st.builds(
        GaitPhase,
        duration_s=st.floats(0.01, 0.5),
        air=st.sets(st.sampled_from(FEET)).map(tuple),
        height_m=st.floats(0.0, 0.2),
    )
    ends = [GaitPhase(duration_s=draw(st.floats(0.01, 0.5))) for _ in range(2)]
    return GaitSequence(FEET, (ends[0], *draw(st.lists(phase, min_size=1, max_size=8)), ends[1]))


@pytest.mark.parametrize("name", CYCLES)
def test_every_foot_swings_once_a_cycle(name: str) -> None:
    cycle = CYCLES[name](FEET, LEGS, swing=0.3, stance=0.1, height=0.05)
    assert Counter(foot for phase in cycle.phases for foot in phase.air) == dict.fromkeys(FEET, 1)
    assert {phase.height_m for phase in cycle.phases if phase.air} == {0.05}
    groups = 4 if name == "walk" else 2
    assert cycle.duration == pytest.approx(groups * 0.4, abs=1e-14)
    assert (2 * cycle).duration == pytest.approx(groups * 0.8, abs=1e-14)


def test_which_feet_move_together() -> None:
    def order(cycle: GaitSequence) -> list[set[str]]:
        return [set(phase.air) for phase in cycle.phases]

    given = (FEET, LEGS, 0.2, 0.0, 0.05)  # no pause between
    assert order(GaitSequence.walk(*given)) == [{"HL"}, {"FL"}, {"HR"}, {"FR"}]
    assert order(GaitSequence.trot(*given)) == [{"FL", "HR"}, {"FR", "HL"}]
    assert order(GaitSequence.pace(*given)) == [{"FL", "HL"}, {"FR", "HR"}]
    assert order(GaitSequence.bound(*given)) == [{"FL", "FR"}, {"HL", "HR"}]
    assert order(GaitSequence.jump(FEET, 0.3, 0.2, 0.4, 0.1)) == [set(), set(FEET), set()]


def test_a_quadrupeds_feet_are_assigned_by_their_places() -> None:
    assert QuadrupedFeet.of(solo12()) == QuadrupedFeet("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    talos = load_robot(RobotSpec(model="talos", contact_frames=("left_sole_link", "right_sole_link")))
    with pytest.raises(InputError, match="four feet"):
        QuadrupedFeet.of(talos)


def test_a_swing_that_spans_phases() -> None:
    gait = GaitSequence(
        FEET,
        (
            GaitPhase(duration_s=0.1),
            GaitPhase(duration_s=0.2, air=["FL"], height_m=0.03),
            GaitPhase(duration_s=0.3, air=["FL", "HR"], height_m=0.05),
            GaitPhase(duration_s=0.1),
        ),
    )
    (swing,) = gait.swings("FL")
    assert swing == FootSwing("FL", pytest.approx(0.1), pytest.approx(0.6), 0.05)
    assert gait.swings("HR")[0].liftoff == pytest.approx(0.3)
    assert gait.swings("FR") == ()


def test_swings_without_beginning_or_end() -> None:
    (first,) = GaitSequence(FEET, (GaitPhase(duration_s=0.2, air=("FL",)), GaitPhase(duration_s=0.1))).swings("FL")
    (last,) = GaitSequence(FEET, (GaitPhase(duration_s=0.1), GaitPhase(duration_s=0.2, air=("FL",)))).swings("FL")
    assert (first.liftoff, first.touchdown) == (-math.inf, pytest.approx(0.2))
    assert (last.liftoff, last.touchdown) == (pytest.approx(0.1), math.inf)


@given(gaits(), st.floats(0.004, 0.06))
def test_the_grid_ends_on_every_switch_and_agrees_with_the_swings(gait: GaitSequence, step: float) -> None:
    grid = gait.grid(step)
    assert grid.durations.sum() == pytest.approx(gait.duration, abs=1e-12)
    for switch in gait.switches:
        assert np.abs(grid.times - switch).min() < 1e-12
    moving = ~grid.impacts
    middles = (grid.times[:-1] + grid.times[1:])[moving] / 2
    for i, foot in enumerate(FEET):
        swings = gait.swings(foot)
        aloft = [any(swing.liftoff < t < swing.touchdown for swing in swings) for t in middles]
        np.testing.assert_array_equal(grid.flags[moving, i], np.logical_not(aloft))
    assert (grid.durations[moving] > 0).all() and (grid.durations[~moving] == 0).all()
    assert grid.durations.max() <= max(1.5 * step, 1e-9)  # rounding to the nearest number of intervals


@given(gaits())
def test_an_impact_for_every_touchdown(gait: GaitSequence) -> None:
    grid = gait.grid(0.02)
    for i, foot in enumerate(FEET):
        hits = grid.times[:-1][grid.touchdowns[:, i]]
        np.testing.assert_allclose(hits, [swing.touchdown for swing in gait.swings(foot)], atol=1e-12)
    assert (grid.flags | ~grid.touchdowns).all()  # a foot that comes down is on the ground
    before = np.vstack([np.ones((1, 4), dtype=bool), grid.flags[:-1]])
    assert not (before & grid.touchdowns).any()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GaitPhase(duration_s=0.0), "duration_s"),
        (lambda: GaitPhase(duration_s=math.inf), "duration"),
        (lambda: GaitPhase(duration_s=0.1, air=("FL",), height_m=-0.1), "height"),
        (lambda: GaitPhase(duration_s=0.1, air=("FL",), height_m=math.nan), "height"),
        (lambda: GaitSequence(FEET, ()), "phases"),
        (lambda: GaitSequence(FEET, (GaitPhase(duration_s=0.1, air=("FX",)),)), "FL"),
        (lambda: GaitSequence.stand(FEET, 0.1) * 0, "cycles"),
        (lambda: GaitSequence.stand(FEET, 0.1) + GaitSequence.stand(("A", "B"), 0.1), "feet"),
        (lambda: GaitSequence.stand(FEET, 0.1).swings("FX"), "foot"),
        (lambda: GaitSequence.stand(FEET, 0.1).grid(0.0), "step"),
        (lambda: GaitSequence.stand(FEET, 0.1).grid(1e-9), "step: got 1e-09; expected at least 1e-05 s"),
        (lambda: GaitSequence.stand(FEET, 0.1).grid(1e-320), "step"),
        (lambda: GaitSequence.trot(FEET, LEGS, 0.2, -0.1, 0.05), "duration"),
    ],
)
def test_refusals(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
