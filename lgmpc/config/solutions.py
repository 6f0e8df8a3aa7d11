"""Solutions of user-defined problems in the form of a run folder's content, for replays and figures."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions import Action, ImpulseAction, MultibodyAction
from lgmpc.actions.contacts import ContactSet
from lgmpc.config.solving import is_finite, trajectory_log
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Outcome, SolvedRun, SolveResult, Verdict
from lgmpc.solvers import History, Solution
from lgmpc.typing import Array, BoolArray

__all__ = ["scenario_of", "solution_as_run"]


def solution_as_run(
    subject: Scenario | Robot, solution: Solution, history: History | None = None
) -> tuple[Robot, SolvedRun]:
    """Return the robot, and a solution in the form of a run folder's content.

    Args:
        subject: the scenario, or the robot alone, see :func:`scenario_of`.
        solution: solution of a problem with this robot.
        history: the solver's reports.

    Raises:
        InputError: states of another robot.
    """
    scenario = subject if isinstance(subject, Scenario) else scenario_of(subject, solution)
    status = solution.status
    result = SolveResult(
        name=scenario.name,
        verdict=Verdict(Outcome.PASS) if status.solved else Verdict(Outcome.FAIL, (status.remedy,)),
        method="",
        status=status.name.lower(),
        explanation="" if status.solved else solution.explain(),
        figures={
            **(scenario.figures(solution.trajectory) if is_finite(solution) else {}),
            "cost": solution.cost,
            "iterations": float(solution.iterations),
            "solve_ms": 1e3 * solution.timings.total,
        },
    )
    log = trajectory_log(scenario, solution, () if history is None else history.reports)
    return scenario.robot, SolvedRun(Path(scenario.name), "", log, result)


def scenario_of(robot: Robot, solution: Solution) -> Scenario:
    """Return the scenario of a solution, as far as its problem's parameters determine it.

    Times follow from ``duration``, contacts from ``contact_flags``; forces are those of the actions' dynamics.

    Args:
        robot: robot whose configuration and velocity are the states.
        solution: solution of a problem with this robot.

    Raises:
        InputError: states of another robot, or intervals whose length no parameter says.
    """
    problem = solution.problem
    if problem.state.nx != robot.nq + robot.nv:
        expected = f"states of {robot.name}, nx = {robot.nq + robot.nv}"
        raise InputError("solution", f"states with nx = {problem.state.nx}", expected)
    durations = _durations(problem)
    if not durations.any():
        expected = "actions with the parameter 'duration', or a Scenario with durations in place of the robot"
        raise InputError("solution", f"intervals of no known length ('{problem.actions[0].name}')", expected)
    return Scenario(
        name=problem.actions[0].name,
        robot=robot,
        problem=problem,
        guess=solution.trajectory,
        durations=durations,
        figures=lambda trajectory: {},
        contact_flags=_flags(robot, problem),
        contact_forces=lambda trajectory: _forces(robot, problem, trajectory),
    )


def _durations(problem: ShootingProblem) -> Array:
    """Return (N,) durations of the intervals, s; 0 where the action has none."""
    found = np.zeros(problem.nodes)
    for k, action in enumerate(problem.actions):
        if "duration" in tuple(action.parameters):
            found[k] = problem.parameters[k, action.parameters["duration"]][0]
    return found


def _flags(robot: Robot, problem: ShootingProblem) -> BoolArray:
    """Return (N, nc) flags of the robot's contact frames that are active contacts of the action."""
    found = np.zeros((problem.nodes, robot.nc), dtype=np.bool_)
    for k, action in enumerate(problem.actions):
        contacts = _contacts(action)
        if contacts is None:
            continue
        flags = problem.parameters[k, action.parameters["contact_flags"]]
        for contact, flag in zip(contacts.contacts, flags, strict=True):
            if contact.frame in robot.contact_frames:
                found[k, robot.contact_frames.index(contact.frame)] = flag > 0.0
    return found


def _forces(robot: Robot, problem: ShootingProblem, trajectory: Trajectory) -> Array:
    """Return (N, nc, 3) forces on the robot's contact frames, N; zero during impacts, which have impulses."""
    found, data = np.zeros((problem.nodes, robot.nc, 3)), robot.create_data()
    for k, action in enumerate(problem.actions):
        contacts = _contacts(action)
        if contacts is None or action.expansion is None or isinstance(action, ImpulseAction):
            continue
        dynamics = action.expansion.dynamics
        p = problem.parameters[k, : dynamics.numel_in(2)]
        z = dynamics(trajectory.xs[k], trajectory.us[k, : action.nu], p)[1].full()[:, 0]
        flags = problem.parameters[k, action.parameters["contact_flags"]]
        pin.framesForwardKinematics(robot.model, data, trajectory.xs[k, : robot.nq])
        start = robot.nv
        for contact, flag in zip(contacts.contacts, flags, strict=True):
            if contact.frame in robot.contact_frames:
                own = z[start : start + contact.size]
                if contact.size < 3:
                    rotation = data.oMf[robot.model.getFrameId(contact.frame)].rotation
                    own = contact.directions(ca.DM(rotation)).full() @ own
                found[k, robot.contact_frames.index(contact.frame)] = flag * own[:3]
            start += contact.size
    return found


def _contacts(action: Action) -> ContactSet | None:
    owner = action.dynamics if isinstance(action, MultibodyAction) else action
    contacts = getattr(owner, "contacts", None)
    return contacts if isinstance(contacts, ContactSet) else None
