"""The margins of footholds: what they admit is within reach, on its own side, and clear of the other feet."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgmpc.locomotion.clock import GaitClock
from lgmpc.locomotion.foothold_margins import FootholdMargins, tighten
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.gait import quadruped_gaits
from lgmpc.locomotion.horizon import ContactHorizon
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.robot.friction import facet_normals
from tests.support.samples import solo8

DT = 0.02


def corners(margins: np.ndarray) -> np.ndarray:
    """Corners of the polygon of normals and margins: intersections of sides that are within all others."""
    normals = facet_normals(len(margins))
    found = []
    for i in range(len(margins)):
        for j in range(i):
            pair = normals[[i, j]]
            if abs(np.linalg.det(pair)) > 1e-9:
                corner = np.linalg.solve(pair, margins[[i, j]])
                if (normals @ corner <= margins + 1e-9).all():
                    found.append(corner)
    return np.array(found)


@given(st.integers(3, 16), st.floats(-7.0, 7.0), st.floats(0.0, 0.3), st.floats(0.05, 0.3))
def test_no_shift_goes_further_than_a_tightened_margin(count: int, angle: float, distance: float, width: float) -> None:
    margins = np.full(count, width)
    tighten(margins, angle, distance)
    towards = np.array([math.cos(angle), math.sin(angle)])
    assert (corners(margins) @ towards).max() <= distance + 1e-9
    assert (margins >= 0.0).all()


def test_a_side_of_the_polygon_loses_nothing() -> None:
    margins = np.full(8, 0.2)
    tighten(margins, math.pi / 4, 0.1)
    np.testing.assert_allclose(margins, [0.2, 0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])


def written(
    legs: LegGeometry, motion: BaseMotion, gait: str, t: float, directions: int, fixed: tuple[int, ...] = ()
) -> tuple[FootholdPlanner, ContactHorizon, GaitClock]:
    """The horizon of a gait that began at time 0, at time ``t``."""
    planner = FootholdPlanner(legs)
    clock = GaitClock(quadruped_gaits()[gait])
    clock.advance(t)
    horizon = ContactHorizon.allocate(20, 4, directions)
    clock.horizon(t, DT, horizon.flags)
    contacts = np.zeros((4, 3))
    for foot in range(4):
        contacts[foot, :2] = planner.place(foot, motion, 0.06, 0.12)
    planner.horizon(clock, motion, t, DT, contacts, horizon.points)
    held = np.zeros(4, dtype=bool)
    held[list(fixed)] = True
    FootholdMargins(planner).write(horizon, clock, motion, t, DT, held)
    return planner, horizon, clock


@settings(max_examples=30)
@given(
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 0.24),
    st.sampled_from(["trot", "walk", "pace", "bound"]),
    st.integers(4, 12),
    st.floats(-0.05, 0.05),
)
def test_footholds_within_margins_are_within_reach_on_their_side_and_clear_of_other_feet(
    legs: LegGeometry,
    velocity: tuple[float, float, float],
    yaw: float,
    t: float,
    gait: str,
    directions: int,
    height: float,
) -> None:
    vx, vy, rate = velocity
    motion = BaseMotion(0.3, -0.2, vx, vy, yaw, yaw_rate=rate, commanded_vx=0.5 * vx, height=height)
    planner, horizon, clock = written(legs, motion, gait, t, directions)
    assert (horizon.margins >= 0.0).all()
    assert (horizon.margins[horizon.flags] == 0.0).all()
    for foot in range(4):
        column = horizon.flags[:, foot]
        for end in np.flatnonzero(column[1:] & ~column[:-1]) + 1:
            begin = end - 1
            while begin > 0 and not column[begin - 1]:
                begin -= 1
            margins, nominal = horizon.margins[begin, foot], horizon.points[end, foot, :2]
            assert (horizon.margins[begin:end, foot] == margins).all()
            (remaining,) = [
                swing.touchdown - t
                for swing in clock.swings(foot, t, t + DT * 20)
                if DT * (end - 1) < swing.touchdown - t <= DT * end + 1e-9
            ]
            com = np.array(planner.expected(motion, remaining, present=begin == 0))
            turned = yaw + rate * remaining
            axes = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
            own = math.copysign(1.0, legs.feet[foot, 1])
            at = axes @ (nominal - com)
            out = float(np.linalg.norm(at - planner.hips[foot]))
            most = planner.reach(foot, height)
            inside = out <= most * math.cos(math.pi / directions)
            # Where the nominal foothold itself breaks a bound, a shift breaks it by no more than the polygon's corners.
            reach = most if inside else max(most, out) / math.cos(math.pi / directions)
            for corner in corners(margins):
                place = nominal + corner
                local = axes @ (place - com)
                assert np.linalg.norm(local - planner.hips[foot]) <= reach + 1e-9
                assert own * local[1] >= min(own * planner.sides[foot], own * at[1]) - 1e-9
                for other in set(range(4)) - {foot}:
                    there = horizon.points[end, other, :2]
                    moves = not horizon.flags[end - 1, other]
                    away = float(np.linalg.norm(nominal - there))
                    least = 0.5 * (planner.spacing + away) if moves else planner.spacing
                    assert np.linalg.norm(place - there) >= min(least, away) - 1e-9


def test_a_fixed_foot_has_no_margin_in_its_present_swing(legs: LegGeometry) -> None:
    motion = BaseMotion(0.0, 0.0, 0.5, 0.0, 0.0, commanded_vx=0.5)
    _, free, _ = written(legs, motion, "trot", 0.03, 12)
    swinging = np.flatnonzero(~free.flags[0])
    assert swinging.size == 2
    _, fixed, _ = written(legs, motion, "trot", 0.03, 12, tuple(swinging))
    end = int(free.flags[:, swinging[0]].argmax())
    assert (fixed.margins[:end, swinging] == 0.0).all() and free.margins[:end, swinging].min() > 0.05
    np.testing.assert_array_equal(fixed.margins[end:], free.margins[end:])


def test_a_swing_that_ends_beyond_the_horizon_has_no_margin(legs: LegGeometry) -> None:
    _, horizon, _ = written(legs, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0), "trot", 0.0, 8)
    for foot in range(4):
        air = np.flatnonzero(~horizon.flags[:, foot])
        if not horizon.flags[-1, foot]:
            last = air[np.flatnonzero(np.diff(air, prepend=-9) > 1)[-1] :]
            assert (horizon.margins[last, foot] == 0.0).all()
    assert horizon.margins.max() > 0.05


def test_footholds_of_planar_legs_have_no_margin() -> None:
    motion = BaseMotion(0.0, 0.0, 0.4, 0.0, 0.6, commanded_vx=0.4)
    _, horizon, _ = written(LegGeometry.of(solo8()), motion, "trot", 0.03, 12)
    np.testing.assert_array_equal(horizon.margins, 0.0)


@pytest.mark.parametrize(("angle", "error"), [(0.0, 0.8), (math.pi, 1.4)], ids=["ahead", "back"])
def test_a_pushed_robot_has_little_room_where_it_is_pushed_to(legs: LegGeometry, angle: float, error: float) -> None:
    """Solo12, 2.5 kg, at 0.5 m/s: 2 N.s ahead and 3.5 N.s back take the heuristic footholds to the reach, 18 cm."""
    side = round(12 * angle / (2.0 * math.pi))
    landing = 0.5 * quadruped_gaits()["trot"].period_s
    rooms = []
    for share in (0.0, 1.0):
        motion = BaseMotion(0.0, 0.0, 0.5 + share * error * math.cos(angle), 0.0, 0.0, commanded_vx=0.5, friction=0.6)
        _, horizon, _ = written(legs, motion, "trot", landing - 0.06, 12)
        rooms.append(horizon.margins[0, ~horizon.flags[0], side])
    assert rooms[0].min() > 0.1
    assert rooms[1].max() < 0.007
