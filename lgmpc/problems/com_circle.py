"""The centre of mass of a standing robot follows a horizontal circle.

With the defaults on Solo12 it is the benchmark problem of mim_solvers: radius 6.5 cm, 0.2 turns a second, 50
intervals of 20 ms.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.costs import CostItem
from lgmpc.costs.activations import QuadraticBarrier
from lgmpc.costs.library import CoMPosition, CoMVelocity, ContactControlGravity, FrictionCone, StateError
from lgmpc.errors import InputError
from lgmpc.lie.checks import typed
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.problems.motion import com_positions, contact_positions, reactions
from lgmpc.problems.scenario import ProblemSettings, Scenario, Waypoint
from lgmpc.robot import Robot
from lgmpc.settings import Count, Friction, Interval, NonNegative, Positive, Settings
from lgmpc.typing import Array


class ComCircleWeights(Settings):
    """Weights of the squared deviations, per second of the horizon."""

    com: Positive = Field(default=1e4, description="Centre of mass from the circle, 1/m2.")
    com_velocity: NonNegative = Field(default=0.1, description="Velocity of the centre of mass, 1/(m/s)2.")
    base_orientation: NonNegative = Field(default=10.0, description="Base from upright, 1/rad2.")
    posture: NonNegative = Field(default=0.5, description="Joints from the reference posture, 1/rad2.")
    velocity: NonNegative = Field(default=0.1, description="Velocities of base and joints.")
    effort: NonNegative = Field(
        default=0.1, description="Torques from those that balance gravity and the contact forces, 1/(N.m)2."
    )
    cone: NonNegative = Field(default=1.0, description="Contact forces outside their friction cones, 1/N2.")


class ComCircleSettings(ProblemSettings):
    """The centre of mass of a standing robot follows a horizontal circle; contact forward dynamics."""

    kind: Literal["com_circle"] = Field(default="com_circle", description="The centre of mass follows a circle.")
    radius_m: Positive = Field(default=0.065, description="Radius of the circle, m; it begins at its foremost point.")
    frequency_hz: Positive = Field(default=0.2, description="Turns per second, Hz.")
    nodes: Count = Field(default=50, description="Number of intervals.")
    node_s: Interval = Field(default=0.02, description="Length of each interval, s.")
    friction: Friction = Field(
        default=0.6, description="Friction coefficient of the cones, which contact forces leave at a cost."
    )
    weights: ComCircleWeights = Field(default=ComCircleWeights(), description="Weights of the cost.")


@typed
def build_com_circle(robot: Robot, settings: ComCircleSettings | None = None) -> Scenario:
    """Return the problem for a robot that stands in its reference posture, at rest.

    Figures: ``com_error_m`` and ``com_rms_error_m``, distance of the centre of mass from its reference on the circle;
    ``foot_displacement_m``, largest displacement of a foot; ``friction_margin_n``, smallest distance of a contact
    force from its cone: ``friction`` times its normal part minus its tangential one.

    Raises:
        InputError: a robot without free base or contact frames.
    """
    s = ComCircleSettings() if settings is None else settings
    w = s.weights
    if not (robot.floating_base and robot.nc):
        raise InputError("robot", f"{robot.name} without feet", "a free base and contact_frames")
    stance = contact_positions(robot, robot.x_reference[None])[0]
    start = com_positions(robot, robot.x_reference[None])[0]
    phase = 2.0 * np.pi * s.frequency_hz * s.node_s * np.arange(s.nodes + 1)
    circle = start + s.radius_m * np.column_stack([np.cos(phase) - 1.0, np.sin(phase), np.zeros_like(phase)])

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
    problem.set("duration", s.node_s)
    problem.set("contact_points", stance.ravel())
    problem.set("com_reference", circle)
    for name, weight in (("com", w.com), ("speed", w.com_velocity), ("posture", deviation)):
        # Terminal costs are not multiplied by a duration: these weights give the last node the weight of the others.
        problem.set(f"{name}_weight", s.node_s * np.asarray(weight), [s.nodes])
    problem.set_initial_state(robot.x_reference)
    durations, flags = np.full(s.nodes, s.node_s), np.ones((s.nodes, robot.nc), dtype=np.bool_)

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

    quarter = 0.25 / (s.frequency_hz * s.node_s)
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
        waypoints=tuple(Waypoint("centre of mass", k * s.node_s, circle[k]) for k in marks),
        friction=s.friction,
    )
