"""Shapes that keep a distance in problems of configs, measured by coal, and gains of single contacts."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from lgmpc.config import load_solve_config
from lgmpc.config.solving import build_scenario
from lgmpc.errors import ConfigError, InputError
from lgmpc.problems.reach import ReachSettings, build_reach
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import LineSearchSqp, Solution, Status

pytestmark = pytest.mark.usefixtures("interpreted")
BALL = {"kind": "sphere", "link": "universe", "center_m": [0.45, -0.2, 0.45], "radius_m": 0.1}
BOX = {"kind": "box", "link": "universe", "center_m": [0.45, -0.2, 0.45], "half_size_m": [0.09, 0.08, 0.1]}
HAND = {"kind": "capsule", "link": "panda_hand", "radius_m": 0.06, "half_length_m": 0.05}
NEAR = {"first": HAND, "second": BALL, "distance_m": 0.03}


def reach(**clearance: object) -> ReachSettings:
    apart = [{**NEAR, **clearance}]
    return ReachSettings(frame="panda_hand_tcp", position_m=(0.35, -0.45, 0.25), nodes=20, node_s=0.05).replace(
        {"clearances": apart}
    )


@lru_cache
def panda() -> Robot:
    return load_robot(RobotSpec(model="panda"))


@lru_cache
def straight() -> Solution:
    """The reach with nothing in its way."""
    free = build_reach(panda(), reach().replace({"clearances": []}))
    solution = LineSearchSqp(free.problem).solve(free.guess)
    assert "clearance_m" not in free.figures(solution.trajectory)
    return solution


@pytest.mark.parametrize("weight", [None, 1e5])
def test_a_hand_keeps_its_distance_from_a_ball_in_its_way(weight: float | None) -> None:
    apart = build_reach(panda(), reach(weight=weight))
    assert apart.figures(straight().trajectory)["clearance_m"] < 0.0
    solution = LineSearchSqp(apart.problem).solve(apart.guess)
    assert solution.status is Status.CONVERGED, solution.explain()
    least = apart.figures(solution.trajectory)["clearance_m"]
    # A constraint holds at the beginning of each interval, the cost weighs it against the rest.
    assert abs(least - 0.03) < 1e-6 if weight is None else 0.02 < least < 0.03


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"first": {**HAND, "link": "panda_hnd"}}, "clearances.0.first.link: got panda_hnd; .*Did you mean panda_hand"),
        ({"second": {**HAND, "radius_m": 0.1}}, "clearances.0: got .* on one joint; expected shapes that can move"),
    ],
)
def test_unknown_links_and_pairs_that_cannot_move_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_reach(panda(), reach(**change))


def test_a_hand_keeps_its_distance_from_a_box_in_its_way() -> None:
    ball = {"kind": "sphere", "link": "panda_hand", "radius_m": 0.06}
    apart = build_reach(panda(), reach(first=ball, second=BOX))
    assert apart.figures(straight().trajectory)["clearance_m"] < 0.0
    solution = LineSearchSqp(apart.problem).solve(apart.guess)
    assert solution.status is Status.CONVERGED, solution.explain()
    assert abs(apart.figures(solution.trajectory)["clearance_m"] - 0.03) < 1e-6


def test_a_box_and_a_capsule_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"clearances.0: got '.*', a capsule; expected a sphere, because '.*' is a box"
    ):
        build_reach(panda(), reach(second=BOX))


def test_gains_of_one_contact_leave_those_of_the_others() -> None:
    plain = build_scenario(load_solve_config("solo12_trot")).problem
    config = load_solve_config("solo12_trot", ["problem.contact_gains={FR_FOOT: [123.0, 45.0]}"])
    problem = build_scenario(config).problem
    where = problem.actions[0].parameters["contact_gains"]
    default, given = plain.parameters[0, where], problem.parameters[0, where]
    np.testing.assert_array_equal(given[2:4], [123.0, 45.0])
    np.testing.assert_array_equal(np.delete(given, [2, 3]), np.delete(default, [2, 3]))


def test_gains_of_a_frame_that_is_no_contact_are_refused() -> None:
    config = load_solve_config("solo12_trot", ["problem.contact_gains={FR_FOT: [123.0, 45.0]}"])
    with pytest.raises(ConfigError, match="problem.contact_gains.*FR_FOT.*FR_FOOT"):
        build_scenario(config)
