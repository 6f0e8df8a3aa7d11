"""When a standing robot steps: the forecast capture point against the support."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.locomotion.gait import quadruped_gaits
from lgmpc.locomotion.reaction import StepReaction, StepReactionSettings, forecast_cost, least, step_schedules

SQUARE = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])


def test_it_steps_where_the_pendulum_would_leave_the_support() -> None:
    """A pendulum of 0.2452 m has the time constant 0.1581 s."""
    height = 0.025 * 9.81
    reaction = StepReaction(StepReactionSettings(margin_m=0.02), height)
    com, ahead = np.array([0.0, 0.0, height]), 0.2 / math.sqrt(0.025)
    points = np.column_stack([SQUARE, np.zeros(4)])
    assert not reaction.needed(com, np.array([0.89 * ahead, 0.0, 0.0]), points)
    assert reaction.needed(com, np.array([0.91 * ahead, 0.0, 0.0]), points)


def test_schedules_are_every_pace_with_every_group_of_feet_first() -> None:
    trot, bound, pronk = (quadruped_gaits()[name] for name in ("trot", "bound", "pronk"))
    schedules = step_schedules(trot, (0.75, 1.0))
    assert [(each.gait.period_s, each.first) for each in schedules] == [
        (0.75 * trot.period_s, 0), (0.75 * trot.period_s, 1), (trot.period_s, 0), (trot.period_s, 1)
    ]  # fmt: skip
    assert [each.first for each in step_schedules(bound, (1.0,))] == [0, 2]
    assert [each.first for each in step_schedules(pronk, (1.0,))] == [0]
    forces = np.array([1.0, 2.0, 4.0, 8.0])
    assert [each.load(forces) for each in step_schedules(trot, (1.0,))] == [9.0, 6.0]


@given(costs=st.lists(st.floats(0.0, 100.0) | st.just(math.inf), min_size=1, max_size=8), data=st.data())
def test_no_schedule_costs_less_than_the_chosen_one(costs: list[float], data: st.DataObject) -> None:
    ties = data.draw(st.lists(st.floats(0.0, 30.0), min_size=len(costs), max_size=len(costs)))
    chosen = least(costs, ties)
    assert costs[chosen] <= 1.001 * min(costs)
    assert all(ties[chosen] <= tie for cost, tie in zip(costs, ties, strict=True) if cost == costs[chosen])


def test_a_forecast_costs_more_the_further_the_faster_and_the_more_turned_it_is() -> None:
    rest, com = np.zeros((21, 9)), np.zeros((21, 3))
    assert forecast_cost(rest, com, 2.5) == 0.0
    costs = []
    for column, size in ((0, 0.1), (4, 1.0), (8, 0.1)):
        moved = [rest.copy() for _ in range(2)]
        moved[0][:, column], moved[1][:, column] = size, 2.0 * size
        costs.append([forecast_cost(xs, com, 2.5) for xs in moved])
    for single, double in costs:
        assert double == pytest.approx(4.0 * single) and single > 0.0
