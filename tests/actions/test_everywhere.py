"""Derivatives of every full-body action at critical points: half a turn away, upside down, at zero force."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from samples import solo

from lgmpc.actions import (
    Action,
    Contact,
    ContactForwardDynamics,
    FreeForwardDynamics,
    HoldAction,
    ImpulseAction,
    MultibodyAction,
)
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import (
    CenterOfPressure,
    ContactForce,
    Control,
    FramePlacement,
    FrameRotation,
    FrictionCone,
    StateError,
    WrenchCone,
)
from lgmpc.ocp import ShootingProblem, Trajectory, check_derivatives
from lgmpc.state import State

SURFACE, POINT = "FL_FOOT", "HR_FOOT"
CONTACTS = (
    Contact(SURFACE, 6),
    POINT,
    Contact("FR_FOOT", 2, axes=((0.0, 0.0, 1.0),), frame_axes=((0.0, 1.0, 0.0),)),
    Contact("HL_FOOT", 1),
)
TURNS = {
    "upright": np.zeros(3),
    "half a turn, nearly": (math.pi - 0.02) * np.array([0.6, -0.48, 0.64]),
    "nose down": np.array([0.0, math.pi / 2, 0.0]),
    "upside down": np.array([math.pi - 1e-2, 0.0, 0.0]),
}


def costs(state: State, forces: bool = True) -> list[CostItem]:
    """Of attitude and, where there are any, of forces."""
    x_reference = np.concatenate([solo().q_reference, np.zeros(state.nx - solo().nq)])
    inside = QuadraticBarrier(0.0, np.inf)
    of_motion = [
        CostItem("x", StateError(state, x_reference), 0.3),
        CostItem("foot", FramePlacement(POINT), 0.5),
        CostItem("turn", FrameRotation("base_link"), 0.7),
    ]
    of_forces = [
        CostItem("force", ContactForce(POINT), 1e-2),
        CostItem("cone", FrictionCone(POINT), 1e-2, inside),
        CostItem("pressure", CenterOfPressure(SURFACE, (0.1, 0.05)), 1e-2, inside),
        CostItem("wrench", WrenchCone(SURFACE, (0.1, 0.05)), 1e-2, inside),
    ]
    return of_motion + of_forces if forces else of_motion


@lru_cache
def action(name: str) -> Action:
    model, contacts = solo().model, CONTACTS
    cone = [ConstraintItem("cone_row", FrictionCone(POINT), 0.0, np.inf)]
    if name == "forward":
        dynamics = ContactForwardDynamics(model, contacts)
        return MultibodyAction(name, dynamics, costs(dynamics.state), cone)
    if name == "impact":
        state = ContactForwardDynamics(model, contacts).state
        return ImpulseAction(name, model, contacts, costs(state), cone)
    free = FreeForwardDynamics(model)
    if name == "hold":
        return HoldAction(
            name, model, costs(free.state, forces=False), [ConstraintItem("foot_row", FramePlacement(POINT))]
        )
    return MultibodyAction(name, free, [*costs(free.state, forces=False), CostItem("u", Control(12))])


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", ["forward", "impact", "free", "hold"])
def test_derivatives(name: str, turn: str) -> None:
    subject = action(name)
    rng = np.random.default_rng(len(turn))
    problem = ShootingProblem(subject, 3)
    for gains in ("contact_gains", "contact_stiffness"):
        if gains in tuple(subject.parameters):
            problem.set(gains, 0.7)
    if "contact_flags" in tuple(subject.parameters):
        n = subject.parameters.parameter("contact_flags").size
        flags = np.tile([[1.0, 1.0], [0.0, 0.0], [0.0, 1.0], [1.0, 1.0]], n // 2)  # at node 1 no force at all
        problem.set("contact_flags", flags)
    state = subject.state
    upright = np.concatenate([solo().q_reference, np.zeros(state.nx - solo().nq)])
    xs, us = [], 0.5 * rng.standard_normal((3, subject.nu))
    us[1] = 0.0
    for _ in range(4):
        x = state.integrate(upright, rng.uniform(-0.3, 0.3, state.ndx))
        x[3:7] = pin.Quaternion(pin.exp3(TURNS[turn])).coeffs()
        xs.append(x)
    report = check_derivatives(problem, trajectory=Trajectory(np.array(xs), us))
    assert report.passed, str(report)
