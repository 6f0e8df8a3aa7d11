"""The falling cat's problem: leg strokes rotate a robot by holonomy, and integration errors do not pass."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import attitude, so3
from lgmpc.ocp import Trajectory
from lgmpc.problems import LegStrokes, RightingSettings, Scenario, build_righting
from lgmpc.problems.motion import com_positions, refly, spins, trunk_clearance
from lgmpc.problems.righting import falling_motion
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import LineSearchSqp, Solution, Status
from lgmpc.typing import Array

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
STROKES = LegStrokes(
    stretched_rad={"F?_HFE": 0.05, "F?_KFE": -0.1, "H?_HFE": -0.05, "H?_KFE": 0.1},
    folded_rad={"F?_HFE": 1.35, "F?_KFE": -2.6, "H?_HFE": -1.35, "H?_KFE": 2.6},
    sweep_rad={"*_HAA": 1.2},
)
TIMES: Array = 0.005 * np.arange(241, dtype=np.float64)
SPEED = 9.81 * 0.6


@lru_cache
def solo12(effort: float = 1.8) -> Robot:
    ranges = {"*_HAA": (-1.5, 1.5), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)}
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=FEET,
            contact_radius_m=0.016,
            posture="standing",
            effort_limit_nm=effort,
            velocity_limit_rad_s=30.0,
            position_limit_rad=ranges,
            armature_kg_m2=3.6e-4,
        )
    )


@lru_cache
def scenario() -> Scenario:
    return build_righting(solo12(), RightingSettings(strokes=STROKES, velocity_m_s=(0.0, 0.0, SPEED)))


def upside_down(robot: Robot, speed: float = 0.0) -> Array:
    x = robot.x_reference.copy()
    x[:7] = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    x[robot.nq + 2] = -speed
    return x


def fall(strokes: LegStrokes, effort: float = 1.8) -> Trajectory:
    robot = solo12(effort)
    return falling_motion(robot, upside_down(robot, SPEED), strokes.joints(robot, TIMES), TIMES)


def turn_deg(motion: Trajectory) -> Array:
    """Rotation from the first attitude to the last, in the base's axes."""
    return np.degrees(so3.log(so3.from_quaternion(motion.xs[0][3:7]).T @ so3.from_quaternion(motion.xs[-1][3:7])))


def test_strokes_begin_and_end_at_rest_in_the_reference_posture() -> None:
    robot = solo12()
    path = STROKES.joints(robot, TIMES)
    ends = [0.0, TIMES[-1]]
    np.testing.assert_allclose(path(ends), np.tile(robot.q_reference[7:], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(path(ends, 1), 0.0, atol=1e-9)
    # In the middle of the third cycle of five the legs are folded, a quarter of a cycle before it out to the side.
    np.testing.assert_allclose(path(0.6)[:3], [0.0, 1.35, -2.6], atol=1e-12)
    np.testing.assert_allclose(path(0.54)[[0, 3, 6, 9]], 1.2, atol=1e-12)


def test_the_guess_turns_without_angular_momentum() -> None:
    robot, motion = solo12(), fall(STROKES)
    assert np.abs(spins(robot, motion.xs)).max() < 1e-12
    com = com_positions(robot, motion.xs)
    parabola = com[0] + np.outer(TIMES, [0.0, 0.0, SPEED]) - np.outer(TIMES**2, [0.0, 0.0, 9.81 / 2.0])
    np.testing.assert_allclose(com, parabola, atol=1e-12)
    turned = turn_deg(motion)
    assert turned[0] == pytest.approx(-138.0, abs=1.0) and np.abs(turned[1:]).max() < 0.5


def test_the_rotation_depends_on_the_enclosed_area() -> None:
    """In one posture the path encloses no area: the rotation of the sweep is reversed."""
    reference = dict(zip(solo12().joint_names, solo12().q_reference[7:].tolist(), strict=True))
    swept = fall(STROKES.replace({"stretched_rad": reference, "folded_rad": reference}))
    assert np.ptp(swept.xs[:, 7]) > 2.0 and np.abs(turn_deg(swept)).max() < 1e-3
    other_way = turn_deg(fall(STROKES.replace({"sweep_rad": {"*_HAA": -1.2}})))
    assert other_way[0] > 100.0


def test_the_connection_agrees_with_the_equations_of_motion() -> None:
    """Pinocchio's forward dynamics, driven along the joints' path, ends in the attitude that the connection gives."""
    robot, motion = solo12(8.0), fall(STROKES, 8.0)
    flown = refly(robot, motion, TIMES, 20.0, 0.2)
    assert flown.path_error < 5e-3 and flown.spin < 1e-9
    ends = [so3.from_quaternion(motion.xs[-1][3:7]), so3.from_quaternion(flown.x[3:7])]
    assert np.degrees(np.linalg.norm(so3.log(ends[0].T @ ends[1]))) < 0.5


def test_a_robot_without_torques_does_not_turn() -> None:
    robot = solo12()
    plan = Trajectory(np.tile(upside_down(robot), (241, 1)), np.zeros((240, 12)))
    flown = refly(robot, plan, TIMES, 3.0, 0.05, step=1e-3)
    expected = upside_down(robot)
    expected[2] -= 9.81 / 2.0 * 1.2**2
    expected[robot.nq + 2] = 9.81 * 1.2
    np.testing.assert_allclose(flown.x, expected, atol=1e-9)
    assert flown.spin < 1e-12 and flown.path_error < 1e-9


def test_a_turn_by_integration_errors_is_detected() -> None:
    """A plan whose base turns evenly while the legs rest: upright at the end, according to the plan."""
    cheat = scenario().problem.hold()
    turning = np.linspace(np.pi, 0.0, len(cheat.xs))
    cheat.xs[:, 3:7] = [pin.Quaternion(so3.exp(np.array([a, 0.0, 0.0]))).coeffs() for a in turning]
    figures = scenario().figures(cheat)
    assert figures["final_tilt_deg"] < 1e-6
    assert figures["reflown_tilt_deg"] > 179.9 and figures["reflown_spin_nms"] < 1e-9


def test_the_clearance_of_straight_legs_follows_from_the_robots_geometry() -> None:
    robot = solo12()
    x = robot.x_reference.copy()
    x[:7], x[7:19] = [0.3, -0.2, 1.0, 0.0, 0.0, np.sin(0.4), np.cos(0.4)], 0.0
    placements = [robot.model.jointPlacements[robot.model.getJointId(f"FL_{name}")] for name in ("HAA", "HFE", "KFE")]
    knee = sum(np.array(placement.translation) for placement in placements)
    trunk = trunk_clearance(robot, x[None], np.array([0.2, 0.08, 0.03]))
    assert trunk == pytest.approx(np.hypot(knee[1] - 0.08, -knee[2] - 0.03) - 0.016, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"node_s": 0.0}, "node_s"),
        ({"nodes": 20}, "strokes.ramp_s"),
        ({"nodes": 2400}, "nodes"),  # 12 s
        ({"strokes": STROKES.replace({"sweep_rad": {"*_HIP": 1.0}})}, "strokes.sweep_rad"),
    ],
)
def test_refusals_name_the_setting(changes: dict[str, object], argument: str) -> None:
    with pytest.raises(InputError) as caught:
        build_righting(solo12(), RightingSettings(strokes=STROKES).replace(changes))  # type: ignore[arg-type]
    assert caught.value.argument == argument


def test_a_robot_without_legs_is_refused() -> None:
    with pytest.raises(InputError, match="contact_frames"):
        build_righting(load_robot(RobotSpec(model="iris")), RightingSettings(strokes=STROKES))


@lru_cache
def solved() -> tuple[Solution, dict[str, float]]:
    solution = LineSearchSqp(scenario().problem).solve(scenario().guess, max_iterations=150)
    return solution, dict(scenario().figures(solution.trajectory))


@pytest.mark.slow
def test_it_turns_over_within_all_limits_and_by_an_independent_flight_too() -> None:
    guess, (solution, figures) = scenario().figures(scenario().guess), solved()
    assert guess["final_tilt_deg"] > 15.0 and guess["joint_speed_ratio"] > 1.0  # neither there nor possible
    assert solution.status is Status.CONVERGED
    assert figures["final_tilt_deg"] < 0.5 and figures["reflown_tilt_deg"] < 3.0
    assert figures["reflown_spin_nms"] < 1e-9 < 0.05 < figures["trunk_spin_nms"]
    assert figures["joint_range_violation_rad"] < 1e-6 and figures["joint_speed_ratio"] < 1.0 + 1e-6
    assert np.abs(solution.us).max() < 1.8 + 1e-6
    assert min(figures["trunk_clearance_m"], figures["leg_clearance_m"]) > 0.01
    assert figures["flight_height_m"] == pytest.approx(9.81 * 0.6**2 / 2.0, abs=2e-3)


@pytest.mark.slow
def test_the_trunk_turns_over_its_side_and_both_ways_round_are_one_attitude() -> None:
    """Roll passes every angle from 180 degrees to 0; nose and tail stay where they are."""
    xs = solved()[0].xs
    noses = np.array([so3.from_quaternion(x[3:7])[:, 0] for x in xs])
    assert np.degrees(np.arccos(noses[:, 0]).max()) < 30.0
    tilts = np.degrees([attitude.tilt(so3.from_quaternion(x[3:7])) for x in xs])
    assert tilts[0] == pytest.approx(180.0) and np.abs(np.diff(tilts)).max() < 10.0
