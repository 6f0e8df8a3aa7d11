"""Stages that Pinocchio evaluates write what the compiled ones write, into the same memory."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import (
    Action,
    Contact,
    ContactForwardDynamics,
    ContactInverseDynamics,
    MultibodyAction,
    NumericContactAction,
)
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import CenterOfPressure, ContactForce, Control, FrictionCone, StateError
from lgmpc.ocp import ShootingFunctions, ShootingProblem, SubproblemFunctions
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.solvers import BoxFddp, Fddp, LineSearchSqp, Status

pytestmark = pytest.mark.usefixtures("interpreted")
FEET = ("FL_FOOT", "HR_FOOT")


@lru_cache
def solo() -> Robot:
    spec = RobotSpec(
        model="solo12", contact_frames=FEET, effort_limit_nm=1.8, velocity_limit_rad_s=30.0, armature_kg_m2=3.6e-4
    )
    return load_robot(spec.replace({"position_limit_rad": (-3.0, 3.0)}))


@lru_cache
def forward(constrained: bool) -> MultibodyAction:
    dynamics = ContactForwardDynamics(solo().model, (Contact(FEET[0], 6), FEET[1]))
    costs = [
        CostItem("x", StateError(dynamics.state, solo().x_reference)),
        CostItem("u", Control(12), weight=1e-2),
        CostItem("cone", FrictionCone(FEET[1], 6), 0.1, QuadraticBarrier(0.0, np.inf)),
    ]
    bounds = [
        ConstraintItem("pressure", CenterOfPressure(FEET[0], (0.05, 0.05)), 0.0, np.inf),
        ConstraintItem("force", ContactForce(FEET[1]), -50.0, 50.0),
    ]
    return MultibodyAction("forward", dynamics, costs, bounds if constrained else [])


@lru_cache
def inverse() -> MultibodyAction:
    dynamics = ContactInverseDynamics(solo().model, FEET)
    return MultibodyAction("inverse", dynamics, [CostItem("x", StateError(dynamics.state, solo().x_reference))])


def problem_of(action: Action, others: int = 0) -> ShootingProblem:
    """Two intervals of the action, and then of one with more controls; one foot in the air in the second."""
    actions = [action] * 2 + [inverse()] * others
    problem = ShootingProblem(actions, terminal=action)
    places = np.concatenate([place(frame).translation for frame in FEET])
    problem.set("duration", 0.02)
    problem.set("contact_points", places)
    problem.set("contact_gains", [100.0, 20.0])
    problem.set("contact_flags", [1.0, 0.0], [1])
    problem.set_initial_state(solo().x_reference)
    return problem


def test_gaps_are_those_of_the_trajectory_where_no_relaxation_of_a_subproblem_is_feasible() -> None:
    problem = problem_of(NumericContactAction(forward(True)))
    problem.set("force_lower", 10.0, [1])  # of a foot in the air
    guess = problem.hold()
    guess.xs[1:, 7:19] += 0.1
    solution = LineSearchSqp(problem).solve(guess)
    assert solution.status is Status.INFEASIBLE
    np.testing.assert_allclose(solution.gaps, solution.defects(), atol=1e-9)
    assert np.abs(solution.gaps).max() > 0.1


def place(frame: str) -> pin.SE3:
    data = solo().create_data()
    pin.framesForwardKinematics(solo().model, data, solo().q_reference)
    return data.oMf[solo().frame(frame)]


def scattered(problem: ShootingProblem, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng, state = np.random.default_rng(seed), problem.state
    xs = np.array([state.integrate(problem.x0, rng.uniform(-0.3, 0.3, state.ndx)) for _ in range(problem.nodes + 1)])
    return xs, rng.standard_normal((problem.nodes, problem.nu))


def assert_equal(ours: np.ndarray, theirs: np.ndarray, name: str) -> None:
    scale = max(1.0, float(np.abs(theirs[np.isfinite(theirs)]).max()))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * scale, err_msg=name)


def test_expansion_and_roll_out_are_those_of_the_expressions() -> None:
    functions = []
    for action in (forward(False), NumericContactAction(forward(False))):
        problem = problem_of(action, others=1)
        f = ShootingFunctions(problem)
        f.xs[...], f.us[...] = scattered(problem)
        rng = np.random.default_rng(1)
        f.jacobian[...] = f.hessian[...] = f.gradient[...] = 7.0  # overwrite previous values
        f.expand()
        f.feedback[...] = 0.1 * rng.standard_normal(f.feedback.shape)
        f.feedforward[...] = 0.1 * rng.standard_normal(f.feedforward.shape)
        f.u_upper[:, :3], f.u_lower[:, 3:6] = 0.2, -0.1
        f.step_length[0] = 0.7
        f.roll_out()
        functions.append(f)
    expressions, numbers = functions
    for name in ("jacobian", "hessian", "gradient", "gaps", "costs", "xs_try", "us_try", "costs_try"):
        assert_equal(getattr(numbers, name), getattr(expressions, name), name)
    assert (numbers.us_try[:, :3] <= 0.2).all() and (numbers.us_try[:, 3:6] >= -0.1).all()


def test_subproblem_is_that_of_the_expressions() -> None:
    found = []
    for action in (forward(True), NumericContactAction(forward(True))):
        problem = problem_of(action, others=1)
        f = SubproblemFunctions(problem)
        f.xs[...], f.us[...] = scattered(problem)
        f.linearize()
        found.append(f.qp)
    assert_equal(found[1].values, found[0].values, "values")
    assert_equal(found[1].terminal_values, found[0].terminal_values, "terminal values")


def test_fddp_solves_it_in_the_same_steps() -> None:
    ours, theirs = (
        Fddp(problem_of(action)).solve(max_iterations=50)
        for action in (NumericContactAction(forward(False)), forward(False))
    )
    assert ours.status is theirs.status is Status.CONVERGED
    assert ours.iterations == theirs.iterations
    np.testing.assert_allclose(ours.us, theirs.us, rtol=0, atol=1e-8)
    assert ours.residual().largest < 1e-4  # by the expressions


def test_sqp_takes_the_same_steps_with_constraints() -> None:
    """Six of them from a distant guess, while bounds become active."""
    solutions = []
    for action in (NumericContactAction(forward(True)), forward(True)):
        problem = problem_of(action)
        problem.set("contact_flags", 1.0)
        problem.set("force_upper", [50.0, 50.0, 8.0])
        solutions.append(LineSearchSqp(problem).solve(max_iterations=6))
    ours, theirs = solutions
    assert np.abs(ours.multipliers).max() > 1e-3
    np.testing.assert_allclose(ours.xs, theirs.xs, rtol=0, atol=1e-7)
    np.testing.assert_allclose(ours.us, theirs.us, rtol=0, atol=1e-6 * np.abs(theirs.us).max())


def test_non_finite_values_give_a_status_instead_of_an_error() -> None:
    problem = problem_of(NumericContactAction(forward(False)))
    problem.view("contact_gains")[:, 0] = np.nan
    for solver in (Fddp, BoxFddp, LineSearchSqp):
        assert solver(problem).solve(max_iterations=3).status is Status.NOT_FINITE
