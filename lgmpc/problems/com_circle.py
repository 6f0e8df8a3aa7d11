"""A robot on its feet draws a horizontal circle with its centre of mass.

With the standard numbers on Solo12 it is the problem that mim_solvers benchmarks: radius 6.5 cm, 0.2 turns a second, 50
intervals of 20 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.costs import CostItem
from lgmpc.costs.activations import QuadraticBarrier
from lgmpc.costs.library import CoMPosition, CoMVelocity, ContactControlGravity, FrictionCone, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.kinematics import com_positions, contact_positions
from lgmpc.problems.reactions import reactions
from lgmpc.problems.scenario import Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["ComCircleSettings", "ComCircleWeights", "build_com_circle"]


@dataclass(frozen=True)
class ComCircleWeights:
    """Weights of squared deviations, per second of the horizon.

    Attributes:
        com: centre of mass from the circle, 1/m2.
        com_velocity: of the centre of mass, 1/(m/s)2.
        base_orientation: base from upright, 1/rad2.
        posture: joints from the reference posture, 1/rad2.
        velocity: of base and joints.
        effort: torques from those that hold the robot at rest, 1/(N.m)2.
        cone: forces outside the friction cone, 1/N2.
    """

    com: float = 1e4
    com_velocity: float = 0.1
    base_orientation: float = 10.0
    posture: float = 0.5
    velocity: float = 0.1
    effort: float = 0.1
    cone: float = 1.0


@dataclass(frozen=True)
class ComCircleSettings:
    """The circle and the grid.

    Attributes:
        radius: of the circle, m; it begins at its foremost point.
        frequency: turns per second, Hz.
        nodes: number of intervals.
        node_duration: length of each, s.
        friction: coefficient of the cones that the contact forces are drawn into.
        weights: of the cost.
    """

    radius: float = 0.065
    frequency: float = 0.2
    nodes: int = 50
    node_duration: float = 0.02
    friction: float = 0.6
    weights: ComCircleWeights = ComCircleWeights()


def build_com_circle(robot: Robot, settings: ComCircleSettings | None = None) -> Scenario:
    """Return the problem for a robot that stands in its reference posture, at rest.

    Figures: ``com_error_m`` and ``com_rms_error_m``, distance of the centre of mass from its place on the circle;
    ``foot_displacement_m``, of the feet from where they stood; ``friction_margin_n``, least distance of a contact force
    from its cone: ``friction`` times its normal part minus its tangential one.

    Raises:
        InputError: a robot without free base or contact frames.
    """
    s = ComCircleSettings() if settings is None else settings
    w = s.weights
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", f"{robot.name} without feet", "a free base and contact_frames")
    stance = contact_positions(robot, robot.x_reference[None])[0]
    start = com_positions(robot, robot.x_reference[None])[0]
    phase = 2.0 * np.pi * s.frequency * s.node_duration * np.arange(s.nodes + 1)
    circle = start + s.radius * np.column_stack([np.cos(phase) - 1.0, np.sin(phase), np.zeros_like(phase)])

    dynamics = ContactForwardDynamics(robot.model, robot.contact_frames)
    deviation = np.repeat([0.0, w.base_orientation, w.posture, w.velocity], [3, 3, robot.nu, robot.nv])
    costs = [
        CostItem("com", CoMPosition(), w.com),
        CostItem("speed", CoMVelocity(), w.com_velocity),
        CostItem("posture", StateError(dynamics.state, robot.x_reference), deviation),
        CostItem("effort", ContactControlGravity(robot.nu), w.effort),
        *(
            CostItem(f"cone_{k}", FrictionCone(foot, friction=s.friction), w.cone, QuadraticBarrier(0.0, np.inf))
            for k, foot in enumerate(robot.contact_frames)
        ),
    ]
    problem = ShootingProblem(MultibodyAction("com_circle", dynamics, costs), s.nodes)
    problem.set("duration", s.node_duration)
    problem.set("contact_points", stance.ravel())
    problem.set("com_reference", circle)
    for name, weight in (("com", w.com), ("speed", w.com_velocity), ("posture", deviation)):
        # Terminal costs are not multiplied by a duration: the last node should count like the others.
        problem.set(f"{name}_weight", s.node_duration * np.asarray(weight), [s.nodes])
    problem.set_initial_state(robot.x_reference)
    durations, flags = np.full(s.nodes, s.node_duration), np.ones((s.nodes, robot.nc), dtype=np.bool_)

    def forces_of(trajectory: Trajectory) -> Array:
        return reactions(robot, trajectory, durations, flags).wrenches

    def figures(trajectory: Trajectory) -> dict[str, float]:
        error = np.linalg.norm(com_positions(robot, trajectory.xs) - circle, axis=1)
        moved = np.linalg.norm(contact_positions(robot, trajectory.xs) - stance, axis=2)
        forces = forces_of(trajectory)
        return {
            "com_error_m": float(error.max()),
            "com_rms_error_m": float(np.sqrt(np.mean(error**2))),
            "foot_displacement_m": float(moved.max()),
            "friction_margin_n": float(np.min(s.friction * forces[..., 2] - np.linalg.norm(forces[..., :2], axis=-1))),
        }

    quarter = 0.25 / (s.frequency * s.node_duration)
    marks = sorted({*(round(quarter * k) for k in range(1, int(s.nodes / quarter) + 1)), s.nodes})
    return Scenario(
        name="com_circle",
        robot=robot,
        problem=problem,
        guess=problem.hold(),
        durations=durations,
        figures=figures,
        contact_flags=flags,
        contact_forces=forces_of,
        waypoints=tuple(Waypoint("centre of mass", k * s.node_duration, circle[k]) for k in marks),
        friction=s.friction,
    )
