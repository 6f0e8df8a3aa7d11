"""Gaits and jumps: the problem's data, figures of motions constructed by hand, solutions against mechanics."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import MultibodyAction
from lgmpc.actions.implicit import Unknowns
from lgmpc.config.loading import load_solve_config
from lgmpc.config.solving import prepare_solve
from lgmpc.errors import InputError
from lgmpc.locomotion.sequence import GaitPhase, GaitSequence, QuadrupedFeet
from lgmpc.ocp import Trajectory
from lgmpc.problems import Scenario
from lgmpc.problems.footsteps import BasePath
from lgmpc.problems.legged import LeggedScale, build_gait, build_jump, build_legged, carrying_efforts
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings, LeggedSettings, LeggedWeights
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import BoxFddp, FddpSettings, LineSearchSqp, LineSearchSqpSettings, Solution, Status

CONFIGS = Path(__file__).parents[2] / "configs"
FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
STEP = GaitSettings(cycles=1, settle_s=0.1, ramp_s=0.1, pattern="trot", step_s=0.02)
"""One cycle of a trot: short, with swings, touchdowns and impacts."""


@lru_cache
def solo12() -> Robot:
    ranges = {"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)}
    spec = RobotSpec(
        model="solo12",
        contact_frames=FEET,
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=ranges,
        posture="standing",
        armature_kg_m2=3.6e-4,
    )
    return load_robot(spec)


@lru_cache
def trot() -> Scenario:
    return build_gait(solo12(), STEP)


@lru_cache
def trotted() -> Solution:
    return BoxFddp(trot().problem).solve(trot().guess)


@lru_cache
def fallen() -> Trajectory:
    """The trot's scenario under the torques of the guess alone: consistent with the dynamics, impacts, no balance."""
    return trot().problem.rollout(trot().guess.us)


@lru_cache
def jump(step: float = 0.01) -> tuple[Scenario, Solution]:
    scenario = build_jump(solo12(), JumpSettings(step_s=step))
    return scenario, LineSearchSqp(scenario.problem).solve(scenario.guess)


def standing() -> tuple[Scenario, Trajectory]:
    """Half a second on four feet, and a motion at rest."""
    robot = solo12()
    gait = GaitSequence.stand(FEET, 0.5)
    scenario = build_legged("stand", robot, gait, BasePath.walking((0.0, 0.0), 0.0, 0.1, 0.4, 0.0), LeggedSettings())
    return scenario, scenario.guess


def value(scenario: Scenario, name: str, node: int) -> np.ndarray:
    action = scenario.problem.action_at(node)
    return scenario.problem.parameters[node, action.parameters[name]]


def test_every_node_has_its_phase() -> None:
    scenario, nodes = trot(), trot().problem.nodes
    grid = STEP.gait(solo12()).grid(0.02)
    np.testing.assert_array_equal(scenario.contact_flags, grid.flags)
    assert scenario.times[-1] == pytest.approx(2 * 0.1 + 2 * 0.24)
    assert grid.impacts.sum() == 2
    for k in range(nodes):
        np.testing.assert_array_equal(value(scenario, "contact_flags", k), grid.flags[k])
        for i in range(4):
            pays = value(scenario, f"foot_{i}_weight", k).any()
            assert pays == (grid.touchdowns[k, i] if grid.impacts[k] else not grid.flags[k, i])
    assert not any(value(scenario, f"foot_{i}_weight", nodes).any() for i in range(4))


def test_at_a_touchdown_the_reference_is_the_foothold_and_feet_stay_there() -> None:
    scenario = trot()
    for mark in scenario.waypoints:
        foot = FEET.index(mark.name.split(",")[0])
        (k,) = np.flatnonzero((scenario.durations == 0) & np.isclose(scenario.times[:-1], mark.time))
        for node in (k, k + 1, scenario.problem.nodes):
            np.testing.assert_allclose(value(scenario, f"foot_{foot}_reference", node), mark.position, atol=1e-14)
        np.testing.assert_allclose(value(scenario, "contact_points", k + 1).reshape(4, 3)[foot], mark.position)


@pytest.mark.parametrize("flags", [[True] * 4, [True, True, True, False], [True, False, False, True]])
def test_carrying_efforts_balance_gravity_with_forces_at_the_feet(flags: list[bool]) -> None:
    """Whatever forces of the feet one takes, J^T f + [0; u] = g has no better solution in the joints' rows."""
    robot, grid = solo12(), GaitSequence.stand(FEET, 0.1).grid(0.1)
    effort = carrying_efforts(robot, replace(grid, flags=np.array([flags])), robot.x_reference)[0]
    model, data = robot.model, robot.create_data()
    gravity = pin.rnea(model, data, robot.q_reference, np.zeros(robot.nv), np.zeros(robot.nv))
    down = [frame for frame, on in zip(robot.contact_ids, flags, strict=True) if on]
    args = (model, data, robot.q_reference)
    jacobian = np.vstack([pin.computeFrameJacobian(*args, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in down])
    forces = np.linalg.lstsq(jacobian[:, 6:].T, gravity[6:] - effort, rcond=None)[0]
    left = gravity - jacobian.T @ forces - np.r_[np.zeros(6), effort]
    assert np.abs(left[6:]).max() < 1e-12
    assert forces.reshape(-1, 3)[:, 2].sum() == pytest.approx(robot.mass * 9.81, rel=0.02)
    if sum(flags) > 2:  # two feet on a line that the centre of mass is not above cannot balance its moment
        assert np.abs(left[:6]).max() < 1e-10


def test_units_of_a_robot_twice_as_long() -> None:
    """With eight times the mass; speeds of equal Froude number are equal in these units."""
    small, large = LeggedScale(2.5, 0.25, 9.81), LeggedScale(20.0, 0.5, 9.81)
    assert large.force / small.force == 8.0 and large.torque / small.torque == 16.0
    assert (large.speed / small.speed) ** 2 == pytest.approx(2.0)  # Froude number v^2 / (g l)
    assert large.impulse / small.impulse == pytest.approx(8.0 * np.sqrt(2.0))
    assert small.force * small.time == pytest.approx(small.impulse)


def test_figures_of_standing_still() -> None:
    scenario, still = standing()
    figures = scenario.figures(still)
    zero = ("slip_m", "final_speed_m_s", "forward_distance_m", "goal_error_m", "com_rise_m", "joint_velocity_ratio")
    assert all(figures[name] == pytest.approx(0.0, abs=1e-14) for name in zero)
    assert figures["dynamics_misfit_ratio"] < 1e-12
    forces = scenario.contact_forces(still) if scenario.contact_forces else np.zeros(0)
    np.testing.assert_allclose(forces.sum(axis=1), np.tile([0, 0, solo12().mass * 9.81], (len(forces), 1)), atol=1e-10)
    ratio = np.linalg.norm(forces[..., :2], axis=2) / (0.7 * forces[..., 2])
    assert figures["friction_ratio"] == pytest.approx(ratio.max(), rel=1e-12)
    assert figures["effort_ratio"] == pytest.approx(np.abs(still.us).max() / 1.8)


def test_figures_of_a_bad_motion() -> None:
    scenario, still = standing()
    moved = still.xs.copy()
    moved[10:, 0] += 0.013
    slid = scenario.figures(Trajectory(moved, still.us))
    assert slid["slip_m"] == pytest.approx(0.013) and slid["forward_distance_m"] == pytest.approx(0.013)
    pushed = scenario.figures(Trajectory(still.xs, still.us + np.eye(12)[0]))
    assert pushed["dynamics_misfit_ratio"] > 1e-2  # these torques do not leave it at rest
    tipped = still.xs.copy()
    tipped[20, 3:7] = [np.sin(0.1), 0.0, 0.0, np.cos(0.1)]
    assert scenario.figures(Trajectory(tipped, still.us))["tilt_deg"] == pytest.approx(np.degrees(0.2))
    crossed = still.xs.copy()
    crossed[5, 7] = 0.95
    assert scenario.figures(Trajectory(crossed, still.us))["joint_limit_violation_rad"] == pytest.approx(0.05)
    sped = still.xs.copy()
    sped[5, 25] = -33.0
    assert scenario.figures(Trajectory(sped, still.us))["joint_velocity_ratio"] == pytest.approx(1.1)


def test_refusals() -> None:
    panda = load_robot(RobotSpec(model="panda"))
    with pytest.raises(InputError, match="a free base"):
        build_gait(panda, GaitSettings(pattern="trot"))
    with pytest.raises(InputError, match="a free base"):
        build_jump(panda)
    with pytest.raises(InputError, match="^ramp_s: got 5"):
        build_gait(solo12(), GaitSettings(pattern="trot", ramp_s=5.0))
    with pytest.raises(InputError, match=r"gait\.feet"):
        build_legged(
            "x", solo12(), GaitSequence.stand(FEET[:3], 1.0), BasePath(np.zeros(6), 0.0, 1.0), LeggedSettings()
        )
    with pytest.raises(InputError, match="FL_FOOT"):
        build_gait(
            solo12(),
            GaitSettings(phases=(GaitPhase(duration_s=0.2, air=("FL_FOT",), height_m=0.05), GaitPhase(duration_s=0.1))),
        )
    for settings, name in (
        (lambda: GaitSettings(pattern="gallop"), "pattern"),  # type: ignore[arg-type]
        (lambda: GaitSettings(pattern="trot", cycles=0), "cycles"),
        (lambda: GaitSettings(pattern="trot", swing_s=np.nan), "swing"),
        (lambda: JumpSettings(flight_s=0.0), "flight"),
        (lambda: LeggedSettings(friction=0.0), "friction"),
        (lambda: LeggedSettings(least_force=0.3), "least_force"),
        (lambda: LeggedWeights(swing=-1.0), "swing"),
    ):
        with pytest.raises(InputError, match=name):
            settings()


@pytest.mark.slow
def test_a_trot_reaches_its_goal_within_all_limits() -> None:
    """Compiles the stage, once for all slow tests of the trot."""
    assert trotted().status is Status.CONVERGED and trotted().iterations < 45  # 40; without distances of bodies 37
    figures = trot().figures(trotted().trajectory)
    assert figures["forward_distance_m"] == pytest.approx(0.3 * (0.48 - 0.1), abs=1e-3)
    assert figures["swing_height_m"] == pytest.approx(0.05, abs=2e-3)
    assert figures["foothold_error_m"] < 5e-4 and figures["touchdown_speed_m_s"] < 0.01
    assert figures["slip_m"] < 1e-3 and figures["tilt_deg"] < 2.0
    assert figures["friction_ratio"] < 1.0 and figures["normal_force_n"] > 0.0
    assert max(figures["effort_ratio"], figures["joint_velocity_ratio"]) <= 1.0
    assert figures["dynamics_misfit_ratio"] < 1e-9


def test_forces_of_the_change_of_momentum_are_those_of_the_contacts() -> None:
    """Pinocchio's forces, from velocities and torques, are what the stage's own contact solver found."""
    scenario, motion = trot(), fallen()
    assert scenario.contact_forces is not None
    mine, robot = scenario.contact_forces(motion), solo12()
    move = next(action for action in scenario.problem.actions if isinstance(action, MultibodyAction))
    x, u, p = (ca.SX.sym(*each) for each in (("x", robot.nq + robot.nv), ("u", robot.nu), ("p", move.parameters.size)))
    found = move.dynamics.motion(x[: robot.nq], x[robot.nq :], u, move.parameters.split(p), Unknowns()).forces
    forces = ca.Function("forces", [x, u, p], [ca.densify(ca.horzcat(*(found[foot][:3] for foot in FEET)))])
    for k in np.flatnonzero(scenario.durations > 0.0):
        theirs = forces(motion.xs[k], motion.us[k], scenario.problem.parameters[k, : move.parameters.size])
        np.testing.assert_allclose(mine[k], theirs.full().T, atol=1e-8)
    assert not mine[~scenario.contact_flags].any() and not mine[scenario.durations == 0.0].any()


def test_feet_do_not_move_after_an_impact() -> None:
    scenario, motion, robot = trot(), fallen(), solo12()
    model, data = robot.model, robot.create_data()
    for k in np.flatnonzero(scenario.durations == 0.0):
        before, after = motion.xs[k], motion.xs[k + 1]
        np.testing.assert_array_equal(before[: robot.nq], after[: robot.nq])
        for frame, down in zip(robot.contact_ids, scenario.contact_flags[k], strict=True):
            pin.forwardKinematics(model, data, after[: robot.nq], after[robot.nq :])
            if down:
                assert pin.getFrameVelocity(model, data, frame, pin.LOCAL).linear == pytest.approx([0, 0, 0], abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["solo12_walk", "solo12_trot", "solo12_jump", "anymal_trot"])
def test_shipped_problems_pass_their_gates(name: str) -> None:
    outcome = prepare_solve(load_solve_config(CONFIGS / f"{name}.yaml")).run(lambda iteration: None)
    assert outcome.verdict.passed, outcome.verdict.reasons


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["pace", "bound"])  # walk and trot: those that are shipped
def test_other_patterns_converge(pattern: str) -> None:
    scenario = build_gait(
        solo12(),
        GaitSettings(
            pattern=pattern,
            cycles=2,
            swing_s=0.15,
            stance_s=0.04,
            height_m=0.04,
            velocity_m_s=(0.2, 0.05),
            yaw_rate_deg_s=np.degrees(0.3),
        ),
    )  # type: ignore[arg-type]
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    figures = scenario.figures(solution.trajectory)
    assert solution.status is Status.CONVERGED
    assert figures["goal_error_m"] < 1e-3 and figures["goal_rotation_error_deg"] < 0.1
    assert figures["friction_ratio"] <= 1.0 and figures["normal_force_n"] > 0.0 and figures["effort_ratio"] <= 1.0


@pytest.mark.slow
def test_any_phases_make_a_gait() -> None:
    """Steps in place with two feet, whose swings overlap and span phases."""
    legs = QuadrupedFeet.of(solo12())
    cycle = (
        GaitPhase(duration_s=0.15, air=[legs.front_left], height_m=0.04),
        GaitPhase(duration_s=0.1, air=[legs.front_left, legs.hind_right], height_m=0.04),
        GaitPhase(duration_s=0.15, air=[legs.hind_right], height_m=0.03),
        GaitPhase(duration_s=0.1),
    )
    scenario = build_gait(solo12(), GaitSettings(phases=cycle, cycles=2, velocity_m_s=(0.0, 0.0)))
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    figures = scenario.figures(solution.trajectory)
    assert solution.status is Status.CONVERGED
    assert figures["swing_height_m"] == pytest.approx(0.04, abs=2e-3)
    assert figures["goal_error_m"] < 1e-3 and figures["slip_m"] < 1e-3 and figures["friction_ratio"] <= 1.0


@pytest.mark.slow
def test_a_disturbed_guess_leads_to_the_same_trot() -> None:
    scenario, rng = trot(), np.random.default_rng(0)
    dx = 0.02 * rng.standard_normal((scenario.problem.nodes + 1, 36))
    xs = np.array([scenario.problem.state.integrate(x, d) for x, d in zip(scenario.guess.xs, dx, strict=True)])
    other = BoxFddp(scenario.problem).solve(Trajectory(xs, scenario.guess.us))
    assert other.status is Status.CONVERGED
    assert other.cost == pytest.approx(trotted().cost, rel=1e-6)


@pytest.mark.slow
def test_two_solvers_find_the_same_trot() -> None:
    """Positions differ by the root of the remaining reduction of the cost: 2e-5 at FDDP's default tolerance, 1e-9."""
    fddp = BoxFddp(trot().problem, FddpSettings(tolerance=1e-14)).solve(trot().guess)
    sqp = LineSearchSqp(trot().problem, LineSearchSqpSettings(tolerance=1e-7)).solve(trot().guess)
    assert fddp.status is Status.CONVERGED and sqp.status is Status.CONVERGED
    assert sqp.residual().largest < 1e-7
    assert fddp.cost == pytest.approx(sqp.cost, rel=1e-11)
    np.testing.assert_allclose(fddp.xs[:, :19], sqp.xs[:, :19], atol=1e-5)


@pytest.mark.slow
def test_nothing_but_gravity_changes_momentum_in_flight() -> None:
    """At every node of the flight Pinocchio's rate of centroidal momentum is the weight, and no moment."""
    scenario, solution = jump()
    assert solution.status is Status.CONVERGED
    robot, xs = scenario.robot, solution.xs
    model, data, weight = robot.model, robot.create_data(), robot.mass * 9.81
    flying = np.flatnonzero(~scenario.contact_flags.any(axis=1))
    assert scenario.durations[flying].sum() == pytest.approx(0.3)
    for k in flying:
        q, v, after = xs[k, : robot.nq], xs[k, robot.nq :], xs[k + 1, robot.nq :]
        rate = pin.computeCentroidalMomentumTimeVariation(model, data, q, v, (after - v) / scenario.durations[k])
        assert rate.linear == pytest.approx([0.0, 0.0, -weight], abs=1e-8 * weight)
        assert rate.angular == pytest.approx([0.0, 0.0, 0.0], abs=1e-8 * weight)


@pytest.mark.slow
def test_the_flight_s_errors_are_the_integrator_s() -> None:
    """Drift from the parabola and of the angular momentum falls in proportion to the step, creep of feet faster."""
    found = [jump(step) for step in (0.02, 0.01, 0.005)]
    figures = [scenario.figures(solution.trajectory) for scenario, solution in found]
    for coarse, fine in pairwise(figures):
        for name in ("flight_com_error_m", "flight_spin_ratio"):
            assert coarse[name] / fine[name] == pytest.approx(2.0, rel=0.35)
        assert coarse["slip_m"] / fine["slip_m"] > 2.5
    assert figures[-1]["flight_com_error_m"] < 2e-4


@pytest.mark.slow
def test_a_jump_lands_higher_and_turned() -> None:
    scenario = build_jump(solo12(), JumpSettings(displacement_m=(0.15, 0.05, 0.06), yaw_deg=np.degrees(0.3)))
    solution = LineSearchSqp(scenario.problem).solve(scenario.guess)
    figures = scenario.figures(solution.trajectory)
    assert solution.status is Status.CONVERGED
    assert figures["goal_error_m"] < 1e-3 and figures["goal_rotation_error_deg"] < 0.1
    assert figures["final_speed_m_s"] < 1e-3 and figures["foothold_error_m"] < 1e-4
    assert figures["friction_ratio"] <= 1.0 and figures["normal_force_n"] > 0.0
