"""Full-body problems of gaits and jumps, defined by a sequence of contacts and a motion of the base."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.lie.checks import typed
from lgmpc.locomotion.sequence import GaitGrid, GaitSequence
from lgmpc.ocp import Trajectory
from lgmpc.problems.footsteps import BaseLeap, BaseMotion, BasePath, Footsteps
from lgmpc.problems.legged_figures import LeggedFigures
from lgmpc.problems.legged_problem import LeggedScale, carrying_efforts, legged_problem
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings, LeggedSettings
from lgmpc.problems.motion import contact_positions
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["build_gait", "build_jump", "build_legged", "check_legged", "reference_states", "resting_guess"]


@typed
def build_gait(robot: Robot, settings: GaitSettings) -> Scenario:
    """Return the problem of a gait at a commanded velocity. Figures: :class:`LeggedFigures`.

    Raises:
        InputError: as :func:`build_legged`, or a ramp longer than half of the time in which feet swing.
    """
    s = settings
    check_legged(robot)
    gait = s.gait(robot)
    stop = gait.duration - s.settle_s
    most = (stop - s.settle_s) / 2.0
    if s.ramp_s > most * (1.0 + 1e-12):
        raise InputError("ramp_s", s.ramp_s, f"at most {most:g} s, half of the time in which feet swing")
    path = BasePath.walking(s.velocity_m_s, math.radians(s.yaw_rate_deg_s), s.settle_s, stop, s.ramp_s)
    return build_legged(s.pattern or "gait", robot, gait, path, s)


@typed
def build_jump(robot: Robot, settings: JumpSettings | None = None) -> Scenario:
    """Return the problem of a jump. Figures: :class:`LeggedFigures`.

    Raises:
        InputError: as :func:`build_legged`.
    """
    s = JumpSettings() if settings is None else settings
    check_legged(robot)
    leap = BaseLeap(
        np.array(s.displacement_m),
        math.radians(s.yaw_deg),
        s.takeoff_s,
        s.takeoff_s + s.flight_s,
        LeggedScale.of(robot).gravity,
    )
    return build_legged("jump", robot, s.gait(robot), leap, s)


@typed
def build_legged(name: str, robot: Robot, gait: GaitSequence, motion: BaseMotion, settings: LeggedSettings) -> Scenario:
    """Return the problem of any gait along any motion of the base.

    The guess is the reference posture moved with the base, and the torques that balance it at rest.

    Args:
        name: a C identifier.
        robot: initially at rest in its reference posture.
        gait: of all its contact frames, with every foot on the ground at beginning and end.
        motion: motion of its base.
        settings: of weights, friction and grid.

    Raises:
        InputError: a robot without free base or contact frames, or a gait of other feet.
    """
    check_legged(robot)
    if gait.feet != robot.contact_frames:
        raise InputError("gait.feet", ", ".join(gait.feet), f"the contact frames ({', '.join(robot.contact_frames)})")
    grid = gait.grid(settings.step_s)
    start = contact_positions(robot, robot.x_reference[None])[0]
    steps = Footsteps.plan(gait, motion, start, robot.q_reference[:3])
    reference = reference_states(robot, motion, grid.times)
    problem = legged_problem(robot, grid, reference, steps.positions(grid.times), settings)
    figures = LeggedFigures(robot, grid, steps, motion, settings.friction)

    return Scenario(
        name=name,
        robot=robot,
        problem=problem,
        guess=Trajectory(resting_guess(robot, grid, reference), carrying_efforts(robot, grid)),
        durations=grid.durations,
        figures=figures.measure,
        contact_flags=grid.flags,
        contact_forces=figures.forces,
        waypoints=_waypoints(gait, steps),
        friction=settings.friction,
    )


def check_legged(robot: Robot) -> None:
    """Check that a robot has a free base, feet, and joints of one angle each.

    Raises:
        InputError: it lacks one of these.
    """
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", f"{robot.name} without feet", "a free base and contact_frames")
    if robot.nq - 7 != robot.nu:
        raise InputError("robot", f"{robot.name} with continuous joints", "joints of one angle each, which have limits")


def reference_states(robot: Robot, motion: BaseMotion, times: Array) -> Array:
    """Return (N+1, nx) the reference posture moved with the base."""
    states = np.tile(robot.x_reference, (len(times), 1))
    position, turn = robot.q_reference[:3], np.asarray(pin.Quaternion(robot.q_reference[3:7]).matrix())
    for x, moved, velocity in zip(states, motion.placements(times), motion.velocities(times), strict=True):
        x[:3] = position + moved[:3, 3]
        x[3:7] = pin.Quaternion(moved[:3, :3] @ turn).coeffs()
        x[robot.nq : robot.nq + 6] = np.concatenate([velocity[:3] @ turn, velocity[3:] @ turn])
    return states


def resting_guess(robot: Robot, grid: GaitGrid, reference: Array) -> Array:
    """Return the reference with zero velocities except in flight: a moving base over resting feet is infeasible."""
    states = reference.copy()
    states[:-1][~grid.flight, robot.nq :] = 0.0
    states[-1, robot.nq :] = 0.0
    return states


def _waypoints(gait: GaitSequence, steps: Footsteps) -> tuple[Waypoint, ...]:
    marks = [
        Waypoint(f"{foot}, step {i + 1}", swing.touchdown, swing.end)
        for foot, swings in zip(gait.feet, steps.swings, strict=True)
        for i, swing in enumerate(swings)
    ]
    return tuple(sorted(marks, key=lambda mark: mark.time))
