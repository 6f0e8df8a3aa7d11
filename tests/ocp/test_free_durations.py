"""Problems whose phases have free durations."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import FreeForwardDynamics, HoldAction, ImpulseAction, MultibodyAction, Stretched
from lgmpc.costs import ConstraintItem, CostItem, Huber, QuadraticBarrier
from lgmpc.costs.library import Control, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import FreeDurations, FreePhase, ShootingProblem, Trajectory, check_derivatives
from lgmpc.solvers import AugmentedLagrangianFddp, LineSearchSqp, NlpSolver, Status

MASS, DISTANCE, NOMINAL = 2.0, 1.0, 1.0


@pytest.fixture
def cart(monkeypatch: pytest.MonkeyPatch) -> ShootingProblem:
    """A cart that must be at rest a metre away, after 20 intervals; the cost is half the force's square over time."""
    monkeypatch.setenv("LGMPC_JIT", "0")
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "rail")
    model.appendBodyToJoint(joint, pin.Inertia(MASS, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    dynamics = FreeForwardDynamics(model)
    move = MultibodyAction("cart_move", dynamics, [CostItem("effort", Control(1))])
    there = ConstraintItem("there", StateError(dynamics.state, [DISTANCE, 0.0]))
    problem = ShootingProblem([move] * 20 + [HoldAction("cart_there", model, (), [there])])
    problem.set("duration", NOMINAL / 20)
    return problem


def effort(problem: ShootingProblem, duration: float) -> float:
    """The least cost for a given duration."""
    fixed = problem.copy()
    fixed.set("duration", duration / 20)
    return LineSearchSqp(fixed).solve().cost


@pytest.mark.parametrize("make", [LineSearchSqp, AugmentedLagrangianFddp, NlpSolver])
def test_the_best_duration_is_that_of_a_search_over_given_ones(cart: ShootingProblem, make: type) -> None:
    """Effort falls as 1 / T^3 and the stretch costs w/2 T^2: the best of given durations, by golden section."""
    free = FreeDurations(cart, [FreePhase(0, 0.2, 8.0)])
    weight = 6.0
    free.problem.set("stretch_weight", weight)
    free.problem.set("stretch_reference", 1e-9)
    solution = make(free.problem).solve(free.lift(cart.hold()))
    assert solution.status is Status.CONVERGED
    found = float(free.durations(solution.trajectory).sum())

    def total(duration: float) -> float:
        return effort(cart, duration) + 0.5 * weight * (duration / NOMINAL) ** 2

    assert solution.cost == pytest.approx(total(found), rel=1e-5)
    for other in (0.97 * found, 1.03 * found):
        assert total(other) > solution.cost
    plain = free.plain(solution.trajectory)
    fixed = cart.copy()
    fixed.set("duration", found / 20)
    np.testing.assert_allclose(fixed.rollout(plain.us).xs, plain.xs, atol=1e-5)


def test_bounds_of_durations_hold_and_phases_are_separate(cart: ShootingProblem) -> None:
    free = FreeDurations(cart, [FreePhase(0, 0.5, 2.0), FreePhase(8, 0.5, 3.0)])
    free.problem.set("stretch_weight", 0.0)
    solution = LineSearchSqp(free.problem).solve(free.lift(cart.hold()))
    assert solution.status is Status.CONVERGED
    durations = free.durations(solution.trajectory)
    np.testing.assert_allclose(durations[:8], 0.1, atol=1e-6)  # without a price of time the longest is the best
    np.testing.assert_allclose(durations[8:20], 0.15, atol=1e-6)
    assert durations[20] == 0.0 and np.count_nonzero(free.chosen) == 2


def test_derivatives_with_costs_of_all_kinds_and_impacts() -> None:
    """The running cost is proportional to the length, which is a state: its derivative is checked, too."""
    model = pin.buildSampleModelManipulator()
    dynamics, frame = FreeForwardDynamics(model), model.frames[-1].name
    still = StateError(dynamics.state)
    costs = [
        CostItem("barrier", still, 3.0, QuadraticBarrier(-0.2, 0.1)),
        CostItem("effort", Control(dynamics.nu), 0.3),
    ]
    move = MultibodyAction("sample_move", dynamics, costs)
    hit = ImpulseAction("sample_hit", model, [frame], [CostItem("after", still)])
    problem = ShootingProblem([move, hit, move], terminal=move)
    free = FreeDurations(problem, [FreePhase(0, 0.5, 2.0), FreePhase(2, 0.5, 2.0)])
    assert check_derivatives(free.problem).passed
    rng = np.random.default_rng(3)
    x, u = rng.standard_normal(problem.state.nx), rng.standard_normal(dynamics.nu)
    p = problem.parameters[0, : move.parameters.size].copy()
    lifted = Stretched(move).evaluate(np.append(x, 1.7), u, p)
    p[move.parameters["duration"]] *= 1.7
    given = move.evaluate(x, u, p)
    assert lifted.cost == pytest.approx(given.cost)
    np.testing.assert_allclose(lifted.x_next, np.append(given.x_next, 1.7))
    trajectory = Trajectory(rng.standard_normal((4, problem.state.nx)), rng.standard_normal((3, problem.nu)))
    back = free.plain(free.lift(trajectory))
    np.testing.assert_array_equal(back.xs, trajectory.xs)
    np.testing.assert_array_equal(back.us, trajectory.us)


def test_bad_phases_and_costs_are_named(cart: ShootingProblem) -> None:
    with pytest.raises(InputError, match=r"0 < lower <= upper"):
        FreePhase(0, 2.0, 1.0)
    for starts in ([], [1], [0, 0], [0, 21]):
        with pytest.raises(InputError, match="phases: got starts"):
            FreeDurations(cart, [FreePhase(k, 0.5, 2.0) for k in starts])
    dynamics = cart.actions[0].dynamics
    rough = MultibodyAction("cart_rough", dynamics, [CostItem("effort", Control(1), 1.0, Huber(1.0))])
    with pytest.raises(InputError, match="activation of 'effort'"):
        FreeDurations(ShootingProblem(rough, 3), [FreePhase(0, 0.5, 2.0)])
