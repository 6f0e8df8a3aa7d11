"""Times at equal distances, against searches among the nodes, and whole ratios of rates."""

import bisect
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lgmpc.config.build import build_controller, build_robot
from lgmpc.config.loading import load_config
from lgmpc.control.planner import Planner
from lgmpc.errors import InputError
from lgmpc.simulation import control_ticks
from lgmpc.timegrid import TimeGrid, minimum_jerk, periods_in

GRIDS = st.builds(TimeGrid, st.floats(1e-3, 1.0), st.integers(1, 60), st.floats(0.0, 100.0))
SHARES = st.floats(-2.0, 62.0)


@given(GRIDS)
def test_every_node_is_found_by_its_time(grid: TimeGrid) -> None:
    numbers, nodes = list(range(grid.count + 1)), grid.nodes
    np.testing.assert_allclose(nodes, np.linspace(grid.start, grid.end, grid.count + 1), rtol=1e-14)
    for found in (grid.nearest, grid.first_from, grid.interval):
        assert [found(float(time)) for time in nodes] == numbers
    moved = grid.begun_at(grid.start + 7.0)
    np.testing.assert_allclose(moved.nodes, nodes + 7.0, rtol=1e-14)
    assert moved.elapsed is grid.elapsed and not grid.elapsed.flags.writeable


@given(GRIDS, SHARES)
def test_a_time_between_nodes_is_found_by_search(grid: TimeGrid, share: float) -> None:
    if abs(2.0 * share - round(2.0 * share)) < 1e-6:
        return  # at a node or in the middle between two rounding decides
    time, nodes = grid.start + share * grid.period, grid.nodes.tolist()
    assert grid.first_from(time) == min(bisect.bisect_left(nodes, time), grid.count)
    if 0.0 < share < grid.count:
        assert grid.interval(time) == bisect.bisect_left(nodes, time) - 1
        assert grid.nearest(time) == int(np.abs(grid.nodes - time).argmin())


@given(st.integers(1, 1000), st.floats(1.0, 1e4))
def test_the_periods_of_a_whole_ratio_are_counted(ratio: int, slow: float) -> None:
    assert periods_in("slow", slow, "fast", ratio * slow) == ratio
    assert periods_in("slow", slow, "fast", 1.0 / (1.0 / (ratio * slow))) == ratio  # by way of the period
    assert TimeGrid(1.0 / slow).nearest(ratio / slow) == ratio
    with pytest.raises(InputError, match=r"slow: got .*; expected fast \(.*\) divided by a whole number"):
        periods_in("slow", slow, "fast", (ratio + 0.01) * slow)
    with pytest.raises(InputError, match="slow: got"):
        periods_in("slow", (ratio + 1) * slow, "fast", slow)


def _planned(rate_hz: float) -> None:
    config = load_config("solo12_balance")
    robot = build_robot(config)
    planner = build_controller(config, robot).planner
    assert planner is not None
    Planner(robot, planner.mpc, 1.0 / rate_hz)


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda: control_ticks(1e-3, 300.0, 1.0), "wbc.rate_hz: got 300.0; expected plant.rate_hz (1000) divided"),
        (lambda: control_ticks(1e-3, 500.0, 4e-4), "duration_s: got 0.0004; expected at least one control tick"),
        (lambda: _planned(1050.0), "mpc.rate_hz: got 100.0; expected wbc.rate_hz (1050) divided by a whole number"),
        (lambda: _planned(50.0), "mpc.rate_hz: got 100.0; expected wbc.rate_hz (50) divided by a whole number"),
    ],
)
def test_rates_that_do_not_divide_are_refused_by_their_key(use: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError) as error:
        use()
    assert message in str(error.value)
    assert control_ticks(1e-3, 500.0, 0.1) == TimeGrid(0.002, 50)


def test_minimum_jerk_is_at_rest_at_its_ends_and_has_its_own_derivatives() -> None:
    np.testing.assert_allclose(minimum_jerk(np.array([0.0, 1.0])), [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-15)
    x, h = np.linspace(0.1, 0.9, 9), 1e-6
    before, now, after = (minimum_jerk(x + each) for each in (-h, 0.0, h))
    for order in (0, 1):
        np.testing.assert_allclose((after[order] - before[order]) / (2.0 * h), now[order + 1], atol=1e-8)
