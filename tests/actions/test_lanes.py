"""Expansions and exact Hessians of contacts of some axes, inverse dynamics, distances: the same bits in any lanes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from samples import JointEffort

from lgmpc.actions import Contact, ContactForwardDynamics, FreeInverseDynamics, MultibodyAction
from lgmpc.actions.dynamics import Dynamics
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import ShapePairDistance, StateError
from lgmpc.ocp import LagrangianHessians, ShootingProblem, SubproblemFunctions
from lgmpc.robot import Capsule, place_shape

WHOLE = pin.buildSampleModelManipulator()
MODEL = pin.buildReducedModel(WHOLE, [4, 6], 0.3 * np.ones(6))  # four joints: less to compile
HAND = MODEL.frames[-1].name


def dynamics_of(kind: str) -> Dynamics:
    if kind == "inverse":
        return FreeInverseDynamics(MODEL)
    sliding = Contact(HAND, 2, axes=((0.0, 0.6, 0.8),), frame_axes=((1.0, 0.0, 0.0),))
    return ContactForwardDynamics(MODEL, [sliding])


def problem_of(kind: str) -> ShootingProblem:
    """Eleven stages: whole groups of lanes and a remainder."""
    first, second = (
        place_shape(MODEL, Capsule(link=link, radius_m=0.05, half_length_m=0.2)) for link in (HAND, "universe")
    )
    dynamics = dynamics_of(kind)
    items = [
        CostItem("rest", StateError(dynamics.state), 0.1),
        CostItem("effort", JointEffort(4), 1e-3),
        CostItem("near", ShapePairDistance(first, second), 2.0),
    ]
    apart = [ConstraintItem("apart", ShapePairDistance(first, second), 0.02, np.inf)]
    problem = ShootingProblem(MultibodyAction(f"lanes_{kind}", dynamics, items, apart), 11)
    if kind == "sliding":
        problem.set("contact_gains", [3.0, 2.0])
    return problem


def expansion(problem: ShootingProblem) -> np.ndarray:
    functions, rng = SubproblemFunctions(problem), np.random.default_rng(0)
    functions.xs[...] = rng.uniform(-1.0, 1.0, functions.xs.shape)
    functions.us[...] = rng.standard_normal(functions.us.shape)
    functions.linearize()
    return functions.qp.values


def curvature(problem: ShootingProblem) -> np.ndarray:
    rng = np.random.default_rng(0)
    xs, us = rng.uniform(-1.0, 1.0, (12, problem.state.nx)), rng.standard_normal((11, problem.nu))
    exact = LagrangianHessians(problem, xs, us)
    exact.costates[...] = rng.standard_normal(exact.costates.shape)
    exact.multipliers[...] = rng.standard_normal(exact.multipliers.shape)
    exact.evaluate()
    return exact.hessian


@pytest.mark.parametrize("evaluate", [expansion, pytest.param(curvature, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["inverse", pytest.param("sliding", marks=pytest.mark.slow)])
def test_one_lane_and_four_give_the_same_bits(
    kind: str, evaluate: Callable[[ShootingProblem], np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At random points: groups of lanes and a remainder (eight lanes: tests/test_stage_kernel.py)."""
    found = []
    for flags in ("-DLANES=1", "-DLANES=4"):
        monkeypatch.setenv("LGMPC_CFLAGS", flags)
        found.append(evaluate(problem_of(kind)).copy())
    assert not np.isnan(found[0]).any() and found[0].any()
    np.testing.assert_array_equal(found[1], found[0])
