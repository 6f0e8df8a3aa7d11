"""Quadrotors that loop and recover: figures against an independent simulation, attitudes that pass every branch."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.ocp import Trajectory
from lgmpc.problems.flight import (
    FlightSettings,
    FlightWaypoint,
    FlightWeights,
    Multirotor,
    MultirotorSettings,
    build_flight,
    flown,
)
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import BoxFddp, FddpSettings, Solution, Status

pytestmark = pytest.mark.usefixtures("interpreted")
ROTORS = MultirotorSettings(
    frames=tuple(f"iris__rotor_{i}" for i in range(4)),
    turning=("ccw", "ccw", "cw", "cw"),
    max_thrust_n=7.0,
    drag_ratio_m=0.06,
)
LOOP = FlightSettings(
    rotors=ROTORS,
    start_m=(0.0, 0.0, 1.0),
    waypoints=(
        FlightWaypoint(name="entry", time_s=0.75, position_m=(1.5, 0.0, 1.0)),
        FlightWaypoint(name="top", time_s=1.5, position_m=(2.0, 0.0, 2.5), rotation_deg=(0.0, -180.0, 0.0)),
        FlightWaypoint(name="exit", time_s=2.25, position_m=(2.5, 0.0, 1.0)),
        FlightWaypoint(name="end", time_s=3.0, position_m=(4.0, 0.0, 1.0), rotation_deg=(0.0, -360.0, 0.0)),
    ),
)
NONE = (0.0, 0.0, 0.0)


def recovery(start: tuple[float, ...], rate: tuple[float, ...], goal: tuple[float, ...] = NONE) -> FlightSettings:
    hover = FlightWaypoint(name="hover", time_s=2.5, position_m=(0.0, 0.0, 5.0), rotation_deg=goal)
    return FlightSettings(
        rotors=ROTORS,
        start_m=(0.0, 0.0, 5.0),
        start_rotation_deg=start,
        start_rate_rad_s=rate,
        waypoints=(hover,),
        node_s=0.025,
        weights=FlightWeights(approach=1.0, rest=1e3),
    )


TUMBLE = recovery((0.0, 150.0, 0.0), (0.0, 8.0, 0.0), (0.0, 360.0, 0.0))


@lru_cache
def iris() -> Robot:
    return load_robot(RobotSpec(model="iris"))


@lru_cache
def loop() -> tuple[Solution, dict[str, float]]:
    scenario = build_flight(iris(), LOOP)
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    return solution, dict(scenario.figures(solution.trajectory))


@lru_cache
def tumble() -> tuple[Solution, dict[str, float]]:
    scenario = build_flight(iris(), TUMBLE)
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    return solution, dict(scenario.figures(solution.trajectory))


def test_the_loop_is_flown_upside_down_over_its_top_within_the_thrusts() -> None:
    solution, figures = loop()
    assert solution.status is Status.CONVERGED
    assert figures["waypoint_error_m"] < 1e-3 and figures["waypoint_rotation_error_deg"] < 0.1
    assert figures["integration_error_m"] < 1e-3  # by an independent integrator
    assert figures["inverted_tilt_deg"] > 179.9 and figures["final_tilt_deg"] < 0.1
    assert (figures["least_thrust_ratio"], figures["peak_thrust_ratio"]) == (0.0, 1.0)  # it takes all there is
    # Once round and no more: the nose's angle in the plane of the loop, counted up from node to node.
    nose = np.array([so3.from_quaternion(x[3:7])[:, 0] for x in solution.xs])
    turned = np.unwrap(np.arctan2(nose[:, 2], nose[:, 0]))
    assert turned[-1] == pytest.approx(2.0 * np.pi, abs=1e-2)
    assert solution.residual().largest < 1e-4 * max(1.0, np.abs(solution.costates).max())


def test_an_independent_flight_is_a_fall_without_thrust_and_rest_at_hover() -> None:
    vehicle = Multirotor.of(iris(), ROTORS)
    x0 = np.concatenate([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0], np.zeros(6)])
    x0[12] = 5.0  # spinning about the vertical axis changes nothing
    fallen = flown(vehicle, x0, np.zeros((2, 4)), np.array([0.3, 0.7]))
    np.testing.assert_allclose(fallen[:3], [1.0, 2.0, 3.0 - 9.81 / 2], rtol=0, atol=1e-7)
    hovering = flown(vehicle, np.concatenate([x0[:7], np.zeros(6)]), vehicle.hover[None], np.array([2.0]))
    np.testing.assert_allclose(hovering, [*x0[:7], *np.zeros(6)], rtol=0, atol=1e-9)
    # Rotors that turn counter-clockwise drag the body clockwise.
    more = vehicle.hover + 0.1 * np.array([1, 1, -1, -1])
    assert flown(vehicle, np.concatenate([x0[:7], np.zeros(6)]), more[None], np.array([0.1]))[12] < 0.0


def test_figures_of_a_flight_that_misses_its_waypoints() -> None:
    scenario = build_flight(iris(), LOOP)
    figures = scenario.figures(scenario.problem.rollout(scenario.guess.us))  # it just hovers at the start
    assert figures["waypoint_error_m"] == pytest.approx(4.0)
    assert figures["waypoint_rotation_error_deg"] == pytest.approx(180.0, abs=1e-3)
    assert figures["inverted_tilt_deg"] == pytest.approx(0.0, abs=1e-6)


def test_the_tumbling_body_passes_pitch_90_and_rotation_pi_without_a_jump() -> None:
    solution, figures = tumble()
    assert solution.status is Status.CONVERGED
    assert figures["final_tilt_deg"] < 0.1 and figures["final_error_m"] < 1e-3
    assert figures["integration_error_m"] < 5e-3
    # The attitude turns smoothly, no further from node to node than its rates allow ...
    rates = np.linalg.norm(solution.xs[:, 10:], axis=1).max()
    assert figures["attitude_step_deg"] <= np.degrees(1.1 * rates * TUMBLE.node_s)
    # ... and charts of it jump: roll and yaw by half a turn, the rotation vector by nearly a whole one.
    assert figures["rpy_jump_deg"] == pytest.approx(180.0, abs=1e-3)
    assert figures["log_jump_deg"] > 340.0
    nose_up = [so3.from_quaternion(x[3:7])[2, 0] for x in solution.xs]
    assert max(nose_up) > 0.98 or min(nose_up) < -0.98  # the nose, near the vertical
    tilts = [attitude.tilt(so3.from_quaternion(x[3:7])) for x in solution.xs]
    assert 0 < int(np.argmax(tilts)) < 10 and np.degrees(max(tilts)) > 170.0  # on its back between two nodes


def test_a_turned_world_gives_the_turned_solution() -> None:
    """The symmetry that gravity leaves: headings, moves, and the sign of quaternions change nothing else."""
    first, _ = tumble()
    yaw, shift = so3.exp(np.array([0.0, 0.0, 2.4])), np.array([3.0, -7.0, 1.0])
    scenario = build_flight(iris(), TUMBLE)
    problem = scenario.problem

    def moved(x: np.ndarray) -> np.ndarray:
        q = pin.Quaternion(yaw) * pin.Quaternion(x[3:7])
        return np.concatenate([yaw @ x[:3] + shift, -q.coeffs(), x[7:]])

    problem.set_initial_state(moved(problem.x0))
    problem.set("position_reference", yaw @ np.array(TUMBLE.start_m) + shift)
    problem.set("rotation_reference", -pin.Quaternion(yaw).coeffs())
    guess = Trajectory(np.array([moved(x) for x in scenario.guess.xs]), scenario.guess.us)
    other = BoxFddp(problem).solve(guess)
    assert other.status is Status.CONVERGED
    assert other.cost == pytest.approx(first.cost, rel=1e-8)
    np.testing.assert_allclose(other.us, first.us, rtol=0, atol=1e-3)
    state = problem.state
    for x, theirs in zip(other.xs, first.xs, strict=True):
        np.testing.assert_allclose(state.diff(moved(theirs), x), 0.0, atol=1e-3)


@pytest.mark.slow
def test_recovers_from_random_attitudes() -> None:
    rng = np.random.default_rng(5)
    problem = build_flight(iris(), recovery((0.0, 180.0, 0.0), NONE)).problem
    solver = BoxFddp(problem, FddpSettings(tolerance=1e-6))
    for _ in range(6):
        turn = rng.standard_normal(3)
        turn *= rng.uniform(60.0, 175.0) / np.linalg.norm(turn)
        scenario = build_flight(iris(), recovery(tuple(turn), tuple(rng.uniform(-4, 4, 3))))
        problem.set_initial_state(scenario.problem.x0)
        solution = solver.solve(scenario.guess, max_iterations=200)
        figures = scenario.figures(solution.trajectory)
        assert solution.status is Status.CONVERGED, turn
        assert figures["final_tilt_deg"] < 0.1 and figures["final_error_m"] < 0.01
        assert figures["attitude_step_deg"] < 45.0


@pytest.mark.slow
def test_from_upside_down_at_rest_it_turns_in_the_sense_of_the_guess() -> None:
    """Without a guess that turns it is a saddle: no thrust is better than another, and a solver stays there."""
    scenario = build_flight(iris(), recovery((180.0, 0.0, 0.0), NONE))
    solver = BoxFddp(scenario.problem)
    for sign in (1.0, -1.0):
        towards = recovery((180.0 * sign, 0.0, 0.0), NONE)
        solution = solver.solve(build_flight(iris(), towards).guess, max_iterations=300)
        assert solution.status is Status.CONVERGED
        assert np.degrees(attitude.tilt(so3.from_quaternion(solution.xs[-1][3:7]))) < 0.1
        assert np.sign(solution.xs[20, 10]) == -sign
    still = solver.solve(scenario.problem.hold())
    assert np.degrees(attitude.tilt(so3.from_quaternion(still.xs[-1][3:7]))) == pytest.approx(180.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"waypoints": ()}, "waypoints"),
        (
            {"waypoints": (FlightWaypoint(name="a", time_s=0.1, position_m=NONE),)},
            "'a' at 0.1 s; expected a multiple of the intervals' length, 0.03 s",
        ),
        (
            {"waypoints": (FlightWaypoint(name="a", time_s=3e7, position_m=NONE),)},
            r"'a' at 3e\+07 s; expected at most 300 s: 10000 intervals of 0.03 s",
        ),
        ({"waypoints": LOOP.waypoints[::-1]}, "'exit' at 2.25 s; expected later than 3 s"),
        ({"node_s": 1e-9}, "node_s: got 1e-09; expected a number not below 0.0001"),
        ({"rotors.max_thrust_n": 3.0}, "rotors.max_thrust_n: got 3.0; expected above 3.76 N"),
        ({"rotors.turning": ("ccw",)}, r"rotors.turning: got the list \[ccw\]; expected 4 of ccw and cw"),
        ({"rotors.frames": ("iris__rotor_0",), "rotors.turning": ("cw",)}, "about the centre of mass"),
        ({"rotors.frames.0": "iris__rotor_9"}, "rotors.frames.0: got iris__rotor_9; expected a frame of iris"),
    ],
)
def test_impossible_flights_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_flight(iris(), LOOP.replace(changes))


def test_a_robot_with_joints_is_no_multirotor() -> None:
    solo = load_robot(
        RobotSpec(model="solo12", effort_limit_nm=1.8, velocity_limit_rad_s=30.0, position_limit_rad=(-3.0, 3.0))
    )
    with pytest.raises(InputError, match="robot: got solo12, 18 degrees of freedom; expected a single free body"):
        build_flight(solo, TUMBLE)
